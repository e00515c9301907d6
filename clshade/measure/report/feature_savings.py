"""What a scene's kernels leave out, why, and what that saves: measured against kernels with everything on."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from ...pipeline import programs
from ...pipeline.features import OPTIONAL
from ...pipeline.frame import Frame, same_bits
from ...pipeline.renderer import Renderer
from ...scene.model import Scene
from ...scene.settings import LAYERS
from ..timing import Spread, in_turns, spread

FRAMES = 21  # of each kernel, unless they take longer than
SECONDS = 3.0  # altogether

WORK = {
    "LIT": "lighting",
    "AMBIENT": "ambient light",
    "DIFFUSE": "diffuse light",
    "SPECULAR": "highlights",
    "POWER": "power of highlights",
    "TWO_SIDED": "normals turned to the side seen",
    "NORMAL_INDICES": "indices of normals",
    "VERTEX_COLORS": "colors of vertices",
    "TEXTURED": "texture lookups",
    "UV_INDICES": "indices of texture coordinates",
    "MIPMAPS": "mip-map levels",
    "ALPHA_TEST": "alpha test",
    "MATERIALS": "material per face",
    "SIDES": "side of each material that is drawn",
    "DOUBLE_POSITIONS": "positions in float64",
    "BACKGROUND": "color of the background",
    "OWNERS": "owner of each pixel",
}
NOT_DRAWN = {
    "behind": "behind the eye",
    "off_screen": "off the screen",
    "between_samples": "between the samples",
    "zero_area": "without area",
    "back_facing": "seen from behind",
}


Times = dict[str, float]  # of one frame: milliseconds by stage


@dataclass(frozen=True)
class Side:
    """One of the renderers. ms: median time of each stage and of the `frame`. bytes: what the device keeps. extra: by
    how many ms its frames took longer than those as they are that were drawn next to them."""

    ms: Times
    bytes: int
    extra: Spread


@dataclass(frozen=True)
class Explanation:
    """What `explain` found.

    needed: optional features that are in the kernels. left_out: those that are not -> why. unneeded: other work that
    this scene and view did without -> why.
    frames: how many were timed of each; 0 where nothing was left out. lean, full: the kernels as they are, and with
    everything on. alone: with one feature on that was left out, by its name; empty unless asked for.
    identical: whether their images and layers are all the same bits.
    compiled, loaded: how many programs this process built from source and took from the cache, and the seconds of each.
    """

    needed: tuple[str, ...]
    left_out: dict[str, str]
    unneeded: dict[str, str]
    frames: int
    lean: Side
    full: Side
    alone: dict[str, Side]
    identical: bool
    compiled: tuple[int, float]
    loaded: tuple[int, float]

    @property
    def passed(self) -> bool:
        """Whether leaving out changed no bit."""
        return self.identical

    def _saved(self, other: Side) -> str:
        low, middle, high = other.extra
        return f"{middle:.2f} ms ({low:.2f} to {high:.2f}) and {(other.bytes - self.lean.bytes) / 1e6:.2f} MB"

    def lines(self) -> list[str]:
        """What was found, for the terminal."""
        out = [
            f"left out: {WORK[name]} ({name}): {why}"
            + (f"; on alone it costs {self._saved(self.alone[name])}" if name in self.alone else "")
            for name, why in self.left_out.items()
        ]
        out += [f"unneeded: {what}: {why}" for what, why in self.unneeded.items()]
        out.append(f"needed: {', '.join(WORK[name] for name in self.needed) or 'nothing of what may be left out'}")
        (compiled, building), (loaded, loading) = self.compiled, self.loaded
        ending = [
            f"programs: {compiled} compiled in {building:.2f} s, {loaded} loaded from the cache in {loading:.2f} s; "
            "another camera, another size or a moved light builds none"
        ]
        if not self.frames:
            return [*out, "saved: nothing, everything is needed", *ending]
        lean, full = self.lean.ms, self.full.ms
        names = [name for name in {**lean, **full} if name != "frame"]
        stages = ", ".join(f"{name} {lean.get(name, 0.0):.2f} ({full.get(name, 0.0):.2f})" for name in names)
        return [
            *out,
            f"saved: {self._saved(self.full)} against everything on: medians of {self.frames} frames each, in turns, and "
            "between what half of them lie",
            f"frame {lean['frame']:.2f} ms instead of {full['frame']:.2f} ms, {full['frame'] / lean['frame']:.2f} times "
            f"as fast; {self.lean.bytes / 1e6:.2f} MB instead of {self.full.bytes / 1e6:.2f} MB",
            *([f"stages, in ms (with everything on): {stages}"] if stages else []),
            "images: " + ("the same bits" if self.identical else "FAILED, they differ"),
            *ending,
        ]

    def stats(self) -> dict[str, Any]:
        """The figures, as JSON takes them."""
        return {
            "needed": self.needed,
            "left_out": self.left_out,
            "unneeded": self.unneeded,
            "frames": self.frames,
            "lean": _figures(self.lean),
            "everything_on": _figures(self.full),
            "alone": {name: _figures(side) for name, side in self.alone.items()},
            "identical": self.identical,
            "programs_compiled": self.compiled[0],
            "programs_loaded": self.loaded[0],
        }


def _figures(side: Side) -> dict[str, Any]:
    return {"ms": side.ms, "bytes": side.bytes, "extra_ms": side.extra._asdict()}


def explain(scene: Scene, *, frames: int = FRAMES, each: bool = False, **options: Any) -> Explanation:
    """What the kernels for this scene leave out, and what that saves.

    frames: how many to draw of each; fewer where that takes more than 3 s for two renderers. each: whether to measure
    each feature that was left out by itself too; builds a program for each. options: what `clshade.render` takes.
    Raises InputError and DeviceError.
    """
    with ExitStack() as opened:

        def opening(forced: Collection[str]) -> Renderer:
            return opened.enter_context(Renderer(scene, forced=forced, **options))

        renderers = [opening(())]
        first = renderers[0].render()
        left_out = dict(renderers[0].features.left_out)
        if left_out:
            renderers += [opening(OPTIONAL), *(opening((name,)) for name in left_out if each)]
        others = [renderer.render() for renderer in renderers[1:]]
        identical = all(same_bits(first, other) for other in others)
        sizes = [_bytes(frame) for frame in (first, *others)]
        others.clear()  # their memory is the next frames'
        draws = [lambda _, renderer=renderer: renderer.render().stats["times_ms"] for renderer in renderers]
        timed = in_turns(draws, frames, SECONDS * len(draws) / 2) if left_out else []
    sides = [_side(timed or [(first.stats["times_ms"],)], k, size) for k, size in enumerate(sizes)]
    return Explanation(
        needed=tuple(name for name in OPTIONAL if name not in left_out),
        left_out=left_out,
        unneeded=_unneeded(first),
        frames=len(timed),
        lean=sides[0],
        full=sides[1] if left_out else sides[0],
        alone=dict(zip(left_out, sides[2:], strict=True)) if each else {},
        identical=identical,
        compiled=_programs(stored=False),
        loaded=_programs(stored=True),
    )


def _side(timed: list[tuple[Times, ...]], k: int, size: int) -> Side:
    """Of renderer k: the first one's frames are those as they are."""
    return Side(_medians([row[k] for row in timed]), size, spread([row[k]["frame"] - row[0]["frame"] for row in timed]))


def _medians(times: list[Times]) -> Times:
    """Of each stage that runs in every frame; what happens once is left away."""
    once = {"pack", "open", "upload"}
    return {name: median(each.get(name, 0.0) for each in times) for name in times[0] if name not in once}


def _bytes(frame: Frame) -> int:
    """What the device keeps of the scene, the image and the pixels' owners."""
    return sum(frame.stats["bytes"].values())


def _programs(stored: bool) -> tuple[int, float]:
    seconds = [program.seconds for program in programs.built() if program.stored == stored]
    return len(seconds), sum(seconds)


def _unneeded(frame: Frame) -> dict[str, str]:
    """What else this scene and view did without -> why, and how much of it."""
    scene, stats = frame.scene, frame.stats
    used, found = set(stats["features"]), {}
    columns, rows = stats["resolution"]
    covered = np.count_nonzero(frame.alpha)
    if "DEPTH_TEST" not in used:
        found["depth at every pixel"] = f"visibility painter, {columns * rows:,} pixels"
    if "PERSPECTIVE" not in used:
        why = "parallel projection" if scene.camera.orthographic else "interpolation affine"
        found["perspective division"] = f"{why}, {covered:,} pixels"
    dark = sum(1 for light in scene.lights if not light.intensity.any())
    if dark:
        found["lights"] = f"{dark} of {len(scene.lights)} of intensity 0"
    vertices = sum(len(mesh.verts) * len(np.asarray(mesh.instances)) for mesh in scene.meshes)
    if stats["vertices"] < vertices:
        found["vertices"] = f"{vertices - stats['vertices']:,} of {vertices:,} in no face"
    whole = stats["triangles"] - stats["clipped"]
    if whole:
        found["clipping"] = (
            f"{whole:,} of {stats['triangles']:,} triangles neither cross the near plane nor go far beyond the image"
        )
    culled = [f"{stats[name]:,} {what}" for name, what in NOT_DRAWN.items() if stats[name]]
    if culled:
        found["triangles"] = f"{', '.join(culled)}, of {stats['triangles']:,}"
    if stats["empty_tiles"]:
        found["tiles"] = f"{stats['empty_tiles']:,} of {stats['tiles']:,} hold no triangle"
    if covered < columns * rows:
        found["shading"] = f"{columns * rows - covered:,} of {columns * rows:,} pixels show no triangle"
    absent = [name for name in LAYERS if name not in frame.layers]
    if absent:
        found["layers"] = f"{', '.join(absent)} not asked for"
    return found
