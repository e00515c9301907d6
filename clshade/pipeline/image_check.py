"""The error of one frame, as `clshade.check` finds it and the frame carries it into its files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..base.arrays import Floats32


@dataclass(frozen=True, eq=False)
class Check:
    """What `clshade.check` found.

    pixels, of: how many were looked at, of how many.
    bounds: the largest error of a color, in units of sqrt(max(n, 1)) * 2^-24 * kappa * B, or 1e-12 * kappa * B of float64.
    allowed: how many of them a color may be off: 32 of float32, 1 of float64, see `oracle_bounds.allowed`.
    error: the largest |value - oracle| / B, B the light that the point could at most send.
    rms: root of the mean square of the same; of the image only where all pixels were looked at.
    kappa: how far rounding errors were amplified by the geometry, at the pixel of `bounds`.
    worst: row (from the top) and column of that pixel.
    strata: stratum -> (pixels looked at, their largest error in bounds).
    wrong: pixels whose owner or coverage is not the oracle's, or whose values are not finite.
    ties: pixels with another owner at a depth within 2^-38 of its own, which either may own; not counted as
        wrong. With several samples also pixels of the same id, if of any: those whose color is off, where one
        of the samples has two nearest faces as close as that; nor do they count in `bounds`.
    gates: pixels more bounds off than allowed, by no more than a highlight that may be decided either way; not counted in
        `bounds`.
    depth: the largest relative error of Z, in 2^-24; 8 are allowed (2^-53 and 16 of float64). None without the layer Z.
    ids: whether owners were compared; without the layer id only coverage is.
    precision: of the frame.
    seconds: what the check took.
    image: (M, N) float32, the error of each pixel in bounds, infinity where it is wrong, 0 for ties; None unless all
        pixels were looked at.
    """

    pixels: int
    of: int
    bounds: float
    allowed: float
    error: float
    rms: float
    kappa: float
    worst: tuple[int, int]
    strata: dict[str, tuple[int, float]]
    wrong: int
    ties: int
    gates: int
    depth: float | None
    depth_allowed: int
    ids: bool
    precision: str
    seconds: float
    image: Floats32 | None = field(repr=False)

    @property
    def passed(self) -> bool:
        """Whether no pixel looked at is wrong and all errors are within what is allowed."""
        depth_is_right = self.depth is None or self.depth <= self.depth_allowed
        return self.wrong == 0 and self.bounds <= self.allowed and depth_is_right

    @property
    def complete(self) -> bool:
        """Whether every pixel was looked at."""
        return self.pixels == self.of

    @property
    def unit(self) -> str:
        """What a bound is, but for kappa and the light."""
        return "1e-12" if self.precision == "float64" else "sqrt(max(n,1)) * 2^-24"

    def lines(self) -> list[str]:
        """What was found, for the terminal."""
        what = "ids and coverage" if self.ids else "coverage (ids: no such layer)"
        owned = f"{what}: {self.wrong:,} wrong" + (f", {self.ties:,} ties" if self.ties else "")
        row, column = self.worst
        at = f"row {row}, column {column}" if self.bounds > 0.0 else "no pixel"
        gates = f", {self.gates:,} at a highlight's gate not counted" if self.gates else ""
        depth = [f"Z: {self.depth:.3g} of {self.depth_allowed} roundings"] if self.depth is not None else []
        strata = ", ".join(f"{name} {worst:.2g} ({count:,})" for name, (count, worst) in self.strata.items() if count)
        return [
            f"{self.pixels:,} of {self.of:,} pixels computed again in float64, {self.seconds * 1e3:.0f} ms: "
            + ("within bounds" if self.passed else "FAILED"),
            f"largest error {self.bounds:.3g} of {self.allowed:g} bounds, {self.error:.2g} of the light, "
            f"kappa {self.kappa:.3g}, at {at}{gates}",
            f"by stratum {strata}",
            "; ".join([owned, *depth]),
            "every pixel was looked at" if self.complete else "a lower bound: pixels not looked at may be worse",
        ]

    def stats(self) -> dict[str, Any]:
        """The figures, as JSON takes them."""
        figures = {name: value for name, value in vars(self).items() if name != "image"}
        figures["strata"] = {name: {"pixels": n, "bounds": worst} for name, (n, worst) in self.strata.items()}
        return {**figures, "passed": self.passed, "lower_bound": not self.complete}

    def metadata(self) -> dict[str, Any]:
        """Header attributes of the EXR."""
        of_what = "largest error" if self.complete else "lower bound of the largest error"
        found = {
            "check": f"{of_what}: {self.pixels} of {self.of} pixels computed again in float64; "
            + f"{self.allowed:g} bounds allowed, a bound is {self.unit} * kappa of the light",
            "checkPixels": self.pixels,
            "checkErrorBounds": self.bounds,
            "checkErrorRelative": self.error,
            "checkKappa": self.kappa,
            "checkWrongPixels": self.wrong,
        }
        return found if self.depth is None else {**found, "checkDepthRoundings": self.depth}
