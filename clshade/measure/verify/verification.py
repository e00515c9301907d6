"""The result of `clshade.verify`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ...base.console import in_one_line
from .confidence import CONFIDENCE, rounded_up


@dataclass(frozen=True)
class Verification:
    """The result of `clshade.verify`.

    Attributes
    ----------
    pixels, of : int
        Number of pixels computed again, and of all pixels; 0 if the scene is not the one that was
        drawn.
    wrong : int
        How many of them are wrong: colors beyond their bounds, other coverage, or another layer
        beyond its bound.
    at_most : float
        Share of all pixels that is wrong or cannot be judged at most, with 99 % confidence: the exact
        binomial bound. If all were computed again, the share itself.
    bounds, allowed : float
        Largest error of a color that is not wrong for another reason, and the largest allowed, as of
        `clshade.check`.
    ties : int
        Pixels of the sample that cannot be judged: faces at one depth, of which either may show.
    gates : int
        Pixels of the sample that are off by a highlight which rounding may open or close.
    worst : tuple of int or None
        Row (from the top) and column of a wrong pixel, None if there is none.
    seed : int or None
        Seed of the sample; None if all pixels were computed again.
    drawn_by : str
        The version and the device that the header names.
    compared : tuple of str
        What was compared: `color`, `coverage` and names of layers, `PNG`.
    faults : tuple of str
        What is wrong besides pixels of the EXR, one line each.
    remarks : tuple of str
        What was not looked at, and what differs without being wrong, one line each.
    """

    pixels: int
    of: int
    wrong: int = 0
    at_most: float = 1.0
    bounds: float = 0.0
    allowed: float = 0.0
    ties: int = 0
    gates: int = 0
    worst: tuple[int, int] | None = None
    seed: int | None = None
    drawn_by: str = ""
    compared: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether nothing is wrong with what was looked at."""
        return self.wrong == 0 and not self.faults

    @property
    def claim(self) -> str:
        """What the sample says of all pixels, in words."""
        if self.pixels == self.of:
            unknown = f", and {self.ties:,} cannot be judged" if self.ties else ""
            return f"{self.wrong:,} of {self.of:,} pixels are wrong{unknown}: every one was looked at"
        if self.at_most >= 1.0:
            return "any number of the pixels may be wrong"
        unknown = " or cannot be judged" if self.ties else ""
        sure, share = f"{100 * CONFIDENCE:g} % confidence", rounded_up(self.at_most)
        return f"with {sure} fewer than {share} of the pixels are wrong{unknown}"

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        lines = ["verified" if self.passed else "FAILED", *self.faults]
        if self.pixels:
            seed = "" if self.seed is None else f", seed {self.seed}"
            ties, gates = "not judged, at faces of one depth", "accepted at a highlight's gate"
            except_ = "".join(f"; {n:,} {what}" for n, what in ((self.ties, ties), (self.gates, gates)) if n)
            lines += [
                self.claim,
                f"{self.pixels:,} of {self.of:,} pixels computed again in float64{seed}: {self.wrong:,} wrong"
                + (f", the first at row {self.worst[0]}, column {self.worst[1]}" if self.worst else "")
                + except_,
                f"largest error {self.bounds:.3g} of {self.allowed:g} bounds",
                f"compared: {', '.join(self.compared)}",
            ]
        lines += [f"drawn by {self.drawn_by}, as the header says", *(f"remark: {remark}" for remark in self.remarks)]
        return [in_one_line(line) for line in lines]  # some of it is whatever the header's author wrote

    def stats(self) -> dict[str, Any]:
        """Return the figures as JSON-compatible values."""
        return {**asdict(self), "passed": self.passed, "claim": self.claim if self.pixels else ""}
