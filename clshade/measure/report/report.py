"""`report`: error against run time of one scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...base import atomic_files, text_tables
from ...base.atomic_files import shown
from ...base.declare import as_option
from ...errors import InputError
from ...images import figures
from ...pipeline.opencl.device import Device, open_device
from ...scene.model import Scene
from ..defaults import FRAMES
from ..markup import data_uri, element
from ..results import Results, check_files, files, wrote
from . import figure, tables
from .answer import Command, answer, criterion
from .pareto import within_budget, within_tolerance
from .study import Study, study
from .variants import COMMON, LIMITED, VARIANTS, Variant, base_settings, default_variant, named, variants_for

STYLE = ".figure { width: 100%; height: auto }"


def listing() -> str:
    """Return the list of all variants: names, titles, options."""
    lines = []
    for variant in VARIANTS:
        options = " ".join(as_option(name, value) for name, value in variant.changes.items())
        lines.append(text_tables.wrapped(f"{variant.name:<16} {variant.title}{options and f': {options}'}", 17))
    return "\n".join(lines)


def run(
    scene: Scene,
    device: str | None = None,
    *,
    command: Command,
    out: str | Path = "report",
    names: Sequence[str] = (),
    frames: int = FRAMES,
    budget: float | None = None,
    tolerance: float | None = None,
    details: bool = False,
    formats: Sequence[str] = ("png",),
    html: bool = False,
    settings: Mapping[str, Any] | None = None,
) -> bool:
    """Measure the variants, print what to render with, and write the files.

    Returns True if every variant's arithmetic is within its bounds.

    command: returns the command that draws the scene with some settings. names: variants; default: those that may be worth
    their time, with details all that change the image of this scene. frames: number per variant. budget: milliseconds.
    tolerance: RMSE. details: measure more and print all tables; implied by names. formats: of the figure. html: write a
    page too. settings: fields of Settings in place of the scene's own, in all variants but those that change them. Raises
    DeviceError, OutputError and InputError; the last also if no variant meets the budget or tolerance, but only after all
    files are written.
    """
    if frames < 1:
        raise InputError(f"report: --frames: expected a whole number above 0, found {frames}")
    opened = open_device(device)
    variants = _variants(scene, opened, names, details, bool(budget or tolerance), settings or {})
    prefix = _folder(out) / "report"
    check_files(files(prefix, *formats, *(["html"] if html else [])))  # before minutes of measuring
    result = study(scene, opened, variants, frames, settings, details or bool(names))
    lines = [*(advice.line(command) for advice in answer(result)), "", text_tables.wrapped(criterion(result), 2)]
    print("\n".join([*lines, *(["", *tables.results(result).lines()] if details or names else [])]))
    used, reference_error = None, result.reference.error
    try:
        if budget is not None:
            used = within_budget(result.measured, budget, reference_error)
        elif tolerance is not None:
            used = within_tolerance(result.measured, tolerance, reference_error)
    finally:  # what was measured is written even if no variant keeps the limit
        print("\n".join(wrote(_write(result, tables.written(result, command, used), prefix, formats, html))))
    if used is not None:
        print(f"use {tables.used_line(used, command)}")
    return all(advice.arithmetic.passed for advice in result.measured)


def _write(study: Study, results: Results, prefix: Path, formats: Sequence[str], html: bool) -> list[Path]:
    """Write the figure, the page if asked for, and the tables."""
    chart = figure.draw(study)
    paths = [prefix.with_suffix(f".{kind}") for kind in formats]
    for path in paths:
        figures.save(chart, path, colors=256)
    if html:
        paths.append(prefix.with_suffix(".html"))
        vectors = data_uri("image/svg+xml", figures.as_vectors(chart, "svg"))
        picture = element("img", class_="figure", src=vectors, alt="Error against time, and error images")
        atomic_files.write_bytes(paths[-1], results.html(picture, style=STYLE))
    return [*paths, *results.write(prefix)]


def _variants(
    scene: Scene, device: Device, names: Sequence[str], details: bool, limited: bool, given: Mapping[str, Any]
) -> list[Variant]:
    """Return the variants to measure. limited: by a budget or a tolerance."""
    base = base_settings(scene, **given)
    variants = named(variants_for(scene, base, device), names)
    if names:
        return variants
    default = default_variant(scene, base, variants, **given)
    usual = {*COMMON, *(LIMITED if limited else ()), default.name, f"{default.name}-16"}
    chosen = [variant for variant in variants if details or variant.name in usual]
    return chosen if default in chosen else [*chosen, default]


def _folder(out: str | Path) -> Path:
    """Create the folder for the files."""
    suffix = Path(out).suffix[1:].lower()
    if suffix in (*figures.FORMATS, "html") and not Path(out).is_dir():
        option = "--html" if suffix == "html" else f"--format {suffix}"
        raise InputError(f"report: --out: expected a folder, found {shown(out)} ({option} writes that into it)")
    return text_tables.create_folder(out)
