"""The results of `report` as CSV, in full precision."""

from __future__ import annotations

from collections.abc import Iterator

from ...base import text_tables
from ..timing import Spread, median_interval
from .power_law import Power
from .sizes import Growth
from .study import Details, Study

Record = dict[str, object]
# ms_low, ms_high hold half of the frames; the columns of `_95` are intervals of the median, those of rmse and power of 95 %
# too. of, power: a fitted power, and the power of what it is.
HEADER = (
    *("study", "name", "settings", "ms", "ms_low", "ms_high", "ms_95_low", "ms_95_high", "build_ms", "upload_ms"),
    *("rmse", "rmse_low", "rmse_high", "close", "sampling", "model", "share", "png_share", "relmse", "psnr", "flip"),
    *("arithmetic", "arithmetic_rms", "bounds", "bounds_allowed", "wrong", "pixels_checked", "bytes", "largest"),
    *("triangles", "columns", "rows", "of", "power", "power_low", "power_high", "expected"),
)


def rows(study: Study) -> list[text_tables.Row]:
    """Return one row per variant, cause, format, sphere and shader, variant and size, and fitted power; fields that do not
    apply are empty."""
    return [tuple("" if each.get(name) is None else str(each[name]) for name in HEADER) for each in _records(study)]


def _records(study: Study) -> Iterator[Record]:
    yield from _variants(study)
    if study.details:
        yield from _details(study.details)
    for family in study.families:
        name, expected = {"study": "family", "name": family.name}, {"expected": family.law.exponent}
        yield {**name, "of": f"error by {family.what}", **power_fields(family.by_size()), **expected}
        yield {**name, "of": "error by the time of a frame", **power_fields(family.by_time())}
    for growth in study.growths:
        yield from _sizes(growth)


def time_fields(ms: Spread) -> Record:
    """Return the columns of a median and of what holds half of the times."""
    return {"ms": ms.median, "ms_low": ms.low, "ms_high": ms.high}


def _interval(low: float, high: float) -> Record:
    return {"ms_95_low": low, "ms_95_high": high}


def power_fields(found: Power | None) -> Record:
    """Return the columns of a fitted power, none if there is none."""
    return {} if found is None else {"power": found.exponent, "power_low": found.low, "power_high": found.high}


def _variants(study: Study) -> Iterator[Record]:
    for each in study.measured:
        exact = each.arithmetic
        yield {
            "study": "variant",
            "name": each.variant.name,
            "settings": each.variant.changed(),
            **time_fields(each.frame_ms),
            **_interval(*each.interval),
            **{"build_ms": each.build_ms, "upload_ms": each.upload_ms, **vars(each.approximation)},
            **{"close": each.close, "sampling": each.sampling, "model": each.model},
            **{"arithmetic": exact.error, "arithmetic_rms": exact.rms, "wrong": exact.wrong},
            **{"bounds": exact.bounds, "bounds_allowed": exact.allowed, "pixels_checked": exact.pixels},
        }


def _details(details: Details) -> Iterator[Record]:
    for part in details.decomposition.parts:
        shares = {"share": part.share, "png_share": part.png_share}
        yield {"study": "cause", "name": part.cause, "rmse": part.rmse, **shares}
    for kept in details.kept:
        yield {"study": "format", **vars(kept), **time_fields(kept.write_ms)}
    found = details.tessellation
    for shader, errors in found.errors.items():
        for count, error, ms in zip(found.triangles, errors, found.ms[shader], strict=True):
            yield {"study": "tessellation", "name": shader, "triangles": count, "rmse": error, **time_fields(ms)}


def _sizes(growth: Growth) -> Iterator[Record]:
    name = {"name": growth.variant.name, "settings": growth.variant.changed()}
    for point in growth.points:
        columns, rows = point.resolution
        error = {"rmse": point.error.rmse, "rmse_low": point.error.low, "rmse_high": point.error.high}
        times = {**time_fields(point.ms), **_interval(*median_interval(point.times))}
        yield {"study": "size", **name, **times, **error, "columns": columns, "rows": rows}
    yield {"study": "size power", **name, "of": "time by the number of pixels", **power_fields(growth.time_power())}
    yield {"study": "size power", **name, "of": "error by the number of pixels", **power_fields(growth.error_power())}
