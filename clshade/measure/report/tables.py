"""The results of `report` as tables, and the commands that draw what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

from ...base.declare import as_option
from ...base.text_tables import digits
from ...images.metrics import has_flip
from ...pipeline.effective_settings import changed_fields
from ...scene.model import Scene, Settings
from ...scene.settings import PRESETS, Preset
from ..results import Column, Results, Table
from ..timing import Spread
from .answer import Command, answer, criterion
from .decomposition import Part
from .measure import Measured
from .model_errors import SAMPLES
from .study import Study


def _half(ms: Spread) -> str:
    return f"{ms.low:.2f} to {ms.high:.2f}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{round(100.0 * share, 1) + 0.0:.1f} %"


def _wrong(measured: Measured) -> str:
    return f"{measured.arithmetic.wrong} of {measured.arithmetic.pixels:,}"


VARIANTS = (
    Column("", "name", attrgetter("variant.name")),
    Column("", "settings", lambda measured: measured.variant.changed()),
    Column("ms", "ms", attrgetter("cost"), "{:.2f}".format),
    Column("half of them", "", attrgetter("frame_ms"), _half),
    Column("", "ms_low", attrgetter("frame_ms.low")),
    Column("", "ms_high", attrgetter("frame_ms.high")),
    Column("RMSE", "rmse", attrgetter("error")),
    Column("sampling", "sampling", attrgetter("sampling")),
    Column("model", "model", attrgetter("model"), lambda error: digits(error or None)),
    Column("relMSE", "relmse", attrgetter("approximation.relmse")),
    Column("PSNR", "psnr", attrgetter("approximation.psnr"), "{:.1f}".format),
    Column("FLIP", "flip", attrgetter("approximation.flip")),
    Column("", "close", attrgetter("close")),
    Column("arithmetic", "arithmetic", attrgetter("arithmetic.error"), "{:.2g}".format),
    Column("wrong", "", lambda measured: measured, _wrong),
    Column("", "wrong", attrgetter("arithmetic.wrong")),
    Column("", "pixels_checked", attrgetter("arithmetic.pixels")),
)
NOTES = (
    "* marks the Pareto front: the variants that are more accurate than all faster ones, by more than the reference's own "
    "error; lower errors are more accurate",
    "RMSE to FLIP: approximation, against the reference; display white is 1; sampling: of that, what finer sampling of the "
    f"same model would cure; model: what it would not, against the best model with the same {SAMPLES} samples",
    "arithmetic: the largest |value - oracle| / light of pixels computed again in float64 with the same settings; wrong: "
    "pixels of wrong coverage, of so many looked at: all, or a stratified sample",
)
NO_FLIP = (
    "FLIP: not measured, flip-evaluator is not installed (pip install flip-evaluator, or clshade's extra `report`)"
)
CAUSES = (
    Column("cause", "cause", attrgetter("cause"), str),
    Column("RMSE", "rmse", attrgetter("rmse")),
    Column("share", "share", attrgetter("share"), _percent),
)
WHERE_FROM = (
    "Error of the image that `render` draws, by cause: RMSE of each alone; share of the total's mean square, negative where "
    "it makes up for others."
)


def results(study: Study) -> Results:
    """Return what was measured, on what, against what."""
    best = study.front
    name = Column("variant", "", lambda measured: f"{measured.name}{' *' * (measured in best)}", str)
    notes = NOTES if has_flip() else (*NOTES, NO_FLIP)
    parts: Sequence[Part] = ()
    remarks: list[str] = []
    if (causes := study.causes) is not None:
        parts = causes.parts
        remarks = [f"total: RMSE {causes.total:.3g}, as a PNG {causes.png_total:.3g}", *causes.remarks()]
    machine = {"scene": study.title, "device": study.device, "machine": study.machine}
    tables = [
        Table("Variants", (name, *VARIANTS), study.measured, notes=notes),
        Table("Where the error comes from", CAUSES, parts, WHERE_FROM, remarks),
    ]
    return Results(f"Error against run time: {study.title}", {**machine, "reference": study.reference.about()}, tables)


def written(study: Study, command: Command, used: Measured | None) -> Results:
    """Return the results for files, the answer first. used: the variant chosen for the budget or tolerance."""
    tables = results(study)
    first = {advice.purpose: f"{advice.found}: {command(advice.used.settings)}" for advice in answer(study)}
    first["criterion"] = criterion(study)
    if used is not None:
        first["use"] = used_line(used, command)
    data = {
        "scene": study.scene.name,
        "resolution": study.scene.camera.resolution,
        "reference_error": study.reference.error,
        "settings": dict(study.overrides),
        "use": used and used.variant.name,
        "default": study.default and study.usual,
        "pareto_front": [advice.variant.name for advice in study.front],
    }
    if study.causes is not None:
        data |= {"total": study.causes.total, "png_total": study.causes.png_total}
    return replace(tables, facts={**first, **tables.facts}, data=data)


def used_line(used: Measured, command: Command) -> str:
    """Return what is used, and the command that draws it."""
    return f"{used.name}: {used.cost:.3g} ms, RMSE {used.error:.3g}: {command(used.settings)}"


def render_options(scene: Scene, given: Mapping[str, Any]) -> list[str]:
    """Return the options of `render` for the image's size and for fields of Settings and the preset."""
    return [as_option("resolution", scene.camera.resolution), *(as_option(*field) for field in given.items())]


def render_fields(
    settings: Settings, scene: Scene, presets: Sequence[Preset] = PRESETS, **given: Any
) -> dict[str, Any]:
    """Return the fields of Settings that `render` has to be given, relative to the samples of the scene's pictures and to
    its preset, or to a nearer one of these, which is given too. given: fields that it is given in any case."""

    def changes(preset: Preset) -> dict[str, Any]:
        return {} if preset == scene.preset else {"preset": preset}

    return min(({**changes(preset), **changed_fields(settings, scene, preset, **given)} for preset in presets), key=len)
