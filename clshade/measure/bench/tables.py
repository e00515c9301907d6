"""The results of `bench` as tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...base.text_tables import digits
from ...errors import ClshadeError
from ..report.study import machine
from ..results import Column, Results, Table
from ..timing import Spread
from .agreement import Agreement
from .device_peaks import Peaks
from .frame_timing import LIGHT_FLOPS, PIXEL_FLOPS, FrameTiming
from .starting import Start

MIB = 2.0**20
FRAME_NOTES = (
    "ms: median of frames, from the call to the float32 RGBA image in NumPy memory that is used again; the camera moves a "
    "little before every frame",
    "bytes: what cannot be avoided, a lower bound: the scene's arrays as they lie on the device read once, the image "
    "written once; of copy: share of what a kernel that copies memory reaches on the device, reads and writes counted",
    f"flops: Phong's model at the covered pixels, an fma counted as two ({PIXEL_FLOPS} and {LIGHT_FLOPS} a light), textures "
    "not counted; of peak: share of what independent fma reach on the device",
    "floor: the bytes at the rate at which a kernel fills memory past the caches, or the flops at the peak rate, whichever "
    "takes longer",
)
AGAINST_NOTES = (
    "inside: share of covered pixels whose neighbors show the same triangle; off by: largest difference there, of the "
    "largest value, and what is allowed; others: share of the other pixels whose color lies within the range of our 3x3 "
    "pixels around",
    "turns: ours and theirs alternate, each five frames in a row, of which one more comes first and is not counted, for it "
    "finds cold caches and sleeping threads; 95 %: bootstrap interval of the ratio of medians over turns",
)


class Compared(NamedTuple):
    """Frame times of OpenGL and ours in ms, drawn in turns. interval: 95 % interval of the ratio."""

    title: str
    ours: Spread
    theirs: Spread
    turns: int
    interval: tuple[float, float]
    agreement: Agreement

    @property
    def ratio(self) -> float | None:
        """How many times as fast as OpenGL; None if the images differ."""
        return self.theirs.median / self.ours.median if self.agreement.same else None


@dataclass(frozen=True)
class Timed:
    """A scene's frame times."""

    name: str
    drawn: FrameTiming
    compared: Compared | None = None

    def __str__(self) -> str:
        said = f"{self.name}: {self.drawn.ms:.2f} ms"
        if self.compared is None:
            return said
        ratio = self.compared.ratio
        return f"{said}; {'OpenGL draws another picture' if ratio is None else f'{_number(ratio)} times as fast as OpenGL'}"


def _text(form: str) -> Callable[[Any], str]:
    return lambda value: format(value, form)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f} %"


def _range(ends: Sequence[float]) -> str:
    return f"{digits(ends[0])} to {digits(ends[-1])}"


def _number(value: float | None) -> str:
    """Format with three digits or more, without an exponent."""
    return digits(value) if value is None or abs(value) < 1000.0 else f"{value:,.0f}"


def _mebibytes(count: float | None) -> str:
    return "-" if count is None else _number(count / MIB)


NAME = Column("name", "name", lambda each: each.name, str)
AGAINST = (
    Column("its ms", "other_ms", lambda each: each.compared.theirs.median, _text(".2f")),
    Column("our ms", "our_ms", lambda each: each.compared.ours.median, _text(".2f")),
    Column("turns", "turns", lambda each: each.compared.turns, str),
    Column("times as fast", "ratio", lambda each: each.compared.ratio, _number),
    Column("95 %", "", lambda each: each.compared.interval, _range),
    Column("", "ratio_low", lambda each: each.compared.interval[0]),
    Column("", "ratio_high", lambda each: each.compared.interval[1]),
    Column("inside", "interior", lambda each: each.compared.agreement.interior, _percent),
    Column("off by", "largest", lambda each: each.compared.agreement.largest, lambda value: digits(value, 2)),
    Column("of", "tolerance", lambda each: each.compared.agreement.tolerance, lambda value: digits(value, 2)),
    Column("others", "others", lambda each: each.compared.agreement.others, lambda value: f"{100.0 * value:.3f} %"),
    Column("same picture", "same", lambda each: each.compared.agreement.same, lambda same: "yes" if same else "NO"),
)
STARTS = (
    Column("kernel cache", "cache", lambda each: each.cache, str),
    Column("s", "seconds", lambda each: each.seconds.median, _text(".2f")),
    Column("half of them", "quartiles", lambda each: each.seconds[::2], _range),
    Column("rounds", "rounds", lambda each: each.rounds, str),
)


def _frames(peaks: Peaks) -> list[Column]:
    def of_drawn(title: str, name: str, value: Callable[[FrameTiming], Any], show: Callable[[Any], str]) -> Column:
        return Column(title, name, lambda each: value(each.drawn), show)

    def rate(title: str, name: str, count: Callable[[FrameTiming], float | None], unit: float) -> Column:
        """Return a column of what is done per second, in some unit; None is counted for nothing."""

        def value(drawn: FrameTiming) -> float | None:
            counted = count(drawn)
            return None if counted is None else counted / drawn.ms * 1e3 / unit

        return of_drawn(title, name, value, _percent if name.endswith("share") else digits)

    return [
        NAME,
        of_drawn("image", "", lambda drawn: drawn.resolution, lambda size: "{}x{}".format(*size)),
        of_drawn("", "columns", lambda drawn: drawn.resolution[0], str),
        of_drawn("", "rows", lambda drawn: drawn.resolution[1], str),
        of_drawn("triangles", "triangles", lambda drawn: drawn.triangles, _text(",")),
        of_drawn("covered", "", lambda drawn: drawn.covered / math.prod(drawn.resolution), _percent),
        of_drawn("", "covered", lambda drawn: drawn.covered, str),
        of_drawn("ms", "ms", lambda drawn: drawn.ms, _text(".2f")),
        of_drawn("half of them", "", lambda drawn: drawn.frame_ms, _range),
        of_drawn("", "ms_low", lambda drawn: drawn.frame_ms.low, digits),
        of_drawn("", "ms_high", lambda drawn: drawn.frame_ms.high, digits),
        of_drawn("frames", "frames", lambda drawn: drawn.frames, str),
        rate("Mtri/s", "mtri_s", lambda drawn: drawn.triangles, 1e6),
        rate("Mpix/s", "mpix_s", lambda drawn: drawn.covered, 1e6),
        rate("GB/s", "gb_s", lambda drawn: drawn.bytes, 1e9),
        rate("of copy", "copy_share", lambda drawn: drawn.bytes, peaks.copy),
        rate("GFlop/s", "gflops", lambda drawn: drawn.flops, 1e9),
        rate("of peak", "flops_share", lambda drawn: drawn.flops, peaks.flops),
        of_drawn("floor ms", "floor_ms", lambda drawn: drawn.floor_ms(peaks), digits),
        of_drawn("times it", "floors", lambda drawn: drawn.ms / drawn.floor_ms(peaks), digits),
        of_drawn("held MiB", "held_bytes", lambda drawn: sum(drawn.held.values()), _mebibytes),
    ]


def _split(
    timed: Sequence[Timed], parts: Callable[[Timed], Mapping[str, float]], show: Callable[[Any], str]
) -> list[Column]:
    """Return columns of the parts by name; a dash where a scene has none."""
    names = dict.fromkeys(name for each in timed for name in parts(each))
    ordered = sorted(names, key=lambda name: name == "host")  # the rest comes last

    def part(name: str) -> Callable[[Timed], float | None]:
        return lambda each: parts(each).get(name)

    return [NAME, *(Column(name, name, part(name), show) for name in ordered)]


def results(
    device: str, peaks: Peaks, timed: Sequence[Timed], starts: Sequence[Start], errors: Mapping[str, ClshadeError]
) -> Results:
    """Return all tables. errors: by the name of what could not be measured."""
    facts = {
        "device": device,
        "machine": machine(),
        "peaks": "copy {:.1f} GB/s, float32 {:.0f} GFlop/s, fill {:.1f} GB/s".format(*(rate / 1e9 for rate in peaks)),
    }
    if errors:
        facts["failed"] = "; ".join(f"{name}: {error}" for name, error in errors.items())
    compared = [each for each in timed if each.compared]
    titles = dict.fromkeys(each.compared.title for each in compared if each.compared)
    hidden = [column._replace(title="") for column in AGAINST] if compared else []
    tables = (
        Table("Frames", [*_frames(peaks), *hidden], timed, notes=FRAME_NOTES),
        Table("Stages", _split(timed, lambda each: each.drawn.stages, _number), timed, about="ms"),
        Table("Bytes held", _split(timed, lambda each: each.drawn.held, _mebibytes), timed, about="MiB on the device"),
        Table("Against OpenGL", [NAME, *AGAINST], compared, about=", ".join(titles), notes=AGAINST_NOTES),
        Table("Start-up", STARTS, starts),
    )
    return Results("Speed", facts, [table for table in tables if table.records], {"rates": peaks._asdict()})
