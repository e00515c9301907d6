"""Numbers, vectors and lists as people write them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.arrays import Array
from ...base.text_tables import digits

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def rounded(value: float, count: int = 3) -> str:
    """Return so many significant digits, with a power of ten where the number is long."""
    mantissa, _, exponent = f"{float(digits(value, count)):g}".partition("e")
    return f"{mantissa} × 10{str(int(exponent)).translate(SUPERSCRIPTS)}" if exponent else mantissa


def percent(share: float) -> str:
    """Return a share in percent, with two significant digits or more."""
    return f"{100.0 * share:.0f} %" if abs(share) >= 0.1 else f"{rounded(100.0 * share, 2)} %"


def vector(values: Array) -> str:
    return "(" + ", ".join(rounded(x) for x in values).replace("-", "−") + ")"


def coefficient(values: Array) -> str:
    """Return one number for three equal ones."""
    return rounded(values[0]) if np.ptp(values) == 0.0 else vector(values)


def sentence(text: str) -> str:
    """Return the text with a capital letter, and no other changed."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str]) -> str:
    """Return "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def figures(numbers: Sequence[int]) -> str:
    """Return "Figure 7", "Figures 7 and 15", "Figures 2, 3, 5 to 8 and 17"."""
    runs: list[list[int]] = []
    for each in numbers:
        if runs and each == runs[-1][-1] + 1:
            runs[-1].append(each)
        else:
            runs.append([each])
    words = [
        word for run in runs for word in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else [str(each) for each in run])
    ]
    return f"Figure{'s' * (len(numbers) > 1)} {listed(words)}"
