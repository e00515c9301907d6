"""The bench on which the cases of `stability` run, and the outcome of a case."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .... import oracle
from ....base.arrays import Array
from ....images import exr
from ....oracle import OracleFrame, shade
from ....oracle.terms import Surface
from ....pipeline import shading_tables
from ....pipeline.buffers import Buffer
from ....pipeline.features import GROUPS, Features
from ....pipeline.frame import Frame
from ....pipeline.launches import Stages
from ....pipeline.opencl.device import Device
from ....pipeline.programs import build
from ....pipeline.renderer import Renderer
from ....pipeline.single_primitive import Lookup
from ....pipeline.struct_layout import SINGLE
from ....scene.material import TERMS
from ....scene.model import Scene, Texture
from ....scene.settings import Layer
from ...check import oracle_bounds

LAYERS: tuple[Layer, ...] = ("Z", "id")
BOUNDS = 32.0  # times sqrt(max(n, 1)) * 2^-24 * kappa * B: allowed color error (oracle_bounds.color_bound)
_POINT_FEATURES = {"LIT", "POWER", *GROUPS["TERMS"]}


@dataclass(frozen=True)
class Outcome:
    """Measurements of a case.

    wrong: pixels (or values, where the case says so) that are not exactly as expected.
    error: largest measured error, in `unit`; allowed up to `limit`. Both are 0 in cases that only count.
    amplification: the largest error in float32 roundings (2^-24 of the light budget).
    detail: what was compared, in a few words.
    fingerprint: hash of the bits on which all devices must agree; empty where they need not.
    pictures: rendered and expected image, (M, N) or (M, N, 3), of the worst part.
    """

    wrong: int = 0
    error: float = 0.0
    limit: float = 0.0
    unit: str = ""
    amplification: float | None = None
    detail: str = ""
    fingerprint: str = ""
    pictures: tuple[Array, Array] | None = field(default=None, repr=False)

    @property
    def passed(self) -> bool:
        """Whether nothing is wrong and the error is within its limit; NaN is not."""
        return self.wrong == 0 and bool(self.error <= self.limit)

    @property
    def badness(self) -> float:
        """How close to failing, for choosing the worst of several."""
        return (1e6 + self.wrong) if self.wrong else (self.error / self.limit if self.limit else self.error)


def worst(outcomes: list[Outcome], detail: str = "") -> Outcome:
    """Combine outcomes: the counts of all, the error and the images of the worst."""
    chosen = max(outcomes, key=lambda o: o.badness)
    bad = [o.error for o in outcomes if not o.error <= o.limit]
    if bad and chosen.error <= chosen.limit:  # wrong pixels elsewhere must not hide an error
        other = next(o for o in outcomes if not o.error <= o.limit)
        chosen = replace(other, pictures=chosen.pictures or other.pictures)
    amplified = [o.amplification for o in outcomes if o.amplification is not None]
    return replace(
        chosen,
        wrong=sum(o.wrong for o in outcomes),
        amplification=max(amplified) if amplified else None,
        detail=detail or chosen.detail,
    )


class Bench:
    """A device and the operations that cases need; tests plant errors by overriding them.

    triangles: number of random triangles of the coverage case, and of those that share pixels by twos. fractions: how
    many of the random ones are also checked in rational arithmetic. folder: for temporary files.
    """

    def __init__(self, device: Device, folder: Path, *, triangles: int = 50_000, fractions: int = 1000) -> None:
        self.device, self.folder = device, folder
        self.triangles, self.fractions = triangles, min(fractions, triangles)

    def draw(self, scene: Scene, **options: Any) -> Frame:
        """Render one frame with all layers."""
        with Renderer(scene, device=self.device, layers=LAYERS, **options) as renderer:
            return renderer.render()

    def light(
        self,
        points: Array,
        normals: Array,
        lights: tuple[Array, Array],
        *,
        n: float = 1.0,
        colors: Array | None = None,
        **k: Any,
    ) -> Array:
        """Run the stage `light` at points (K, 3) relative to the eye, with unit normals (K, 3), all converted to
        float32.

        Returns (K, 3) float32. lights: positions (L, 3), intensities (L, 3). k: coefficients, see `_coefficients`.
        """
        features = Features.of(_POINT_FEATURES)
        stages = Stages(self.device, build(self.device, features, ("light.cl",)))
        material, table = np.zeros(1, SINGLE.Material), np.zeros(len(lights[0]), SINGLE.Light)
        material["k"] = np.concatenate(list(_coefficients(k).values()))
        material["n"], material["texture"] = n, -1
        table["position"], table["intensity"] = lights
        colors = np.ones_like(points) if colors is None else colors
        # Bound to names, so that the memory outlives the kernel.
        at, facing, tint = (Buffer(self.device, _four(a)) for a in (points, normals, colors))
        surface, shining = Buffer(self.device, material), Buffer(self.device, table)
        found = Buffer(self.device, np.full((len(points), 4), np.nan, np.float32))
        stages.light(at, facing, tint, surface, shining, features.needs, found, 1.0, len(table), len(points))
        lit: Array = found.to_host()[:, :3].copy()
        return lit

    def look_up(self, texture: Texture, uv: Array) -> Array:
        """Return the colors (K, 3) of the stage `bilerp` at uv (K, 2), float64."""
        return Lookup(self.device, texture)(uv)

    def through_file(self, channels: dict[str, Array], **options: Any) -> tuple[dict[str, Array], list[str]]:
        """Write channels as EXR and read them back; return them and the writer's warnings."""
        path = self.folder / "case.exr"
        try:
            warnings = exr.write(path, channels, **options)
            return exr.read(path)[0], list(warnings)
        finally:
            path.unlink(missing_ok=True)


def _coefficients(given: dict[str, float]) -> dict[str, Array]:
    """Return the coefficients (3,) of TERMS; without those given kd and ks are 1, others 0."""
    return {name: np.full(3, given.get(name, float(name in ("kd", "ks")))) for name in TERMS}


def _four(vectors: Array) -> Array:
    wide = np.zeros((len(vectors), 4), np.float32)
    wide[:, :3] = shading_tables.to_real(vectors)
    return wide


@dataclass(frozen=True)
class Case:
    """One named case.

    number: in the list of cases, an integer and perhaps a letter. title: what is stressed. expected: what a correct
    renderer does. run: runs the case. slow: takes more than two seconds or builds further programs.
    """

    number: str
    name: str
    title: str
    expected: str
    run: Callable[[Bench], Outcome]
    slow: bool = False


def wrong_pixels(found: Array, expected: Array, detail: str = "") -> Outcome:
    """Compare two images of ids (M, N), which must agree exactly."""
    return Outcome(int((found != expected).sum()), detail=detail, pictures=(found, expected))


def against_oracle(frame: Frame, expected: OracleFrame | None = None, *, colors: bool = True) -> Outcome:
    """Compare a frame with the oracle: ids and coverage exactly except for proven depth ties, depths within their
    roundings, colors within BOUNDS.

    Pixels at a highlight's gate may be off by that highlight.
    """
    if expected is None:
        expected = oracle.render(frame.scene, frame.settings)
    different, unproven = oracle_bounds.different_ids(frame["id"], expected, frame.scene, frame.settings)
    bad = (
        unproven
        | oracle_bounds.alpha_differs(frame.alpha, expected, BOUNDS, frame.settings.precision)
        | ~np.isfinite(frame.rgb).all(axis=-1)
    )
    bad |= ~different & ~(oracle_bounds.depth_errors(frame["Z"], expected) <= oracle_bounds.DEPTH_ROUNDINGS)
    if not colors:
        return Outcome(int(bad.sum()), pictures=(frame["id"], expected.id))
    measured = color_outcome(frame.rgb, expected, skip=different)
    pictures = (frame["id"], expected.id) if unproven.any() else measured.pictures
    return replace(measured, wrong=measured.wrong + int(bad.sum()), pictures=pictures)


def color_outcome(rgb: Array, expected: OracleFrame, skip: Array | None = None, limit: float = BOUNDS) -> Outcome:
    """Measure the errors of colors (M, N, 3) in bounds; colors that are not finite are wrong, and errors explained by a
    highlight at its gate are not counted."""
    error, ratio = oracle_bounds.color_errors(rgb, expected)
    seen = np.ones(ratio.shape, bool) if skip is None else ~skip
    bad = seen & ~(np.isfinite(rgb).all(axis=-1) & np.isfinite(ratio))
    measured = seen & ~oracle_bounds.excepted_at_gates(rgb, expected, limit) & np.isfinite(ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        roundings = np.where(error > 0.0, error / expected.budget, 0.0).max(axis=-1) / oracle_bounds.HALF_ULP
    return Outcome(
        int(bad.sum()),
        float(ratio[measured].max(initial=0.0)),
        limit,
        "bounds",
        float(roundings[measured].max(initial=0.0)),
        pictures=(rgb, expected.rgb),
    )


def expected_light(points: Array, normals: Array, lights: tuple[Array, Array], n: float, **k: float) -> OracleFrame:
    """Return the expected result of `Bench.light` for white points, as an image of one row."""
    p, m, positions, intensities = (np.asarray(a, np.float64) for a in (points, normals, *lights))
    eye, count = np.zeros(3), len(p)
    surface = Surface(np.float64(n), k=_coefficients(k))
    around, steepness = (np.abs(p).max(axis=1), np.ones(count)), shade.steepness(p, m, surface, eye, positions)
    return OracleFrame(
        rgb=shade.reflected(p, m, eye, surface, positions, intensities)[None],
        alpha=np.ones((1, count)),
        id=np.ones((1, count), np.uint32),
        Z=np.ones((1, count)),
        budget=np.broadcast_to(shade.budget(np.ones(3), surface, intensities), (1, count, 3)),
        conditions=shade.conditions(p, *around, eye, positions, steepness=steepness)[None],
        jump=shade.jumps(p, m, *around, surface, eye, positions, intensities)[None],
        exponent=np.full((1, count), n),
        alpha_error=np.zeros((1, count)),
        unsure=np.zeros((1, count), bool),
    )
