"""Columns of CSV that several tables share."""

from __future__ import annotations

from ..timing import Spread
from .power_law import Power

Record = dict[str, object]


def time_fields(ms: Spread) -> Record:
    """Return the columns of a median and of what holds half of the times."""
    return {"ms": ms.median, "ms_low": ms.low, "ms_high": ms.high}


def power_fields(found: Power | None) -> Record:
    """Return the columns of a fitted power, none if there is none."""
    return {} if found is None else {"power": found.exponent, "power_low": found.low, "power_high": found.high}
