"""The results of `report` as tables for the terminal, CSV, JSON and Markdown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from ...base import atomic_files, text_tables
from ...base.text_tables import digits
from ...images.metrics import has_flip
from ...scene.model import Scene, Settings
from ...scene.settings import PRESETS, Preset
from . import sizes
from .measure import Measured
from .model_errors import SAMPLES as MODEL_SAMPLES
from .power_law import Power
from .study import Study

VARIANTS = (
    *("variant", "ms", "half of them", "RMSE", "sampling", "model", "relMSE", "PSNR", "FLIP"),
    *("arithmetic", "its RMS", "bounds", "wrong", "build ms", "upload ms"),
)
NO_FLIP = (
    "FLIP: not measured, flip-evaluator is not installed (pip install flip-evaluator, or clshade's extra `report`)"
)


def _variant(each: Measured, mark: str) -> text_tables.Row:
    low, median, high = each.frame_ms
    close, exact = each.approximation, each.arithmetic
    return (
        f"{each.name}{mark}",
        f"{median:.2f}",
        f"{low:.2f} to {high:.2f}",
        digits(close.rmse),
        digits(each.sampling),
        digits(each.model) if each.model > 0.0 else "-",
        digits(close.relmse),
        f"{close.psnr:.1f}",
        digits(close.flip),
        digits(exact.error, 2),
        digits(exact.rms, 2),
        f"{digits(exact.bounds, 2)} of {exact.allowed:g}",
        f"{exact.wrong} of {exact.pixels:,}",
        f"{each.build_ms:.0f}",
        f"{each.upload_ms:.0f}",
    )


CAUSES = ("cause", "RMSE", "share", "of the PNG's")
WHERE_FROM = (
    "Error of the image that `render` draws, by cause: RMSE of each alone; share of the total's mean square, negative where "
    "it makes up for others"
)


def _causes(study: Study) -> list[text_tables.Row]:
    def percent(share: float | None) -> str:
        return "-" if share is None else f"{round(100.0 * share, 1) + 0.0:.1f} %"

    return [
        (part.cause, digits(part.rmse), percent(part.share), percent(part.png_share))
        for part in study.decomposition.parts
    ]


FORMATS = ("format", "write ms", "half of them", "kB", "RMSE", "largest")


def _formats(study: Study) -> list[text_tables.Row]:
    return [
        (
            each.name,
            f"{each.write_ms.median:.1f}",
            f"{each.write_ms.low:.1f} to {each.write_ms.high:.1f}",
            f"{each.bytes / 1e3:.0f}",
            digits(each.rmse),
            digits(each.largest),
        )
        for each in study.kept
    ]


def _tessellation(study: Study) -> tuple[text_tables.Row, list[text_tables.Row]]:
    found = study.tessellation
    errors = zip(*found.errors.values(), strict=True)
    rows: list[text_tables.Row] = [
        (f"{count:,}", *map(digits, each)) for count, each in zip(found.triangles, errors, strict=True)
    ]
    rows.append(("slope", *(str(found.slope(shader)) for shader in found.errors)))
    return ("triangles", *found.errors), rows


def _variants(study: Study) -> list[text_tables.Row]:
    best, tied = study.front, [each for group in study.ties for each in group]
    return [_variant(each, " *=" if each in tied else " *" if each in best else "") for each in study.measured]


def _facts(study: Study) -> list[str]:
    return [
        f"scene      {study.title}",
        f"device     {study.device}",
        f"machine    {study.machine}",
        f"reference  {study.reference.about()}",
    ]


NOTES = (
    "* marks the Pareto front: nothing else is measurably better in time or error, and no worse in the other; lower errors "
    "are more accurate",
    "RMSE to FLIP: approximation, against the reference; display white is 1; sampling: of that, what finer sampling of the "
    f"same model would cure; model: what it would not, against the best model with the same {MODEL_SAMPLES} samples",
    "arithmetic: the largest |value - oracle| / light of pixels computed again in float64 with the same settings; its RMS; "
    "the largest in bounds, and how many are allowed; pixels of wrong coverage, of so many looked at: all, or a stratified "
    "sample, the smaller the more samples each pixel has, so that largest and RMS of two variants may be of other pixels",
)
SPHERE = (
    "RMSE of a sphere against one of {:,} triangles, where both cover a pixel; slope: power of the number of triangles"
)


def _notes(study: Study) -> list[str]:
    return [*NOTES, *_ties(study), *_sampling(study), *([] if has_flip() else [NO_FLIP])]


def _ties(study: Study) -> list[str]:
    return [
        f"= {', '.join(each.name for each in group)} are ties: medians within the middle half of the other's frames, errors "
        f"within {study.reference.error:.2g}"
        for group in study.ties
    ]


def _sampling(study: Study) -> list[str]:
    return [
        f"{name}: RMSE falls as the number of samples to the power {each.by_samples}, as the time of a frame to "
        f"{each.by_time}, to 1/{each.gain:.3g} altogether; {expected(each.by_samples, LAWS[name])}"
        for name, each in study.sampling().items()
    ]


class Law(NamedTuple):
    """An exponent that theory gives, of what, and why errors may fall slower or faster; "" if nothing suggests it."""

    exponent: float
    of: str
    slower: str = ""
    faster: str = ""


LAWS = {
    "samples": Law(-0.75, "edges in each pixel", "textures and light are looked up once, and their aliasing stays"),
    "shaded": Law(-0.75, "edges in each pixel", faster="light and textures vary smoothly in a pixel"),
}
SMOOTH = Law(-1.0, "second order in the length of edges", "coarse spheres miss the highlight")


def _order(study: Study) -> list[str]:
    found = study.tessellation
    return [f"{shader}: {expected(found.slope(shader), SMOOTH)}" for shader in found.errors]


def expected(found: Power, law: Law) -> str:
    """Return the exponent expected; if the one found differs, that it does, and why that may be."""
    said = f"expected {law.exponent:g}, that of {law.of}"
    if found.contains(law.exponent):
        return said
    slower = found.exponent > law.exponent
    why = law.slower if slower else law.faster
    return f"{said}; it falls {'slower' if slower else 'faster'}{f': {why}' if why else ''}"


SIZES = (
    "Growing images: times and errors against the converged image of the same size; power: of the number of pixels, with "
    "what 95 % of resampled frames, windows and the reference leave open at these sizes"
)


def _sizes(study: Study, *, markdown: bool) -> list[str]:
    found = study.growths
    if not found:
        return []
    said = sizes.statements(found)
    if markdown:
        table = text_tables.as_markdown(sizes.header(found), sizes.rows(found))
        return ["", "## Sizes", "", f"{SIZES}.", "", *table, "", *(f"- {line}" for line in said)]
    table = text_tables.as_lines(sizes.header(found), sizes.rows(found))
    return ["", text_tables.wrapped(SIZES, 2), *table, *(text_tables.wrapped(line, 2) for line in said)]


def lines(study: Study) -> list[str]:
    """Return the tables as lines for the terminal."""
    header, rows = _tessellation(study)
    return [
        *(text_tables.wrapped(fact, 11) for fact in _facts(study)),
        "",
        *text_tables.as_lines(VARIANTS, _variants(study)),
        *(text_tables.wrapped(note, 2) for note in _notes(study)),
        "",
        text_tables.wrapped(WHERE_FROM, 2),
        *text_tables.as_lines(CAUSES, _causes(study)),
        *(text_tables.wrapped(line, 2) for line in study.decomposition.lines()),
        "",
        text_tables.wrapped(SPHERE.format(study.tessellation.finest), 2),
        *text_tables.as_lines(header, rows),
        *(text_tables.wrapped(line, 2) for line in _order(study)),
        "",
        *text_tables.as_lines(FORMATS, _formats(study)),
        *_sizes(study, markdown=False),
    ]


def markdown(study: Study, used: str) -> str:
    header, rows = _tessellation(study)
    return "\n".join(
        [
            "# Error against run time",
            "",
            *(f"- {line[:9].strip()}: {line[11:]}" for line in _facts(study)),
            *([f"- {used}"] if used else []),
            "",
            *text_tables.as_markdown(VARIANTS, _variants(study)),
            "",
            *(f"- {note}" for note in _notes(study)),
            "",
            "## Where the error comes from",
            "",
            f"{WHERE_FROM}.",
            "",
            *text_tables.as_markdown(CAUSES, _causes(study)),
            "",
            *(f"- {line}" for line in study.decomposition.lines()),
            "",
            "## Tessellation",
            "",
            SPHERE.format(study.tessellation.finest) + ".",
            "",
            *text_tables.as_markdown(header, rows),
            "",
            *(f"- {line}" for line in _order(study)),
            "",
            "## Output formats",
            "",
            *text_tables.as_markdown(FORMATS, _formats(study)),
            *_sizes(study, markdown=True),
            "",
        ]
    )


CSV = (
    *(
        "study",
        "name",
        "settings",
        "ms",
        "ms_low",
        "ms_high",
        "build_ms",
        "upload_ms",
        "rmse",
        "sampling",
        "model",
        "share",
        "png_share",
        "relmse",
        "psnr",
        "flip",
    ),
    *(
        "arithmetic",
        "arithmetic_rms",
        "bounds",
        "bounds_allowed",
        "wrong",
        "pixels_checked",
        "bytes",
        "largest",
        "triangles",
        "columns",
        "rows",
    ),
)


def csv_rows(study: Study) -> list[text_tables.Row]:
    """Return one row per variant, cause, format, variant and size, and sphere and shader, in full precision; fields that do
    not apply are empty."""
    rows: list[dict[str, object]] = []
    for each in study.measured:
        low, median, high = each.frame_ms
        exact = each.arithmetic
        rows.append(
            {
                "study": "variant",
                "name": each.name,
                "settings": each.variant.changed(),
                **{"ms": median, "ms_low": low, "ms_high": high},
                **{"build_ms": each.build_ms, "upload_ms": each.upload_ms, **vars(each.approximation)},
                **{"sampling": each.sampling, "model": each.model},
                **{
                    "arithmetic": exact.error,
                    "arithmetic_rms": exact.rms,
                    "bounds": exact.bounds,
                    "bounds_allowed": exact.allowed,
                },
                **{"wrong": exact.wrong, "pixels_checked": exact.pixels},
            }
        )
    for part in study.decomposition.parts:
        rows.append(
            {"study": "cause", "name": part.cause, "rmse": part.rmse, "share": part.share, "png_share": part.png_share}
        )
    for kept in study.kept:
        low, median, high = kept.write_ms
        times = {"ms": median, "ms_low": low, "ms_high": high}
        rows.append({"study": "format", **vars(kept), **times})
    for growth in study.growths:
        for point in growth.points:
            low, median, high = point.ms
            columns, height = point.resolution
            times = {"ms": median, "ms_low": low, "ms_high": high}
            rows.append(
                {
                    "study": "size",
                    "name": growth.variant.name,
                    "settings": growth.variant.changed(),
                    **times,
                    **{"rmse": point.error.rmse, "columns": columns, "rows": height},
                }
            )
    found = study.tessellation
    for shader, errors in found.errors.items():
        rows += [
            {"study": "tessellation", "name": shader, "triangles": count, "rmse": error}
            for count, error in zip(found.triangles, errors, strict=True)
        ]
    return [tuple("" if row.get(name) is None else str(row[name]) for name in CSV) for row in rows]


def write(study: Study, used: Measured | None, folder: Path) -> list[Path]:
    """Write report.csv, .json and .md. used: the variant chosen for the budget or tolerance."""
    texts = {
        "report.csv": text_tables.as_csv(CSV, csv_rows(study)),
        "report.json": json.dumps({**study.stats(), "use": used and used.name}, indent=2) + "\n",
        "report.md": markdown(study, used_line(used, study.scene) if used else ""),
    }
    for name, text in texts.items():
        atomic_files.write_bytes(folder / name, text.encode())
    return [folder / name for name in texts]


def used_line(used: Measured, scene: Scene) -> str:
    """Return a line with the options with which `render` draws the measured image."""
    options = " ".join(render_options(used.settings, scene))
    given = f"render with the same scene and camera options and {options}"
    return f"use {used.name}: {used.cost:.3g} ms, RMSE {used.error:.3g} ({given})"


def render_options(settings: Settings, scene: Scene) -> list[str]:
    """Return the options for the image's size and for the settings, relative to the scene's preset or a nearer one."""
    columns, rows = scene.camera.resolution

    def options(preset: Preset) -> list[str]:
        before = vars(Settings.from_preset(preset))
        changes = {name: value for name, value in vars(settings).items() if value != before[name]}
        parts = [] if preset == scene.preset else ["--preset", preset]
        for name, value in changes.items():
            parts += [f"--{name.replace('_', '-')}", *([] if value is True else [str(value)])]
        return parts

    return ["--resolution", f"{columns},{rows}", *min(map(options, PRESETS), key=len)]
