"""The results of `bench` as tables for the terminal, CSV, JSON and Markdown."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

from ...base import atomic_files, text_tables
from ...base.text_tables import digits
from .device_peaks import Peaks
from .frame_timing import LIGHT_FLOPS, PIXEL_FLOPS
from .results import Compared, Result, Speed, Verdict

FRAMES = (
    *("workload", "image", "triangles", "covered", "ms", "half of them", "frames"),
    *("Mtri/s", "Mpix/s", "GB/s", "of copy", "GFlop/s", "of peak", "floor ms", "times it", "peak MiB"),
)
PEERS = (
    "workload",
    "peer",
    "its ms",
    "our ms",
    "turns",
    "times as fast",
    "95 %",
    "inside",
    "off by",
    "others",
    "same picture",
)
TARGETS = ("target", "what", "found", "asked for", "kept")
STARTS = ("start-up, kernel cache", "s", "half of them", "rounds")
EXPONENTS = ("grows", "power of time", "beyond the fixed cost", "of memory beyond it")
NOTES = (
    "ms: median of frames, from the call to the float32 RGBA image in NumPy memory that is used again; the camera moves a "
    "little before every frame",
    "bytes: what cannot be avoided, a lower bound: the scene's arrays as they lie on the device read once, the image "
    "written once; of copy: share of what a kernel that copies memory reaches on the device, reads and writes counted",
    f"flops: Phong's model at the covered pixels, an fma counted as two ({PIXEL_FLOPS} and {LIGHT_FLOPS} a light), textures "
    "not counted; of peak: share of what independent fma reach on the device",
    "floor: the bytes at the rate at which a kernel fills memory past the caches, or the flops at the peak rate, whichever "
    "takes longer",
    "inside: share of covered pixels whose neighbors show the same triangle; off by: largest difference there, of the "
    "largest value, and what is allowed; others: share of the other pixels whose color lies within the range of our 3x3 "
    "pixels around",
    "turns: ours and theirs alternate, each so many frames in a row, of which one more comes first and is not counted, for "
    "it finds cold caches and sleeping threads; the scanline loop draws once, so of it: ours; 95 %: bootstrap interval of "
    "the ratio of medians over turns",
)


def _large(value: float | None) -> str:
    """Format with three digits or more, without an exponent."""
    return digits(value) if value is None or abs(value) < 1000.0 else f"{value:,.0f}"


def _percent(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.1f} %"


def _frame(result: Result, speed: Speed) -> text_tables.Row:
    drawn = result.drawn
    if drawn is None:
        return (result.workload.name, *["-"] * (len(FRAMES) - 1))
    figures = drawn.figures
    columns, rows = drawn.resolution
    low, median, high = drawn.frame_ms
    bytes_s, flops = drawn.bytes / drawn.ms * 1e3, drawn.flops / drawn.ms * 1e3
    return (
        result.workload.name,
        f"{columns}x{rows}",
        f"{drawn.triangles:,}",
        _percent(drawn.covered, columns * rows),
        f"{median:.2f}",
        f"{low:.2f} to {high:.2f}",
        str(drawn.frames),
        *(digits(figures[name]) for name in ("mtri_s", "mpix_s", "gb_s")),
        _percent(bytes_s, speed.peaks.copy),
        digits(figures["gflops"]),
        _percent(flops, speed.peaks.flops),
        digits(drawn.floor_ms(speed.peaks)),
        digits(drawn.ms / drawn.floor_ms(speed.peaks)),
        "-" if drawn.peak_mib is None else f"{drawn.peak_mib:.0f}",
    )


def _stages(speed: Speed) -> tuple[text_tables.Row, list[text_tables.Row]]:
    """Return the table of milliseconds per stage; a dash if a scene skips it."""
    drawn = [(each.workload.name, each.drawn) for each in speed.results if each.drawn]
    names = list(dict.fromkeys(name for _, each in drawn for name in each.stages))
    ordered = [name for name in names if name != "host"] + ["host"]
    rows: list[text_tables.Row] = [
        (name, *(digits(each.stages.get(stage)) for stage in ordered)) for name, each in drawn
    ]
    return ("stages, ms", *ordered), rows


def _peer(result: Result, each: Compared) -> text_tables.Row:
    same = each.agreement
    return (
        result.workload.name,
        each.peer,
        f"{each.theirs.median:.2f}",
        f"{each.ours.median:.2f}",
        f"{each.rounds} of {each.turn}",
        _large(each.ratio),
        _interval(each),
        f"{100.0 * same.interior:.1f} %",
        f"{digits(same.largest, 2)} of {digits(same.tolerance, 2)}",
        f"{100.0 * same.others:.3f} %",
        "yes" if same.same else "NO",
    )


def _interval(each: Compared) -> str:
    return "-" if each.interval is None else f"{digits(each.interval[0])} to {digits(each.interval[1])}"


def verdict_row(each: Verdict) -> text_tables.Row:
    word = {True: "yes", False: "NO", None: "-"}[each.kept]
    return (each.workload, each.what, _large(each.value), f"{'>=' if each.at_least else '<='} {_large(each.bar)}", word)


def facts(speed: Speed) -> list[str]:
    return [
        f"device   {speed.device}",
        f"machine  {speed.machine}",
        f"peaks    copy {speed.peaks.copy / 1e9:.1f} GB/s, fill {speed.peaks.fill / 1e9:.1f} GB/s, float32 "
        f"{speed.peaks.flops / 1e9:.0f} GFlop/s{_per_cycle(speed.peaks)}",
    ]


def _per_cycle(peaks: Peaks) -> str:
    """Return the peak rate per compute unit and clock cycle, which two multiply-adds per lane and cycle bound."""
    return f", {peaks.flops / peaks.cycles:.0f} a cycle and compute unit" if peaks.cycles else ""


def progress(result: Result) -> str:
    """Return the line to print as soon as a workload is done."""
    if result.drawn is None:
        return f"{result.workload.name}: not drawn: {result.failed}"
    parts = [f"{result.workload.name}: {result.drawn.ms:.2f} ms"]
    parts += [
        f"{each.peer} {each.theirs.median:.2f} ms, {_large(each.ratio)} times"
        if each.agreement.same
        else f"{each.peer} draws another picture"
        for each in result.compared
    ]
    return "; ".join(parts)


def _tables(speed: Speed, targets: bool) -> list[tuple[str, int, text_tables.Row, list[text_tables.Row]]]:
    """Return title, number of text columns, header and rows of each table that is not empty."""
    stages, stage_rows = _stages(speed)
    found: list[tuple[str, int, text_tables.Row, list[text_tables.Row]]] = [
        ("Frames", 1, FRAMES, [_frame(each, speed) for each in speed.results]),
        ("Stages", 1, stages, stage_rows),
        ("Peers", 2, PEERS, [_peer(result, each) for result in speed.results for each in result.compared]),
        ("Scaling", 1, ("grows", "size", "ms", "peak MiB"), _series(speed)),
        ("Exponents", 1, EXPONENTS, [(each.name, *map(digits, each.exponents().values())) for each in speed.series]),
        ("Start-up", 1, STARTS, _starts(speed)),
        ("Targets", 2, TARGETS, [verdict_row(each) for each in speed.verdicts()] if targets else []),
    ]
    return [each for each in found if each[3]]


def _series(speed: Speed) -> list[text_tables.Row]:
    rows: list[text_tables.Row] = []
    for series in speed.series:
        points = zip(("fixed", *(f"{size:,}" for size in series.sizes)), (series.fixed, *series.points), strict=True)
        rows += [(series.name, size, f"{each.ms:.2f}", digits(each.peak_mib, 4)) for size, each in points]
    return rows


def _starts(speed: Speed) -> list[text_tables.Row]:
    if speed.started is None:
        return []
    found = speed.started
    return [
        (name, f"{s.median:.2f}", f"{s.low:.2f} to {s.high:.2f}", str(found.rounds))
        for name, s in (("warm", found.warm), ("empty", found.empty))
    ]


def _notes(speed: Speed) -> list[str]:
    titles = dict.fromkeys(f"{c.peer}: {c.title}" for result in speed.results for c in result.compared)
    failed = [f"{each.workload.name}: {each.failed}" for each in speed.results if each.failed]
    notes = NOTES if speed.results else NOTES[:1]
    return [*notes, *titles, *speed.missing(), *failed, *speed.failed]


def lines(speed: Speed, *, targets: bool = False) -> list[str]:
    """Return the tables as lines for the terminal. targets: also what was asked for."""
    found: list[str] = []
    for _, left, header, rows in _tables(speed, targets):
        found += [*text_tables.as_lines(header, rows, left), ""]
    return [*found, *(text_tables.wrapped(note, 2) for note in _notes(speed))]


def markdown(speed: Speed, *, targets: bool = False) -> str:
    found = ["# Speed", "", *(f"- {line}" for line in facts(speed)), ""]
    for title, _, header, rows in _tables(speed, targets):
        found += [f"## {title}", "", *text_tables.as_markdown(header, rows), ""]
    return "\n".join([*found, *(f"- {note}" for note in _notes(speed)), ""])


CSV = (
    *("workload", "columns", "rows", "triangles", "covered", "frames", "ms", "ms_low", "ms_high"),
    *("mtri_s", "mpix_s", "gb_s", "copy_share", "gflops", "flops_share", "floor_ms", "peak_mib"),
    *(
        "peer",
        "peer_ms",
        "peer_ms_low",
        "peer_ms_high",
        "turn",
        "ratio",
        "ratio_low",
        "ratio_high",
        "bar",
        "interior",
        "largest",
        "others",
        "same",
    ),
)


def csv_rows(speed: Speed) -> list[text_tables.Row]:
    """Return rows in full precision: one for our frames alone, one for our frames in turns with each peer's, one for
    each size of --scaling, one for each kind of start; fields that do not apply are empty."""
    rows: list[dict[str, object]] = []
    named = [(each.workload.name, each.drawn) for each in speed.results]
    for series in speed.series:
        named += [(f"{series.name}-fixed", series.fixed)]
        named += [(f"{series.name}-{size}", each) for size, each in zip(series.sizes, series.points, strict=True)]
    for name, drawn in named:
        if drawn is None:
            continue
        low, _, high = drawn.frame_ms
        columns, height = drawn.resolution
        shares = {
            "copy_share": drawn.bytes / drawn.ms * 1e3 / speed.peaks.copy,
            "flops_share": drawn.flops / drawn.ms * 1e3 / speed.peaks.flops,
            "floor_ms": drawn.floor_ms(speed.peaks),
        }
        rows.append(
            {**vars(drawn), **drawn.figures, **shares, "workload": name, "columns": columns, "rows": height}
            | {"ms_low": low, "ms_high": high}
        )
    for result in speed.results:
        rows += [_compared_row(result, each) for each in result.compared]
    if speed.started:
        for name in ("warm", "empty"):
            low, median, high = (1e3 * seconds for seconds in getattr(speed.started, name))
            rows.append({"workload": f"start-up-{name}", "ms": median, "ms_low": low, "ms_high": high})
    return [tuple("" if row.get(name) is None else str(row[name]) for name in CSV) for row in rows]


def _compared_row(result: Result, each: Compared) -> dict[str, object]:
    ours, theirs = each.ours, each.theirs
    return {
        "workload": result.workload.name,
        "frames": each.rounds,
        "peer": each.peer,
        "turn": each.turn,
        "ratio": each.ratio,
        **dict(zip(("ratio_low", "ratio_high"), each.interval or (None, None), strict=True)),
        "bar": result.workload.ratios.get(each.peer),
        **{"ms": ours.median, "ms_low": ours.low, "ms_high": ours.high},
        **{"peer_ms": theirs.median, "peer_ms_low": theirs.low, "peer_ms_high": theirs.high},
        **each.agreement.stats(),
    }


def paths(prefix: str) -> list[Path]:
    """Return the files of a prefix: CSV, JSON, Markdown, figure."""
    return [Path(f"{prefix}.{extension}") for extension in ("csv", "json", "md", "png")]


def show(
    title: str,
    header: text_tables.Row,
    rows: Sequence[text_tables.Row],
    note: str,
    faults: Sequence[str],
    stats: dict[str, Any],
    files: Sequence[Path],
    stream: TextIO,
    *,
    left: int = 1,
) -> None:
    """Print a table of a benchmark of its own, and write it into the files: CSV, JSON and Markdown, or none.

    left: its first columns, which are aligned to the left.
    """
    lines = text_tables.as_lines(header, rows, left)
    print("\n".join([title, "", *lines, "", text_tables.wrapped(note, 2), *faults]), file=stream)
    markdown = [title, "", *text_tables.as_markdown(header, rows), "", note, *(f"- {fault}" for fault in faults)]
    texts = (text_tables.as_csv(header, rows), json.dumps(stats, indent=2) + "\n", "\n".join(markdown) + "\n")
    for path, text in zip(files, texts, strict=False):
        atomic_files.write_bytes(path, text.encode())
        print(f"wrote {atomic_files.shown(path)}", file=stream)


def write(speed: Speed, prefix: str, *, targets: bool = False) -> list[Path]:
    """Write the first three of `paths`; return all four. targets: as for `lines`."""
    texts = (
        text_tables.as_csv(CSV, csv_rows(speed)),
        json.dumps(speed.stats(), indent=2) + "\n",
        markdown(speed, targets=targets),
    )
    found = paths(prefix)
    for path, text in zip(found, texts, strict=False):
        atomic_files.write_bytes(path, text.encode())
    return found
