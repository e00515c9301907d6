"""The results of `report` as tables for the terminal, CSV, JSON and Markdown."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...base import atomic_files, text_tables
from ...base.declare import as_option
from ...base.text_tables import digits
from ...images.metrics import has_flip
from ...pipeline.picture import changed_fields
from ...scene.model import Scene, Settings
from ...scene.settings import PRESETS, Preset
from . import csv_table, sizes
from .answer import Command, answer, criterion
from .decomposition import Decomposition
from .families import ABOUT, Family
from .format_errors import Kept
from .measure import Measured
from .model_errors import SAMPLES as MODEL_SAMPLES
from .power_law import expected
from .prefiltering import Prefiltering
from .study import Study
from .tessellation import Tessellation


class Section(NamedTuple):
    """A table: its title; about: a sentence above it, or ""; header and rows; notes: sentences below it."""

    title: str
    about: str
    header: text_tables.Row
    rows: Sequence[text_tables.Row]
    notes: Sequence[str] = ()


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
        f"{digits(exact.bounds, 2)} of {exact.allowed:.4g}",
        f"{exact.wrong} of {exact.pixels:,}",
        f"{each.build_ms:.0f}",
        f"{each.upload_ms:.0f}",
    )


PREFILTERING = (
    "What image-based light is off by, for white metal and a white dielectric of a roughness: RMSE against quadrature over "
    "the environment itself, and relative to what the metal sends on average."
)
PREFILTERED = ("roughness", "RMSE of metal", "of its light", "RMSE of dielectric")
CAUSES = ("cause", "RMSE", "share", "of the PNG's")
WHERE_FROM = (
    "Error of the image that `render` draws, by cause: RMSE of each alone; share of the total's mean square, negative where "
    "it makes up for others"
)


def _causes(found: Decomposition) -> list[text_tables.Row]:
    def percent(share: float | None) -> str:
        return "-" if share is None else f"{round(100.0 * share, 1) + 0.0:.1f} %"

    return [(part.cause, digits(part.rmse), percent(part.share), percent(part.png_share)) for part in found.parts]


FORMATS = ("format", "write ms", "half of them", "kB", "RMSE", "largest")


def _formats(kept: Sequence[Kept]) -> list[text_tables.Row]:
    return [
        (
            each.name,
            f"{each.write_ms.median:.1f}",
            f"{each.write_ms.low:.1f} to {each.write_ms.high:.1f}",
            f"{each.bytes / 1e3:.0f}",
            digits(each.rmse),
            digits(each.largest),
        )
        for each in kept
    ]


FAMILIES = ("family", "size", "error", "power of size", "expected", "power of time")
WORK_PRECISION = (
    "Work and precision: errors in families of variants that differ in one size, as powers of that size and of the time of "
    "a frame, with 95 % intervals; RMSE against the reference, of lights' points and of the sphere against the most of "
    "them; what the reference cannot tell is left out"
)


def _family(each: Family) -> text_tables.Row:
    first, last, by_time = each.fit[0], each.fit[-1], each.by_time()
    return (
        each.name,
        f"{digits(first.size)} to {digits(last.size)}",
        f"{digits(first.error)} to {digits(last.error)}",
        str(each.by_size()),
        f"{each.law.exponent:g}",
        str(by_time) if by_time.resolved else "not resolved",
    )


def _families(study: Study) -> Section:
    found = study.families
    notes = [f"{each.name} ({ABOUT[each.name]}): {expected(each.by_size(), each.law)}" for each in found]
    return Section("Work and precision", WORK_PRECISION, FAMILIES, [_family(each) for each in found], notes)


def _prefiltering(found: Sequence[Prefiltering]) -> Section:
    rows = [
        (
            f"{each.roughness:g}",
            digits(each.metal),
            f"{each.metal / each.mean:.1%}" if each.mean > 0.0 else "-",
            digits(each.dielectric),
        )
        for each in found
    ]
    return Section("Environment's prefiltering", PREFILTERING, PREFILTERED, rows)


def _tessellation(found: Tessellation) -> Section:
    columns = [(errors, found.ms[shader]) for shader, errors in found.errors.items()]
    header = ("triangles", *(text for shader in found.errors for text in (shader, "ms")))
    rows = [
        (f"{count:,}", *(text for errors, ms in columns for text in (digits(errors[k]), digits(ms[k].median))))
        for k, count in enumerate(found.triangles)
    ]
    return Section("Tessellation", SPHERE.format(found.finest), header, rows)


def _variants(study: Study) -> list[text_tables.Row]:
    best, tied = study.front, [each for group in study.ties for each in group]
    return [_variant(each, " *=" if each in tied else " *" if each in best else "") for each in study.measured]


def facts(study: Study) -> dict[str, str]:
    """Return what was measured, on what, against what."""
    return {
        "scene": study.title,
        "device": study.device,
        "machine": study.machine,
        "reference": study.reference.about(),
    }


NOTES = (
    "* marks the Pareto front: nothing else is measurably better in time or error, and no worse in the other; lower errors "
    "are more accurate",
    "RMSE to FLIP: approximation, against the reference; display white is 1; sampling: of that, what finer sampling of the "
    f"same model would cure; model: what it would not, against the best model with the same {MODEL_SAMPLES} samples",
    "arithmetic: the largest |value - oracle| / light of pixels computed again in float64 with the same settings; its RMS; "
    "the largest in bounds, and how many are allowed; pixels of wrong coverage, of so many looked at: all, or a stratified "
    "sample, the smaller the more samples each pixel has, so that largest and RMS of two variants may be of other pixels",
)
SPHERE = "RMSE of a sphere against one of {:,} triangles, where both cover a pixel, and milliseconds of a frame"


def _notes(study: Study) -> list[str]:
    return [*NOTES, *_ties(study), *([] if has_flip() else [NO_FLIP])]


def _ties(study: Study) -> list[str]:
    return [
        f"= {', '.join(each.name for each in group)} are ties: medians within the middle half of the other's frames, errors "
        f"within {study.reference.error:.2g}"
        for group in study.ties
    ]


SIZES = (
    "Growing images: times and errors against the converged image of the same size; power: of the number of pixels, with "
    "what 95 % of resampled frames, windows and the reference leave open at these sizes"
)


def _sizes(study: Study) -> Section:
    found = study.growths
    return Section("Sizes", SIZES, sizes.header(found), sizes.rows(found), sizes.statements(found))


def sections(study: Study) -> list[Section]:
    """Return all tables, that of the variants first."""
    found, details = [Section("Variants", "", VARIANTS, _variants(study), _notes(study))], study.details
    if details:
        causes = details.decomposition
        found.append(Section("Where the error comes from", WHERE_FROM, CAUSES, _causes(causes), causes.lines()))
        if details.prefiltering:
            found.append(_prefiltering(details.prefiltering))
    if study.families:
        found.append(_families(study))
    if details:
        found.append(_tessellation(details.tessellation))
        found.append(Section("Output formats", "", FORMATS, _formats(details.kept)))
    return [*found, _sizes(study)] if study.growths else found


def first_lines(study: Study, command: Command) -> list[str]:
    """Return what is printed first: what to render with."""
    return [*(each.line(command) for each in answer(study)), "", text_tables.wrapped(criterion(study), 2)]


def lines(study: Study) -> list[str]:
    """Return what was measured and the tables as lines for the terminal."""
    found = ["", *(text_tables.wrapped(f"{name:<9}  {value}", 11) for name, value in facts(study).items())]
    for each in sections(study):
        found += ["", *([text_tables.wrapped(each.about, 2)] if each.about else [])]
        found += text_tables.as_lines(each.header, each.rows)
        found += [text_tables.wrapped(note, 2) for note in each.notes]
    return found


def markdown(study: Study, command: Command, used: str) -> str:
    rows = [(*texts, f"`{line}`") for *texts, line in answer_rows(study, command)]
    found = ["# Error against run time", "", *text_tables.as_markdown(ANSWER, rows), ""]
    found += [f"- {each}" for each in (criterion(study), used) if each]
    found += [f"- {name}: {value}" for name, value in facts(study).items()]
    for each in sections(study):
        found += ["", f"## {each.title}", "", *([f"{each.about}.", ""] if each.about else [])]
        found += text_tables.as_markdown(each.header, each.rows)
        found += ["", *(f"- {note}" for note in each.notes)] if each.notes else []
    return "\n".join([*found, ""])


FILES = ("report.csv", "report.json", "report.md")


def write(study: Study, used: Measured | None, command: Command, folder: Path) -> list[Path]:
    """Write FILES. used: the variant chosen for the budget or tolerance."""
    chosen = {"use": used and used.variant.name, "answer": [each.stats(command) for each in answer(study)]}
    texts = (
        text_tables.as_csv(csv_table.HEADER, csv_table.rows(study)),
        json.dumps({**study.stats(), **chosen}, indent=2) + "\n",
        markdown(study, command, used_line(used, command) if used else ""),
    )
    for name, text in zip(FILES, texts, strict=True):
        atomic_files.write_bytes(folder / name, text.encode())
    return [folder / name for name in FILES]


ANSWER = ("for", "settings", "command")


def answer_rows(study: Study, command: Command) -> list[text_tables.Row]:
    """Return the answer as rows of a table with the header ANSWER."""
    return [(each.purpose, each.found, command(each.used.settings)) for each in answer(study)]


def used_line(used: Measured, command: Command) -> str:
    """Return a line with the command that draws the measured image."""
    return f"use {used.name}: {used.cost:.3g} ms, RMSE {used.error:.3g}: {command(used.settings)}"


def render_command(scene: Scene, settings: Settings) -> str:
    """Return the command that draws a built-in scene with these settings."""
    return shlex.join(["clshade", "render", scene.name, *render_options(scene, render_fields(settings, scene))])


def render_options(scene: Scene, given: Mapping[str, Any]) -> list[str]:
    """Return the options of `render` for the image's size and for fields of Settings and the preset."""
    return [as_option("resolution", scene.camera.resolution), *(as_option(*each) for each in given.items())]


def render_fields(
    settings: Settings, scene: Scene, presets: Sequence[Preset] = PRESETS, **given: Any
) -> dict[str, Any]:
    """Return the fields of Settings that `render` has to be given, relative to the samples of the scene's pictures and to
    its preset, or to a nearer one of these, which is given too. given: fields that it is given in any case."""

    def changes(preset: Preset) -> dict[str, Any]:
        return {} if preset == scene.preset else {"preset": preset}

    return min(({**changes(preset), **changed_fields(settings, scene, preset, **given)} for preset in presets), key=len)
