"""The results of `bench` as tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ...base.text_tables import digits
from ...errors import ClshadeError
from ..report.study import machine
from ..results import Column, Results, Table
from .device_peaks import Peaks
from .frame_timing import LIGHT_FLOPS, PIXEL_FLOPS, FrameTiming

MIB = 2.0**20
FRAME_NOTES = (
    "ms: median of frames, from the call to the float32 RGBA image in NumPy memory that is used again, and its quartiles; "
    "the camera moves a little before every frame",
    "GB/s: of what cannot be avoided, a lower bound: the scene's arrays as they lie on the device read once, the image "
    "written once",
    f"GFlop/s: of Phong's model at the covered pixels, an fma counted as two ({PIXEL_FLOPS} and {LIGHT_FLOPS} a light), "
    "textures not counted",
    "floor: the bytes at the rate at which a kernel fills memory past the caches, or the flops at the peak rate, whichever "
    "takes longer",
)
AGAINST_NOTES = (
    "inside: share of covered pixels whose neighbors show the same triangle; off by: largest difference there, of the "
    "largest value, and what is allowed; others: share of the other pixels whose color lies within the range of our 3x3 "
    "pixels around",
    "turns: ours and theirs alternate, six frames each; the first, which finds cold caches and sleeping threads, is not "
    "counted; the ratio of medians over turns has its 95 % interval by bootstrap",
)


def _text(form: str) -> Callable[[Any], str]:
    return lambda value: format(value, form)


def _number(value: float | None) -> str:
    """Format with three digits or more, without an exponent."""
    return digits(value) if value is None or abs(value) < 1000.0 else f"{value:,.0f}"


def _mebibytes(count: float | None) -> str:
    return "-" if count is None else _number(count / MIB)


NAME = Column("name", "name", lambda each: each.name, str)
AGAINST = (
    Column("OpenGL's ms", "other_ms", lambda timed: timed.compared.theirs, _text(".2f")),
    Column("our ms", "our_ms", lambda timed: timed.compared.ours, _text(".2f")),
    Column("turns", "turns", lambda timed: timed.compared.turns, str),
    Column("times as fast", "ratio", lambda timed: timed.compared.ratio, _number),
    Column("2.5 %", "ratio_low", lambda timed: timed.compared.interval[0]),
    Column("97.5 %", "ratio_high", lambda timed: timed.compared.interval[1]),
    Column("inside", "interior", lambda timed: timed.compared.agreement.interior, _text(".1%")),
    Column("off by", "largest", lambda timed: timed.compared.agreement.largest, _text(".2g")),
    Column("of", "tolerance", lambda timed: timed.compared.agreement.tolerance, _text(".2g")),
    Column("others", "others", lambda timed: timed.compared.agreement.others, _text(".3%")),
    Column("same picture", "same", lambda timed: timed.compared.agreement.same, lambda same: "yes" if same else "NO"),
)


def _frames(peaks: Peaks) -> list[Column]:
    def rate(title: str, name: str, count: Callable[[FrameTiming], float], unit: float) -> Column:
        return Column(title, name, lambda timed: count(timed) / timed.ms.median * 1e3 / unit)

    return [
        NAME,
        Column("image", "image", lambda timed: "{}x{}".format(*timed.resolution), str),
        Column("triangles", "triangles", lambda timed: timed.triangles, _text(",")),
        Column("covered", "covered", lambda timed: timed.covered, _text(",")),
        Column("ms", "ms", lambda timed: timed.ms.median, _text(".2f")),
        Column("25 %", "ms_low", lambda timed: timed.ms.low),
        Column("75 %", "ms_high", lambda timed: timed.ms.high),
        Column("frames", "frames", lambda timed: timed.frames, str),
        rate("Mtri/s", "mtri_s", lambda timed: timed.triangles, 1e6),
        rate("Mpix/s", "mpix_s", lambda timed: timed.covered, 1e6),
        rate("GB/s", "gb_s", lambda timed: timed.bytes, 1e9),
        Column("GFlop/s", "gflops", lambda timed: timed.flops and timed.flops / timed.ms.median / 1e6),
        Column("floor ms", "floor_ms", lambda timed: timed.floor_ms(peaks)),
        Column("times it", "floors", lambda timed: timed.ms.median / timed.floor_ms(peaks)),
        Column("held MiB", "held_bytes", lambda timed: sum(timed.held.values()), _mebibytes),
    ]


def _split(
    timed: Sequence[FrameTiming], parts: Callable[[FrameTiming], Mapping[str, float]], show: Callable[[Any], str]
) -> list[Column]:
    """Return columns of the parts by name; a dash where a scene has none."""
    names = dict.fromkeys(name for each in timed for name in parts(each))
    ordered = sorted(names, key=lambda name: name == "host")  # the rest comes last

    def part(name: str) -> Callable[[FrameTiming], float | None]:
        return lambda each: parts(each).get(name)

    return [NAME, *(Column(name, name, part(name), show) for name in ordered)]


def results(device: str, peaks: Peaks, timed: Sequence[FrameTiming], errors: Mapping[str, ClshadeError]) -> Results:
    """Return all tables. errors: by the name of what could not be measured."""
    rates = "float32 {:.0f} GFlop/s, fill {:.1f} GB/s".format(*(rate / 1e9 for rate in peaks))
    facts = {"device": device, "machine": machine(), "peaks": rates}
    columns, notes = _frames(peaks), [*FRAME_NOTES]
    titles = dict.fromkeys(row.compared.title for row in timed if row.compared)
    if titles:
        facts["against"] = ", ".join(titles)
        columns, notes = [*columns, *AGAINST], [*notes, *AGAINST_NOTES]
    if errors:
        facts["failed"] = "; ".join(f"{name}: {error}" for name, error in errors.items())
    tables = (
        Table("Frames", columns, timed, notes=notes),
        Table("Stages", _split(timed, lambda row: row.stages, _number), timed, about="ms"),
        Table("Bytes held", _split(timed, lambda row: row.held, _mebibytes), timed, about="MiB on the device"),
    )
    return Results("Speed", facts, tables, {"rates": peaks._asdict()})
