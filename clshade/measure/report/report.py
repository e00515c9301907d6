"""`report`: error against run time of one scene."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from ...base import atomic_files, console, text_tables
from ...base.atomic_files import shown
from ...base.declare import as_option
from ...errors import InputError
from ...images import figures
from ...pipeline.opencl.device import open_device
from ...scene.model import Scene
from ..defaults import FRAMES
from . import figure, html_page, tables
from .answer import Command
from .families import of_families
from .pareto import chosen
from .sizes import GROWING, growths, resolutions
from .study import study
from .variants import COMMON, SHORT, VARIANTS, Variant, base_settings, default_variant, named, variants_for


def listing() -> str:
    """Return the list of all variants: names, titles, options."""
    return "\n".join(text_tables.wrapped(f"{each.name:<16} {each.title}{_options(each)}", 17) for each in VARIANTS)


def _options(variant: Variant) -> str:
    """Return the options of `render` that make a variant."""
    options = " ".join(as_option(name, value) for name, value in variant.changes.items())
    return f": {options}" if options else ""


def run(
    scene: Scene,
    device: str | None = None,
    *,
    out: str | Path = "report",
    names: Sequence[str] = (),
    frames: int = FRAMES,
    budget: float | None = None,
    tolerance: float | None = None,
    sizes: Sequence[int] | None = None,
    families: Sequence[str] = (),
    details: bool = False,
    formats: Sequence[str] = ("png",),
    html: bool = False,
    settings: Mapping[str, Any] | None = None,
    command: Command | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Measure the variants, print what to render with, and write the files.

    Returns True if every variant's arithmetic is within its bounds.

    names: variants; default: those that may be worth their time, with details all that change the image of this scene.
    frames: number per variant. budget: milliseconds. tolerance: RMSE. sizes: columns of growing images, empty for the usual
    ones; None for none. families: only the variants of these. details: measure more and print all tables; implied by names,
    families and sizes. formats: of the figure. html: write one page with tables and figures too. settings:
    fields of Settings that all variants share but those that change them, in place of the scene's own. command: returns the
    command that draws the scene with some settings. Raises DeviceError, OutputError and InputError; the last also if no
    variant meets the budget or tolerance, but only after all files are written.
    """
    stream = stream or sys.stdout
    if frames < 1:
        raise InputError(f"report: --frames: expected a whole number above 0, found {frames}")
    opened = open_device(device)
    given = settings or {}
    base = base_settings(scene, **given)
    variants = named(of_families(variants_for(scene, base, opened), families), names)
    details = details or bool(names or families or sizes is not None)
    if not names and not families:
        default = default_variant(scene, base, variants, **given)
        usual = {*COMMON, *(SHORT if budget or tolerance else ()), default.name, f"{default.name}-16"}
        variants = [each for each in variants if details or each.name in usual]
        variants += [default] if default not in variants else []
    growing = [] if sizes is None else resolutions(scene, sizes)
    if Path(out).suffix[1:].lower() in (*figures.FORMATS, "html") and not Path(out).is_dir():
        option = "--html" if Path(out).suffix.lower() == ".html" else f"--format {Path(out).suffix[1:].lower()}"
        raise InputError(f"report: --out: expected a folder, found {shown(out)} ({option} writes that into it)")
    folder = text_tables.create_folder(out)
    pictures = [folder / f"report.{kind}" for kind in formats]
    page = [folder / "report.html"] if html else []
    for path in (*(folder / name for name in tables.FILES), *pictures, *page):
        atomic_files.check(path)  # before minutes of measuring
    found = study(scene, opened, variants, frames, settings, details)
    if growing:
        growing_variants = variants if names or families else [each for each in variants if each.name in GROWING]
        found = replace(found, growths=tuple(growths(scene, growing_variants, base, opened, growing)))
    choice, unkept = None, None
    try:
        choice = chosen(found.measured, budget, tolerance, found.reference.error)
    except InputError as error:
        unkept = error
    draws = command or partial(tables.render_command, scene)
    print("\n".join([*tables.first_lines(found, draws), *(tables.lines(found) if details else [])]), file=stream)
    written = tables.write(found, choice.used if choice else None, draws, folder)
    drawn = figure.draw(found)
    for path in pictures:
        figures.save(drawn, path, colors=256)
    for path in page:
        html_page.write(found, choice.used if choice else None, draws, drawn, path)
    written = [*pictures, *page, *written]
    print("\n".join(f"wrote {shown(path)}" for path in written), file=stream)
    if unkept is not None:
        raise unkept
    if choice is not None:
        print(tables.used_line(choice.used, draws), file=stream)
        if choice.doubt:
            console.warning(f"report: within noise: {choice.doubt}")
    return all(each.arithmetic.passed for each in found.measured)
