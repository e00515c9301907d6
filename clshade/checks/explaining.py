"""What a scene's kernels leave out, why, and what that saves: measured against kernels with everything on."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from .. import programs
from ..features import OPTIONAL, texture_applies
from ..frame import Frame, same_bits
from ..renderer import Renderer
from ..scene import Scene
from .timing import Spread, in_turns, spread

FRAMES = 21  # of each kernel, unless they take longer than
SECONDS = 3.0  # altogether

WORK = {
    "AMBIENT": "ambient light",
    "DIFFUSE": "diffuse light",
    "SPECULAR": "highlights",
    "POWER": "power of highlights",
    "VERTEX_COLORS": "colors of vertices",
    "TEXTURED": "texture lookups",
    "MATERIALS": "material per face",
    "OWNERS": "owner of each pixel",
}
NOT_DRAWN = {
    "behind": "behind the eye",
    "off_screen": "off the screen",
    "between_samples": "between the pixels' centers",
    "zero_area": "without area",
    "back_facing": "seen from behind",
}


Times = dict[str, float]  # of one frame: milliseconds by stage


@dataclass(frozen=True)
class Side:
    """One of the two renderers. ms: median time of each stage and of the `frame`. bytes: what the device keeps."""

    ms: Times
    bytes: int


@dataclass(frozen=True)
class Explanation:
    """What `explain` found.

    needed: optional features that are in the kernels. left_out: those that are not -> why. unneeded: other work that
    this scene and view did without -> why.
    frames: how many were timed of each; 0 where nothing was left out. lean, full: the kernels as they are, and with
    everything on. ms_saved: of a frame against the one drawn next to it with everything on: the median, and between what
    the middle half of them lies. identical: whether their images and layers are the same bits.
    compiled, loaded: how many programs this process built from source and took from the cache, and the seconds of each.
    """

    needed: tuple[str, ...]
    left_out: dict[str, str]
    unneeded: dict[str, str]
    frames: int
    lean: Side
    full: Side
    ms_saved: Spread
    identical: bool
    compiled: tuple[int, float]
    loaded: tuple[int, float]

    @property
    def passed(self) -> bool:
        """Whether leaving out changed no bit."""
        return self.identical

    @property
    def bytes_saved(self) -> int:
        return self.full.bytes - self.lean.bytes

    def lines(self) -> list[str]:
        """What was found, for the terminal."""
        out = [f"left out: {WORK[name]} ({name}): {why}" for name, why in self.left_out.items()]
        out += [f"unneeded: {what}: {why}" for what, why in self.unneeded.items()]
        out.append(f"needed: {', '.join(WORK[name] for name in self.needed) or 'nothing of what may be left out'}")
        (compiled, building), (loaded, loading) = self.compiled, self.loaded
        ending = [
            f"programs: {compiled} compiled in {building:.2f} s, {loaded} loaded from the cache in {loading:.2f} s; "
            "another camera, another size or a moved light builds none"
        ]
        if not self.frames:
            return [*out, "saved: nothing, everything is needed", *ending]
        lean, full, saved = self.lean.ms, self.full.ms, self.ms_saved
        stages = ", ".join(
            f"{name} {lean[name]:.2f} ({full[name]:.2f})" for name in lean if name != "frame" and name in full
        )
        return [
            *out,
            f"saved: {saved.median:.2f} ms (half of them {saved.low:.2f} to {saved.high:.2f}), "
            f"{self.bytes_saved / 1e6:.2f} MB against "
            f"everything on, medians of {self.frames} frames each, in turns",
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
            "lean": vars(self.lean),
            "everything_on": vars(self.full),
            "ms_saved": self.ms_saved._asdict(),
            "bytes_saved": self.bytes_saved,
            "identical": self.identical,
            "programs_compiled": self.compiled[0],
            "programs_loaded": self.loaded[0],
        }


def explain(scene: Scene, *, frames: int = FRAMES, **options: Any) -> Explanation:
    """What the kernels for this scene leave out, and what that saves.

    frames: how many to draw of each; fewer where that takes more than 3 s. options: what `clshade.render` takes.
    Raises InputError and DeviceError.
    """
    with Renderer(scene, **options) as lean:
        first = lean.render()
        left_out = {name: why for name, why in lean.features.left_out if name in OPTIONAL}
        needed = tuple(name for name in OPTIONAL if lean.features[name])
        timed: list[tuple[Times, ...]] = []
        identical, sides = True, (_bytes(first), _bytes(first))
        with Renderer(scene, **options, forced=OPTIONAL) as full:
            if full.features.values != lean.features.values:
                other = full.render()
                identical, sides = same_bits(first, other), (_bytes(first), _bytes(other))
                del other
                sides_in_turn = [lambda _, side=side: side.render().stats["times_ms"] for side in (lean, full)]
                timed = in_turns(sides_in_turn, frames, SECONDS)
    lean_times, full_times = ([each[side] for each in timed] or [first.stats["times_ms"]] for side in (0, 1))
    saved = [b["frame"] - a["frame"] for a, b in zip(lean_times, full_times, strict=True)]
    return Explanation(
        needed=needed,
        left_out=left_out,
        unneeded=_unneeded(first),
        frames=len(timed),
        lean=Side(_medians(lean_times), sides[0]),
        full=Side(_medians(full_times), sides[1]),
        ms_saved=spread(saved),
        identical=identical,
        compiled=_programs(stored=False),
        loaded=_programs(stored=True),
    )


def _medians(times: list[Times]) -> Times:
    """Of each stage that runs in every frame; what happens once is left away."""
    once = {"pack", "open", "build", "upload"}
    return {name: median(each.get(name, 0.0) for each in times) for name in times[0] if name not in once}


def _bytes(frame: Frame) -> int:
    """What the device keeps of the scene, the image and the pixels' owners."""
    return sum(frame.stats["bytes"].values())


def _programs(stored: bool) -> tuple[int, float]:
    seconds = [program.seconds for program in programs.built() if program.stored == stored]
    return len(seconds), sum(seconds)


def _unneeded(frame: Frame) -> dict[str, str]:
    """What else this scene and view did without -> why."""
    scene, settings, stats = frame.scene, frame.settings, frame.stats
    used, found = set(stats["features"]), {}
    if "DEPTH_TEST" not in used:
        found["depth at every pixel"] = "visibility painter"
    if "PERSPECTIVE" not in used:
        why = "parallel projection" if scene.camera.orthographic else "interpolation affine"
        found["perspective division"] = why
    if settings.shader == "nolight":
        found["normals"] = "shader nolight"
    if settings.texture_filter == "trilinear" and "MIPMAPS" not in used:
        textured = any(map(texture_applies, scene.meshes))
        found["mip-map levels"] = "textures of one texel or the course's lookup" if textured else "no texture"
    dark = sum(1 for light in scene.lights if not light.intensity.any())
    if dark:
        found["lights"] = f"{dark} of {len(scene.lights)} of intensity 0"
    vertices = sum(len(mesh.verts) * len(np.asarray(mesh.instances)) for mesh in scene.meshes)
    if stats["vertices"] < vertices:
        found["vertices"] = f"{vertices - stats['vertices']:,} of {vertices:,} in no face"
    if not stats["clipped"]:
        found["clipping"] = "no triangle crosses the near plane or goes far beyond the image"
    culled = [f"{stats[name]:,} {what}" for name, what in NOT_DRAWN.items() if stats[name]]
    if culled:
        found["triangles"] = f"{', '.join(culled)}, of {stats['triangles']:,}"
    return found
