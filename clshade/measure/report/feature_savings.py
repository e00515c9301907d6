"""Features that a scene's kernels leave out, why, and the time saved, measured against kernels with every feature
on; and the shadow rays of a frame."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from ...base.text_tables import as_lines
from ...pipeline import programs
from ...pipeline.features import FEATURES, OPTIONAL
from ...pipeline.frame import Frame, same_bits
from ...pipeline.renderer import Renderer
from ...pipeline.shadow_counts import SKIPPED, CountingRenderer, ShadowCounts
from ...scene.model import Scene
from ...scene.settings import LAYERS
from ..timing import Spread, in_turns, spread

FRAMES = 21  # per renderer, unless they take longer in total than
SECONDS = 3.0

WORK = {feature.name: feature.work for feature in FEATURES if feature.work} | {
    "BACKDROP": "environment as the background"
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
    """Measurements of one renderer.

    ms: median time of each stage and of the `frame`. bytes: device memory kept. extra: how many ms longer its frames
    took than the specialized renderer's frames drawn next to them.
    """

    ms: Times
    bytes: int
    extra: Spread


@dataclass(frozen=True)
class Explanation:
    """Result of `explain`.

    needed: optional features in the kernels. left_out: those left out -> why. unneeded: other work that this scene and
    view did without -> why. frames: number timed per renderer; 0 if nothing was left out. lean, full: the specialized
    kernels, and those with every feature on. alone: by name, with one left-out feature on; empty unless requested.
    rays: counts of shadow rays; None without shadows. identical: whether all images and layers are bit-identical, those of
    the kernels that count included. compiled, loaded: programs that this process built from source and loaded from the
    cache: number and seconds.
    """

    needed: tuple[str, ...]
    left_out: dict[str, str]
    unneeded: dict[str, str]
    frames: int
    lean: Side
    full: Side
    alone: dict[str, Side]
    rays: ShadowCounts | None
    identical: bool
    compiled: tuple[int, float]
    loaded: tuple[int, float]

    @property
    def passed(self) -> bool:
        """Whether leaving features out changed no bit."""
        return self.identical

    def _saved(self, other: Side) -> str:
        low, middle, high = other.extra
        return f"{middle:.2f} ms ({low:.2f} to {high:.2f}) and {(other.bytes - self.lean.bytes) / 1e6:.2f} MB"

    def lines(self) -> list[str]:
        """Return the results as lines for the terminal."""
        out = [
            f"left out: {WORK[name]} ({name}): {why}"
            + (f"; on alone it costs {self._saved(self.alone[name])}" if name in self.alone else "")
            for name, why in self.left_out.items()
        ]
        out += [f"unneeded: {what}: {why}" for what, why in self.unneeded.items()]
        out.append(f"needed: {', '.join(WORK[name] for name in self.needed) or 'nothing of what may be left out'}")
        out += [] if self.rays is None else _ray_lines(self.rays)
        (compiled, building), (loaded, loading) = self.compiled, self.loaded
        ending = [
            f"programs: {compiled} compiled in {building:.2f} s, {loaded} loaded from the cache in {loading:.2f} s; "
            "another camera, another size or a moved light builds none"
        ]
        images = "images: " + ("the same bits" if self.identical else "FAILED, they differ")
        if not self.frames:
            return [*out, "saved: nothing, everything is needed", images, *ending]
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
            images,
            *ending,
        ]

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "needed": self.needed,
            "left_out": self.left_out,
            "unneeded": self.unneeded,
            "frames": self.frames,
            "lean": _figures(self.lean),
            "everything_on": _figures(self.full),
            "alone": {name: _figures(side) for name, side in self.alone.items()},
            "shadow_rays": None if self.rays is None else self.rays.stats(),
            "identical": self.identical,
            "programs_compiled": self.compiled[0],
            "programs_loaded": self.loaded[0],
        }


def _ray_lines(rays: ShadowCounts) -> list[str]:
    """Return what became of the rays, as lines for the terminal."""

    def row(name: str, count: int) -> tuple[str, ...]:
        return name, f"{count:,}", f"{100.0 * count / max(rays.possible, 1):.1f} %"

    skipped = [row(f"skipped: {SKIPPED[name]}", count) for name, count in rays.skipped.items() if count]
    traced = [row("traced", rays.traced), row("traced and hidden", rays.hidden)]
    table = as_lines(("shadow rays", "number", "share"), [row("possible", rays.possible), *skipped, *traced])
    possible = f"possible: {rays.places:,} lit places, each to {rays.points:,} points of {rays.lights:,} lights"
    occlusion = f"rays of ambient occlusion: {rays.occlusion:,}, of which {rays.occluded:,} meet a triangle"
    return [
        *([*table, possible] if rays.lights else []),
        *([occlusion] if rays.occlusion else []),
        f"traced in {rays.packets:,} packets, of which {rays.lit_packets:,} are wholly lit and {rays.dark_packets:,} wholly "
        f"dark: {rays.filtered:,} triangles were tested by the filter, {rays.decided:,} by the exact predicate",
    ]


def _figures(side: Side) -> dict[str, Any]:
    return {"ms": side.ms, "bytes": side.bytes, "extra_ms": side.extra._asdict()}


def explain(scene: Scene, *, frames: int = FRAMES, each: bool = False, **options: Any) -> Explanation:
    """Measure what the kernels for this scene leave out, and the time saved.

    frames: number per renderer; fewer if that takes more than 3 s for two renderers. each: also measure each left-out
    feature by itself, which builds a program for each. options: keyword arguments of `clshade.render`.
    Raises InputError and DeviceError.
    """
    with ExitStack() as opened:

        def opening(forced: Collection[str]) -> Renderer:
            return opened.enter_context(Renderer(scene, forced=forced, **options))

        renderers = [opening(())]
        first = renderers[0].render()
        left_out = dict(renderers[0].features.left_out)
        chosen = ("BACKDROP",) if renderers[0].features["BACKDROP"] else ()
        if left_out:
            renderers += [opening(OPTIONAL), *(opening((name,)) for name in left_out if each)]
        others = [renderer.render() for renderer in renderers[1:]]
        identical = all(same_bits(first, other) for other in others)
        sizes = [_bytes(frame) for frame in (first, *others)]
        others.clear()  # releases their memory for the next frames
        draws = [lambda _, renderer=renderer: renderer.render().stats["times_ms"] for renderer in renderers]
        timed = in_turns(draws, frames, SECONDS * len(draws) / 2) if left_out else []
    rays, counted_identical = None, True
    if renderers[0].features["CASTERS"]:
        with CountingRenderer(scene, **options) as counting:
            counted, rays = counting.count()
        counted_identical = same_bits(first, counted)
    sides = [_side(timed or [(first.stats["times_ms"],)], k, size) for k, size in enumerate(sizes)]
    return Explanation(
        needed=tuple(name for name in OPTIONAL if name not in left_out) + chosen,
        left_out=left_out,
        unneeded=_unneeded(first),
        frames=len(timed),
        lean=sides[0],
        full=sides[1] if left_out else sides[0],
        alone=dict(zip(left_out, sides[2:], strict=True)) if each else {},
        rays=rays,
        identical=identical and counted_identical,
        compiled=_programs(stored=False),
        loaded=_programs(stored=True),
    )


def _side(timed: list[tuple[Times, ...]], k: int, size: int) -> Side:
    """Return the measurements of renderer k; renderer 0 is the specialized one."""
    return Side(_medians([row[k] for row in timed]), size, spread([row[k]["frame"] - row[0]["frame"] for row in timed]))


def _medians(times: list[Times]) -> Times:
    """Return the median of each stage that runs in every frame, without those that run once."""
    once = {"pack", "open", "upload"}
    return {name: median(each.get(name, 0.0) for each in times) for name in times[0] if name not in once}


def _bytes(frame: Frame) -> int:
    """Return the device memory of the scene, the image and the owner buffer."""
    return sum(frame.stats["bytes"][name] for name in ("scene", "image", "owners"))


def _programs(stored: bool) -> tuple[int, float]:
    seconds = [program.seconds for program in programs.built() if program.stored == stored]
    return len(seconds), sum(seconds)


def _unneeded(frame: Frame) -> dict[str, str]:
    """Return other work that this scene and view did without -> why, and how much."""
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
