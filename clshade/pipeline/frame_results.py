"""What is computed of a frame after it was drawn, and written into its files: its error and its optical flow."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ..base.arrays import Bools, Floats32
from ..base.atomic_files import write_bytes
from ..base.validation import path as checked_path
from ..base.validation import value_error
from ..scene.model import Scene, Settings


@dataclass(frozen=True, eq=False)
class Check:
    """The result of `clshade.check`.

    A bound is sqrt(max(n, 1)) * 2^-24 * kappa * B, or 1e-12 * kappa * B for float64: n is the specular exponent, B the most
    light that the point can send, kappa, a condition number, how far the geometry amplifies rounding errors.

    pixels, of: number of pixels checked, and of all. bounds, allowed: largest error of a color in bounds, and the largest
    one allowed, 32 for float32, 1 for float64, see `oracle_bounds.allowed`. error, rms: largest |value - oracle| / B, and
    the root mean square, of the whole image only if all pixels were checked. kappa, worst: kappa, and row (from the top) and
    column, of the pixel of `bounds`. strata: by stratum, the number of pixels checked and their largest error in bounds.

    wrong: pixels whose owner, instance or coverage differs from the oracle's, or whose values are not finite. ties: pixels
    with another owner at a depth within 2^-38 of the oracle's, where either is correct: not wrong. With several samples also
    pixels of the same id, if any, whose color is off and one of whose samples has two nearest faces as close as that; these
    do not count in `bounds` either. gates: pixels whose error exceeds what is allowed by no more than a highlight, or a step
    of a color map, that may fall on either side of its threshold; not counted in `bounds`.

    depth, depth_allowed: largest relative error of Z, in 2^-24, or in 2^-53 for float64, None without the layer Z; and the
    largest one allowed, 10, or 22 for float64. ids: whether owners were compared; without the layer id only coverage is.
    precision: of the frame. seconds: duration of the check. image: (M, N), the error of each pixel in bounds, infinity where
    it is wrong, 0 for ties; None unless all pixels were checked. flow: largest error of the frame's flows, in what is
    allowed; infinite where a mask is wrong, None without any.
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
    flow: float | None = None

    @property
    def passed(self) -> bool:
        """Whether no checked pixel is wrong and all errors are within what is allowed."""
        depth_is_right = self.depth is None or self.depth <= self.depth_allowed
        flow_is_right = self.flow is None or self.flow <= 1.0
        return self.wrong == 0 and self.bounds <= self.allowed and depth_is_right and flow_is_right

    @property
    def complete(self) -> bool:
        """Whether every pixel was checked."""
        return self.pixels == self.of

    @property
    def unit(self) -> str:
        """The unit of a bound, without kappa and the light."""
        return "1e-12" if self.precision == "float64" else "sqrt(max(n,1)) * 2^-24"

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        what = "ids and coverage" if self.ids else "coverage (ids: no such layer)"
        owned = f"{what}: {self.wrong:,} wrong" + (f", {self.ties:,} ties" if self.ties else "")
        row, column = self.worst
        at = f"row {row}, column {column}" if self.bounds > 0.0 else "no pixel"
        gates = f", {self.gates:,} at a highlight's gate not counted" if self.gates else ""
        depth = [f"Z: {self.depth:.3g} of {self.depth_allowed} roundings"] if self.depth is not None else []
        depth += [f"flow: {self.flow:.3g} of what is allowed"] if self.flow is not None else []
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
        """Return the figures as JSON-compatible values."""
        figures = {name: value for name, value in vars(self).items() if name != "image"}
        if self.flow is None:
            del figures["flow"]
        figures["strata"] = {name: {"pixels": n, "bounds": worst} for name, (n, worst) in self.strata.items()}
        return {**figures, "passed": self.passed, "lower_bound": not self.complete}

    def metadata(self) -> dict[str, Any]:
        """Return header attributes for the EXR."""
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


FlowName: TypeAlias = Literal["flow", "flow_back"]  # to the next image, to the one before
FLOWS: tuple[FlowName, ...] = get_args(FlowName)

_TAG, _UNKNOWN = 202021.25, 1e10  # of .flo files, whose readers take values above 1e9 as unknown


@dataclass(frozen=True, eq=False)
class Flow:
    """Optical flow from a frame to another image, see `clshade.flow`.

    vectors: (M, N, 2), pixels to the right and down; NaN in the background, and where the point is not in front of the other
    camera's near plane. occluded: (M, N), True where the other image does not show the point: something hides it, it is
    outside of the image, or its side is culled; and where `vectors` is NaN. to: the scene of the other image, with its
    camera. settings: those of the other image: what it culls, its near plane, and what its layers look through.
    """

    vectors: Floats32
    occluded: Bools
    to: Scene
    settings: Settings

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the vectors as a .flo file, the format of Middlebury's optical flow benchmark.

        Vectors that are NaN become 1e10, which its readers take as unknown.

        Parameters
        ----------
        path : str or path-like
            File name ending in .flo.
        """
        name = checked_path("Flow.save", "path", path)
        if not name.lower().endswith(".flo"):
            raise value_error("Flow.save", "path", "a file name ending in .flo", name)
        rows, columns = self.occluded.shape
        known = np.nan_to_num(self.vectors, nan=_UNKNOWN).astype("<f4")
        write_bytes(name, struct.pack("<fii", _TAG, columns, rows) + known.tobytes())
