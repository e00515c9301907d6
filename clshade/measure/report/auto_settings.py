"""Settings chosen for a time budget or an error tolerance, by a short study of the scene."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from ...base import console, text_tables
from ...pipeline.effective_settings import effective_settings
from ...pipeline.opencl.device import Device, shared_device
from ...scene.model import Scene, Settings
from ...scene.settings import PRESET_FIELDS, Preset
from .reference_image import Reference
from .short_study import Candidate, Limit, ShortStudy, row
from .thinned_image import Thinned
from .variants import BASE, SHORT, Variant, variants_for

HEADER = ("variant", "outcome", "ms a frame", "95 %", "RMSE", "95 %")
BUSY = 0.15  # share of the time waiting for processors from which on times are in doubt


@dataclass(frozen=True, eq=False)
class Selection:
    """The settings to render with.

    kept: fields of Settings that were given, or the scene's own. tried: the figures of all variants, those that were
    drawn first. thinned: the pixels that errors were measured at. seconds: duration of the study. doubt: why another
    measurement might choose differently; "" if nothing suggests it.
    """

    used: Candidate
    settings: Settings
    kept: tuple[str, ...]
    tried: tuple[dict[str, Any], ...]
    reference: Reference
    thinned: Thinned
    seconds: float
    doubt: str

    passed = True  # a limit that no variant meets raises an error instead

    def lines(self) -> list[str]:
        """Return the choice as lines for the terminal."""
        used, variant = self.used, self.used.variant
        changed = f" ({variant.changed()})" if variant.changes else ""
        kept = ", ".join(f"{name}={getattr(self.settings, name)}" for name in self.kept)
        drawn = sum("frame_ms" in each for each in self.tried)
        within = "" if used.estimate is None else f", {_range(used.estimate[1:])}"
        return [
            f"{used.name}{changed}: {used.cost:.3g} ms a frame after the first, RMSE {used.error:.3g}{within}",
            *([f"kept as they are: {kept}"] if kept else []),
            f"{drawn} of {len(self.tried)} variants drawn, in {self.seconds:.1f} s; errors of {self.thinned.about()}",
            f"reference: {self.reference.about()}",
        ]

    def table(self) -> list[str]:
        """Return what was tried, and what was not and why, as a table for the terminal."""
        rows = [
            (
                each["about"],
                each["outcome"],
                text_tables.digits(each.get("frame_ms")),
                _range(each.get("frame_ms_95")),
                text_tables.digits(each.get("rmse")),
                _range(each.get("rmse_95")),
            )
            for each in self.tried
        ]
        return text_tables.as_lines(HEADER, rows, left=2)

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        used = self.used
        return {
            "variant": used.variant.shown_name,
            "settings": used.variant.changes,
            "frame_ms": used.cost,
            "rmse": used.error,
            "rmse_95": None if used.estimate is None else used.estimate[1:],
            "kept": {name: getattr(self.settings, name) for name in self.kept},
            "reference": self.reference.stats(),
            "thinned": self.thinned.stats(),
            "tried": self.tried,
            "doubt": self.doubt,
            "seconds": self.seconds,
        }


def _range(interval: tuple[float, float] | None) -> str:
    return "-" if interval is None else " to ".join(map(text_tables.digits, interval))


def select(
    scene: Scene,
    *,
    budget: float | None = None,
    tolerance: float | None = None,
    preset: Preset | None = None,
    device: Device | str | None = None,
    resolution: tuple[int, int] | None = None,
    **fields: Any,
) -> Selection:
    """Select the most accurate variant within `budget` milliseconds per frame, or the fastest with an RMSE of at most
    `tolerance`.

    fields: fields of Settings that are kept, also in the reference. If a preset is given, or the scene's is not
    `standard`, all fields that differ between presets are kept too. The variants of SHORT change the others. Raises
    DeviceError, and InputError if no variant meets the limit.
    """
    start = time.perf_counter()
    opened = device if isinstance(device, Device) else shared_device(device, profiling=True)  # as `render` opens it
    scene, base, fixed, variants = selectable(scene, opened, preset, resolution, **fields)
    study = ShortStudy(scene, base, opened, Limit(budget, tolerance), fixed)
    used = study.choose(variants)
    doubt = thinning_doubt(used, tolerance) or busy_doubt(study.waiting.share)
    if doubt:
        console.warning(f"within noise: {doubt}")
    rows = (*(row(each, study.outcome(each, used)) for each in study.drawn), *(row(each) for each in study.dropped))
    return Selection(
        used,
        used.variant.settings(base),
        tuple(sorted(fixed - {"layers"})),
        rows,
        study.reference,
        study.thinned,
        time.perf_counter() - start,
        doubt,
    )


def selectable(
    scene: Scene, device: Device, preset: Preset | None = None, resolution: tuple[int, int] | None = None, **fields: Any
) -> tuple[Scene, Settings, set[str], list[Variant]]:
    """Return what `select` chooses from: the effective scene, the base settings, the fields that are kept, the variants."""
    scene, base = effective_settings(scene, preset, resolution=resolution, **fields)
    fixed = set(fields)
    if preset is not None or scene.preset != BASE:
        fixed |= preset_fields(preset or scene.preset)
    known = variants_for(scene, base, device)
    return scene, base, fixed, [each for each in known if each.name in SHORT and not fixed & set(each.changes)]


def thinning_doubt(used: Candidate, tolerance: float | None) -> str:
    """Return the doubt about an error that was estimated from a part of the image; "" if there is none."""
    if tolerance is None or used.estimate is None or used.estimate.high <= tolerance:
        return ""
    return f"the error of {used.name} is {_range(used.estimate[1:])}, about the tolerance"


def busy_doubt(share: float) -> str:
    """Return the doubt about times in which a thread waited for other programs for this share; "" if there is none."""
    return f"other programs kept this one waiting for {share:.0%} of the time" if share > BUSY else ""


def preset_fields(preset: Preset) -> set[str]:
    """Return the fields of Settings in which a preset differs from `standard`, and that one from `course`."""
    return set(PRESET_FIELDS["course" if preset == "standard" else preset])
