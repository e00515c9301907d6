"""The bench on which the cases of `stability` run, and the outcome of a case."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ....base.arrays import Array
from ....pipeline import shading_tables
from ....pipeline.buffers import Buffer
from ....pipeline.features import GROUPS, Features
from ....pipeline.frame import Frame
from ....pipeline.launches import Stages
from ....pipeline.opencl.device import Device
from ....pipeline.programs import build
from ....pipeline.renderer import Renderer
from ....pipeline.struct_layout import SINGLE
from ....scene.material import TERMS
from ....scene.model import Scene
from ....scene.settings import Layer
from ...check.check import compare
from ...check.oracle_bounds import HALF_ULP, depth_roundings

PRESETS = ("standard", "course")
LAYERS: tuple[Layer, ...] = ("Z", "id")


@dataclass(frozen=True)
class Outcome:
    """Measurements of a case, or of a part of it.

    wrong: pixels (or values, where the case says so) that are not exactly as expected.
    error: largest measured error, in `unit`; allowed up to `limit`. Both are 0 in cases that only count.
    amplification: the largest error in float32 roundings (2^-24 of the light budget).
    detail: which part, if that says more than its pictures.
    pictures: rendered and expected image, (M, N) or (M, N, 3).
    """

    wrong: int = 0
    error: float = 0.0
    limit: float = 0.0
    unit: str = ""
    amplification: float | None = None
    detail: str = ""
    pictures: tuple[Array, Array] | None = field(default=None, repr=False)

    @property
    def passed(self) -> bool:
        """Whether nothing is wrong and the error is within its limit; NaN is not."""
        return self.wrong == 0 and bool(self.error <= self.limit)

    @property
    def share(self) -> float:
        """The error as a share of its limit, infinite for NaN."""
        return float(np.nan_to_num(self.error / self.limit, nan=np.inf)) if self.limit else 0.0


Outcomes = Iterable[Outcome]


def worst(outcomes: Outcomes) -> Outcome:
    """Combine parts: the count of all, the largest error, and the images of a part that fails."""
    parts = list(outcomes)
    largest = max(parts, key=lambda part: part.share)
    outcome = next((part for part in parts if not part.passed), largest)
    return replace(
        largest,
        wrong=sum(part.wrong for part in parts),
        amplification=max((part.amplification for part in parts if part.amplification is not None), default=None),
        detail=outcome.detail,
        pictures=outcome.pictures,
    )


class Bench:
    """A device and the operations that cases need; tests plant errors by overriding them.

    triangles: number of random triangles of the coverage case, and of those that share pixels by twos.
    """

    def __init__(self, device: Device, *, triangles: int = 50_000) -> None:
        self.device, self.triangles = device, triangles

    def draw(self, scene: Scene, **options: Any) -> Frame:
        """Render one frame with LAYERS."""
        with Renderer(scene, device=self.device, layers=LAYERS, **options) as renderer:
            return renderer.render()

    def highlights(self, points: Array, normals: Array, position: Array, n: float) -> Array:
        """Run the stage `light` at points (K, 3) relative to the eye, with unit normals (K, 3) and one light (3,) of
        intensity 1, all converted to float32. Return (K,) float32. ks is 1, other coefficients are 0."""
        features = Features.of({"LIT", "POWER", *GROUPS["TERMS"]})
        stages = Stages(self.device, build(self.device, features, ("light.cl",)))
        material, lights = np.zeros(1, SINGLE.Material), np.zeros(1, SINGLE.Light)
        material["k"] = np.repeat([float(name == "ks") for name in TERMS], 3)
        material["n"], material["texture"] = n, -1
        lights["position"], lights["intensity"] = position, 1.0
        vectors = np.zeros((3, len(points), 4))
        vectors[..., :3] = points, normals, np.ones_like(points)
        # Bound to names, so that the memory outlives the kernel.
        at, facing, tint = (Buffer(self.device, vector) for vector in shading_tables.to_real(vectors))
        inputs = {"points": at, "normals": facing, "colors": tint}
        inputs |= {"materials": Buffer(self.device, material), "lights": Buffer(self.device, lights)}
        lit = Buffer(self.device, np.full((len(points), 4), np.nan, np.float32))
        numbers = {"needs": features.needs, "unit": 1.0, "light_count": 1, "count": len(points)}
        stages.run("light", stages.vectors(len(points)), inputs, lit=lit, **numbers)
        values: Array = lit.to_host()[:, 0].copy()
        return values


@dataclass(frozen=True)
class Case:
    """One named case.

    number: in the list of cases, an integer and perhaps a letter. title: what is stressed. expected: what a correct
    renderer does. parts: draws and compares its parts. slow: takes more than two seconds or builds further programs.
    """

    number: str
    name: str
    title: str
    expected: str
    parts: Callable[[Bench], Outcomes]
    slow: bool = False

    def run(self, bench: Bench) -> Outcome:
        return worst(self.parts(bench))


def wrong_pixels(actual: Array, expected: Array, detail: str = "") -> Outcome:
    """Compare two images, (M, N) or (M, N, 3), which must agree exactly."""
    different = (actual != expected).reshape(*actual.shape[:2], -1).any(axis=-1)
    return Outcome(int(different.sum()), detail=detail, pictures=(actual, expected))


def against_oracle(frame: Frame, detail: str = "") -> Outcome:
    """Compare a frame with the oracle as `clshade.check` does: ids and coverage exactly but for proven depth ties,
    depths within their roundings, colors within their bounds."""
    compared = compare(frame, np.arange(frame.alpha.size))
    too_deep = compared.depth is not None and not compared.depth <= depth_roundings(frame.alpha)
    ids, rgb = (frame["id"], compared.oracle.id), (frame.rgb, compared.oracle.rgb)
    actual, expected = ids if compared.wrong.any() else rgb
    return Outcome(
        int(compared.wrong.sum()) + int(too_deep),
        float(compared.counted.max()),
        compared.allowed,
        "bounds",
        float(compared.relative.max()) / HALF_ULP,
        detail,
        (actual, expected.reshape(actual.shape)),
    )


def all_against_oracle(bench: Bench, scenes: Iterable[Scene], **options: Any) -> Outcomes:
    """Draw scenes and compare them with the oracle."""
    return (against_oracle(bench.draw(scene, **options)) for scene in scenes)


def different_bits(a: Frame, b: Frame) -> Outcome:
    """Count the pixels that differ in a bit of the image or layers."""
    wrong = (a.rgba.view(np.uint32) != b.rgba.view(np.uint32)).any(axis=-1)
    for name in a.layers:
        wrong |= a[name].view(np.uint32) != b[name].view(np.uint32)
    return Outcome(int(wrong.sum()), pictures=(a.rgb, b.rgb))
