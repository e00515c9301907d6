"""`python -m clshade stability SCENE`: where and why a scene amplifies rounding, and what that does to its image."""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from pathlib import Path

from ...base import text_tables
from ...base.atomic_files import shown
from ...base.text_tables import digits
from ...images import exr
from ...pipeline.opencl.device import open_device
from ...scene.model import Scene, Settings
from .. import results
from ..results import Column, Results, Table
from . import scene_figure
from .causes import CAUSES, NONE
from .scene_study import SceneStudy, study

PIXELS = (
    Column("no", "no", attrgetter("number"), str),
    Column("cause", "", lambda pixel: CAUSES.get(pixel.cause, (NONE,))[0], str),
    *(Column(name, name, attrgetter(name), str) for name in ("row", "column", "face")),
    Column("kappa", "kappa", attrgetter("kappa")),
    Column("n", "n", attrgetter("exponent"), "{:g}".format),
    *(Column(name, name, attrgetter(name), partial(digits, count=2)) for name in ("error", "bound")),
    *(Column("", name, attrgetter(name)) for name in ("cause", "why", "mesh", "point")),
    *(Column("", f"{name}_factor", lambda pixel, name=name: pixel.factors[name]) for name in CAUSES),  # type: ignore[misc]
)
ABOUT = "error, bound: of the most light that the point can send"


def run(scene: Scene, settings: Settings, device: str | None = None, *, out: str | Path = "stability") -> bool:
    """Study the scene, print the tables and write all files. Returns True if every pixel is within its bounds.

    Raises DeviceError, InputError and OutputError.
    """
    opened = open_device(device)
    prefix = text_tables.create_folder(out) / "stability"
    paths = results.files(prefix, "png", "exr")
    results.check_files(paths)
    result = study(scene, settings, opened)
    summary = summarize(result, opened.title)
    print("\n".join(summary.lines()), flush=True)
    summary.write(prefix)
    scene_figure.plot(result, opened.title, paths[-2])
    maps = {"kappa": result.kappa, "relativeError": result.error, "relativeBound": result.bound}
    exr.write(paths[-1], {**result.frame.channels(), **maps}, metadata=result.frame.metadata())
    print("\n".join(["", *results.wrote(paths)]))
    return result.check.passed


def summarize(study: SceneStudy, device: str) -> Results:
    """Return the study as facts and a table of the worst pixels."""
    numbers: dict[str, list[str]] = {}  # each sentence once, after the numbers of its pixels
    for pixel in study.worst:
        numbers.setdefault(pixel.why, []).append(str(pixel.number))
    reasons = [f"{','.join(of)}: {why}" for why, of in numbers.items()]
    table = Table("Worst pixels", PIXELS, study.worst, ABOUT, reasons, left=2)
    scene, check, settings, kappa = study.frame.scene, study.check, study.frame.settings, study.quantiles()
    columns, rows = scene.camera.resolution
    lines = check.lines()
    facts = {
        "scene": f"{shown(scene.name or 'unnamed')}, {scene.face_count:,} triangles, {columns}x{rows}",
        "drawn": f"{settings.shader}, {settings.visibility}, {settings.lighting_at}, {settings.precision}",
        "device": device,
        "checked": f"{check.pixels:,} of {check.of:,} pixels: {'all' if check.complete else 'a sample'}",
        "kappa": ", ".join(f"{name} {value:.3g}" for name, value in kappa.items())
        or "nothing is visible: no triangle covers the center of a pixel",
        "errors": f"{100.0 * study.within:.6g} % of the covered pixels checked are within bounds, the largest is "
        f"{check.bounds:.3g} of {check.allowed:.4g} bounds",
        "result": "all within bounds" if check.passed else f"FAILED: {lines[1]}; {lines[3]}",
    }
    data = {
        "passed": check.passed,
        "settings": vars(settings),
        "kappa": kappa,
        "within": study.within,
        "check": check.stats(),
    }
    return Results("Stability of a scene", facts, [table], data)
