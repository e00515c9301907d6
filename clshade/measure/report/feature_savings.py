"""`render --explain`: what the kernels of a scene leave out, why, and the time that saves, measured against kernels with
everything on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np

from ...pipeline import features
from ...pipeline.features import OPTIONAL
from ...pipeline.frame import Frame, same_bits
from ...pipeline.renderer import Renderer
from ...scene.model import Scene
from ...scene.settings import LAYERS
from ..timing import Spread, in_turns, spread

FRAMES = 21  # of each renderer, unless they take longer in total than
SECONDS = 3.0
WORK = features.WORK | {"BACKDROP": "environment as the background"}
NOT_DRAWN = {
    "behind": "behind the eye",
    "off_screen": "off the screen",
    "between_samples": "between the samples",
    "zero_area": "without area",
    "back_facing": "seen from behind",
}


@dataclass(frozen=True)
class Explanation:
    """Result of `explain`.

    needed: optional features in the kernels. left_out: the others -> why. unneeded: other work that this scene and view
    did without -> why. frames: number timed of each renderer. ms: median time of each stage and of the `frame`, as it is and
    with everything on. bytes: device memory of both. saved_ms: how much longer a frame with everything on took than
    the one drawn before it. identical: whether the images and layers of both are.
    """

    needed: tuple[str, ...]
    left_out: dict[str, str]
    unneeded: dict[str, str]
    frames: int
    ms: tuple[dict[str, float], dict[str, float]]
    bytes: tuple[int, int]
    saved_ms: Spread
    identical: bool

    @property
    def passed(self) -> bool:
        """Whether leaving features out changed no bit."""
        return self.identical

    def lines(self) -> list[str]:
        """Return the results as lines for the terminal."""
        lean, full = self.ms
        low, middle, high = self.saved_ms
        lean_mb, full_mb = (size / 1e6 for size in self.bytes)
        names = [name for name in {**lean, **full} if name != "frame"]
        stages = ", ".join(f"{name} {lean.get(name, 0.0):.2f} ({full.get(name, 0.0):.2f})" for name in names)
        return [
            *(f"left out: {WORK[name]} ({name}): {why}" for name, why in self.left_out.items()),
            *(f"unneeded: {what}: {why}" for what, why in self.unneeded.items()),
            f"needed: {', '.join(WORK[name] for name in self.needed) or 'nothing of what may be left out'}",
            f"saved: {middle:.2f} ms ({low:.2f} to {high:.2f}) and {full_mb - lean_mb:.2f} MB against everything on: "
            f"medians of {self.frames} frames each, in turns, and between what half of them lie",
            f"frame {lean['frame']:.2f} ms instead of {full['frame']:.2f} ms, {full['frame'] / lean['frame']:.2f} times "
            f"as fast; {lean_mb:.2f} MB instead of {full_mb:.2f} MB",
            *([f"stages, in ms (with everything on): {stages}"] if stages else []),
            f"images: {'the same bits' if self.identical else 'FAILED, they differ'}",
        ]

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {**asdict(self), "saved_ms": self.saved_ms._asdict()}


def explain(scene: Scene, **options: Any) -> Explanation:
    """Measure what the kernels of a scene leave out. options: keyword arguments of `clshade.render`.

    Raises InputError and DeviceError.
    """
    with Renderer(scene, **options) as lean, Renderer(scene, forced=OPTIONAL, **options) as full:
        frame, full_frame = lean.render(), full.render()
        identical, sizes = same_bits(frame, full_frame), (_bytes(frame), _bytes(full_frame))
        del full_frame  # releases its memory for the next frames
        draws = [lambda _, renderer=renderer: renderer.render().stats["times_ms"] for renderer in (lean, full)]
        timed = in_turns(draws, FRAMES, SECONDS)
        left_out, chosen = dict(lean.features.left_out), ("BACKDROP",) if lean.features["BACKDROP"] else ()
    return Explanation(
        needed=tuple(name for name in OPTIONAL if name not in left_out) + chosen,
        left_out=left_out,
        unneeded=_unneeded(frame),
        frames=len(timed),
        ms=(_medians([lean for lean, _ in timed]), _medians([full for _, full in timed])),
        bytes=sizes,
        saved_ms=spread([after["frame"] - before["frame"] for before, after in timed]),
        identical=identical,
    )


def _medians(times: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the median of each stage that runs in every frame, without those that run once."""
    once = {"pack", "open", "upload"}
    return {name: median(ms.get(name, 0.0) for ms in times) for name in times[0] if name not in once}


def _bytes(frame: Frame) -> int:
    """Return the device memory of the scene, the image and the owner buffer."""
    return sum(frame.stats["bytes"][name] for name in ("scene", "image", "owners"))


def _unneeded(frame: Frame) -> dict[str, str]:
    """Return other work that this scene and view did without -> why, and how much."""
    scene, stats = frame.scene, frame.stats
    columns, rows = stats["resolution"]
    pixels, covered = columns * rows, np.count_nonzero(frame.alpha)
    triangles, lights = stats["triangles"], len(scene.lights)
    flat = "parallel projection" if scene.camera.orthographic else "interpolation affine"
    dark = sum(not light.intensity.any() for light in scene.lights)
    vertices = sum(len(mesh.verts) * len(np.asarray(mesh.instances)) for mesh in scene.meshes)
    unused, unclipped = vertices - stats["vertices"], triangles - stats["clipped"]
    culled = [f"{stats[name]:,} {what}" for name, what in NOT_DRAWN.items() if stats[name]]
    absent = [name for name in LAYERS if name not in frame.layers]
    work = {
        "depth at every pixel": "DEPTH_TEST" not in stats["features"] and f"visibility painter, {pixels:,} pixels",
        "perspective division": "PERSPECTIVE" not in stats["features"] and f"{flat}, {covered:,} pixels",
        "lights": dark and f"{dark} of {lights} of intensity 0",
        "vertices": unused > 0 and f"{unused:,} of {vertices:,} in no face",
        "clipping": unclipped
        and f"{unclipped:,} of {triangles:,} triangles neither cross the near plane nor go far beyond the image",
        "triangles": culled and f"{', '.join(culled)}, of {triangles:,}",
        "tiles": stats["empty_tiles"] and f"{stats['empty_tiles']:,} of {stats['tiles']:,} hold no triangle",
        "shading": covered < pixels and f"{pixels - covered:,} of {pixels:,} pixels show no triangle",
        "layers": absent and f"{', '.join(absent)} not asked for",
    }
    return {what: str(why) for what, why in work.items() if why}
