"""Assertions that a frame agrees with the float64 oracle; each raises AssertionError with the first bad pixel.

A frame here is any object with `.rgb` (M, N, 3), `.alpha` (M, N), `frame["id"]` and `frame["Z"]` (M, N), row 0 at the top,
such as `clshade.pipeline.frame.Frame`. Shape, type and finiteness are checked before any value.
"""

import os
import re
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clshade import oracle
from clshade.base.arrays import Array, Bools
from clshade.images import png
from clshade.images.layers import LAYER_TABLE
from clshade.images.tonemap import tonemap
from clshade.measure.check import oracle_bounds
from clshade.measure.check.layer_bounds import layer_errors
from clshade.oracle import OracleFrame, OracleLayers
from clshade.scene.model import Scene, Settings


class Agreement(NamedTuple):
    """bounds: the largest error of a color that is not excepted, in bounds. ties: (M, N) bool, pixels excepted for a depth
    tie or by the caller. gates: (M, N) bool, pixels excepted because rounding may open or close a highlight."""

    bounds: float
    ties: Bools
    gates: Bools


def fail(what: str, bad: Array, *columns: tuple[str, Array]) -> AssertionError:
    """Build an error with the number of bad pixels (M, N), the values at the first, and the folder with pictures of the
    first two columns."""
    where = tuple(int(i) for i in np.argwhere(bad)[0])
    values = ", ".join(f"{name} {np.asarray(array)[where].tolist()}" for name, array in columns)
    more = f"; see {write_pictures(*(array for _, array in columns[:2]))}" if len(columns) > 1 else ""
    return AssertionError(f"{what}: {int(bad.sum())} of {bad.size}; first at row, column {where}: {values}{more}")


def write_pictures(picture: Array, reference: Array) -> str:
    """Write picture.png, reference.png and difference.png, brightened so that the largest one is 1, to a folder of the
    test, and return their names."""
    test = re.sub(r"\W+", "_", os.environ.get("PYTEST_CURRENT_TEST", "")).removesuffix("_call_")[:150]
    folder = Path(tempfile.gettempdir(), "clshade_differences", test)
    folder.mkdir(parents=True, exist_ok=True)
    a, b = (np.nan_to_num(np.atleast_3d(array).astype(np.float64), posinf=0.0) for array in (picture, reference))
    off, channels = np.abs(a - b), a.shape[2]
    most = 1.0 if channels > 1 else max(float(b.max()), 1.0)  # numbers and depths are shades of gray
    for name, shown in (("picture", a / most), ("reference", b / most), ("difference", off / (off.max() or 1.0))):
        rgb = np.pad(shown, ((0, 0), (0, 0), (0, 3 - channels)), "edge" if channels == 1 else "constant")
        png.write(folder / f"{name}.png", tonemap(rgb))
    return f"picture.png, reference.png and difference.png in {folder}"


def assert_array(
    name: str, value: Any, shape: tuple[int, ...], dtype: Any, finite: bool = True, nan: bool = False
) -> None:
    """Assert a NumPy array of exactly this shape and type, without infinity if `finite`, and without NaN unless `nan`."""
    if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype != np.dtype(dtype):
        description = f"{value.shape} {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__
        raise AssertionError(f"{name}: expected an array {shape} {np.dtype(dtype)}, found {description}")
    bad = np.isinf(value) if nan else ~np.isfinite(value) if finite else np.isnan(value)
    if bad.any():
        raise fail(f"{name}: not finite" if finite else f"{name}: NaN", bad, (name, value))


def assert_same_ids(
    frame: Any, oracle: OracleFrame, scene: Scene, settings: Settings, *, skip: Array | None = None
) -> Array:
    """Assert that owners and coverage are exactly the oracle's. Returns the excepted pixels, (M, N) bool.

    With visibility `depth` the owner may differ where both faces cover the pixel at depths within DEPTH_TIE.
    skip: (M, N) bool, further pixels to except.
    """
    ids, expected, dtype = frame["id"], oracle.id, oracle_bounds.real_of(settings)
    assert_array("id", ids, expected.shape, np.uint32)
    assert_array("alpha", frame.alpha, expected.shape, dtype)
    different, unproven = oracle_bounds.different_ids(ids, oracle, scene, settings)
    bad = oracle_bounds.alpha_differs(frame.alpha, oracle, oracle_bounds.allowed(scene, settings), settings.precision)
    if skip is not None:
        different, unproven, bad = different | skip, unproven & ~skip, bad & ~skip
    if unproven.any():
        raise fail("ids differ", unproven, ("id", ids), ("expected", expected))
    if bad.any():
        raise fail("alpha differs", bad, ("alpha", frame.alpha), ("expected", oracle.alpha))
    return different


def assert_colors_within(rgb: Array, oracle: OracleFrame, factor: float = 32.0, **options: Any) -> float:
    """Assert that colors differ from the oracle's by at most `factor` bounds. Returns the largest error in bounds."""
    return _colors_agree(rgb, oracle, factor, **options).bounds


def _colors_agree(
    rgb: Array,
    oracle: OracleFrame,
    factor: float,
    *,
    dtype: Any = np.float32,
    precision: str = "float32",
    gate_fraction: float = 0.01,
    skip: Array | None = None,
) -> Agreement:
    """gate_fraction: at most this fraction of the covered pixels may be off by a highlight, where the oracle reports that
    rounding may open or close it. skip: (M, N) bool, pixels to exclude (proven depth ties)."""
    assert_array("rgb", rgb, oracle.rgb.shape, dtype)
    skip = np.zeros(oracle.id.shape, bool) if skip is None else skip
    ratio = oracle_bounds.color_errors(rgb, oracle, precision)[1]
    jumps = ~skip & oracle_bounds.excepted_at_gates(rgb, oracle, factor, precision)
    if jumps.sum() > gate_fraction * max(1, int(np.count_nonzero(oracle.alpha))):
        raise fail("too many colors excepted at a gate", jumps, ("rgb", rgb), ("expected", oracle.rgb))
    bad = ~skip & ~jumps & (ratio > factor)
    if bad.any():
        columns = ("rgb", rgb), ("expected", oracle.rgb), ("bounds", ratio), ("kappa", oracle.kappa)
        raise fail(f"colors off by more than {factor:g} bounds", bad, *columns)
    return Agreement(float(ratio[~skip & ~jumps].max(initial=0.0)), skip, jumps)


def assert_frame(
    frame: Any,
    oracle: OracleFrame,
    scene: Scene,
    settings: Settings,
    factor: float | None = None,
    *,
    skip: Array | None = None,
    **options: Any,
) -> Agreement:
    """Assert that ids, coverage, depths and colors of a frame agree with the oracle's: depths within as many roundings as
    the type allows, and +inf exactly in the background.

    factor: the color bounds allowed; None: as `allowed`. skip, options: as of `_colors_agree`.
    """
    dtype, precision = oracle_bounds.real_of(settings), settings.precision
    factor = oracle_bounds.allowed(scene, settings) if factor is None else factor
    ties = assert_same_ids(frame, oracle, scene, settings, skip=skip)
    Z = frame["Z"]
    assert_array("Z", Z, oracle.Z.shape, dtype, finite=False)
    bad = ~ties & (oracle_bounds.depth_errors(Z, oracle) > oracle_bounds.depth_roundings(Z))
    if bad.any():
        raise fail("depths off by more than the allowed roundings", bad, ("Z", Z), ("expected", oracle.Z))
    assert_array("rgb", frame.rgb, oracle.rgb.shape, dtype)
    off = oracle_bounds.color_errors(frame.rgb, oracle, precision)[1] > factor
    if settings.samples > 1:
        ties = ties | oracle_bounds.depth_ties(scene, settings, off & ~ties)
    ties = ties | (oracle.unsure & off)
    return _colors_agree(frame.rgb, oracle, factor, dtype=dtype, precision=precision, skip=ties, **options)


def assert_drawn(frame: Any, factor: float | None = None, **options: Any) -> Agreement:
    """Assert that a frame agrees with what the oracle makes of its scene and settings; see `assert_frame`."""
    expected = oracle.render(frame.scene, frame.settings)
    return assert_frame(frame, expected, frame.scene, frame.settings, factor, **options)


def assert_layers(
    frame: Any, oracle: OracleLayers, scene: Scene, settings: Settings, *, skip: Array | None = None
) -> dict[str, float]:
    """Assert that all layers except Z and id are within their bounds.

    Returns the largest error of each, relative to the bound. skip: (M, N) bool, pixels to exclude.
    """
    errors = {}
    layers = {name: frame[name] for name in frame.layers if name not in ("Z", "id")}
    for name, value in layers.items():
        dtype = LAYER_TABLE[name].dtype(oracle_bounds.real_of(settings))
        assert_array(name, value, getattr(oracle, name).shape, dtype, nan=name == "scalar")
    for name, error in layer_errors(layers, oracle, scene, settings).items():
        bad = ~(error <= 1.0) if skip is None else ~(error <= 1.0) & ~skip
        if bad.any():
            raise fail(
                f"{name} differs", bad, (name, layers[name]), ("expected", getattr(oracle, name)), ("bounds", error)
            )
        errors[name] = float((error if skip is None else np.where(skip, 0.0, error)).max(initial=0.0))
    return errors


def assert_all(frame: Any, **options: Any) -> Agreement:
    """Assert that a frame with all its layers agrees with what the oracle makes of its scene and settings."""
    agreement = assert_drawn(frame, **options)
    if set(frame.layers) - {"Z", "id"}:
        layers = oracle.render_layers(frame.scene, frame.settings)
        assert_layers(frame, layers, frame.scene, frame.settings, skip=agreement.ties)
    return agreement
