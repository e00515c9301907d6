"""Which edges of the meshes are drawn as lines, and how."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

from numpy.typing import ArrayLike

from ..base.arrays import Converted, kept
from ..base.validation import choice, flag, number, sequence, set_fields, value_error
from ..images.colors import Rgb, linear_rgb

EdgeKind: TypeAlias = Literal["all", "feature", "silhouette", "boundary", "nonmanifold"]
EDGE_KINDS: tuple[EdgeKind, ...] = get_args(EdgeKind)
MAX_WIDTH = 64.0  # pixels
WIDTH_STEPS = 256  # a pixel: widths are rounded to this grid, on which coverage is exact
PAPER = (1.0, 1.0, 1.0)  # background of drawings of lines alone

AskedKinds: TypeAlias = EdgeKind | Iterable[EdgeKind]


@dataclass(frozen=True)
class Edges:
    """Edges drawn as lines over the surfaces, hidden where a surface lies before them.

    Attributes
    ----------
    kinds : str or iterable of str, default ("all",)
        `all`: every edge. `feature`: between two faces whose normals differ by more than `angle`.
        `silhouette`: all of its faces lie on the same side of it, as seen from the eye; that
        includes boundaries. `boundary`: of one face. `nonmanifold`: of more than two. Vertices at
        the same place are one. Kept as a tuple.
    angle : float, default 30
        Of `feature`, degrees, 0 to 180.
    width : float, default 1.5
        Of the lines, pixels, at most 64; rounded to 1/256.
    color, nonmanifold_color : color, default black and red
        Of the lines, and of those along edges of more than two faces, three linear numbers or a
        text as for `Settings.background`. They are not lit.
    only : bool, default False
        Draw the lines alone, on white: surfaces only hide them.

    Raises
    ------
    InputError
        A value is not allowed; the message names the field.
    """

    kinds: Converted[AskedKinds, tuple[EdgeKind, ...]] = field(default=kept(("all",)))
    angle: float = 30.0
    width: float = 1.5
    color: Converted[ArrayLike, Rgb] = field(default=kept((0.0, 0.0, 0.0)))
    nonmanifold_color: Converted[ArrayLike, Rgb] = field(default=kept((1.0, 0.0, 0.0)))
    only: bool = False

    def __post_init__(self) -> None:
        kinds = (self.kinds,) if isinstance(self.kinds, str) else sequence(self.kinds)
        if not kinds:
            raise value_error("Edges", "kinds", f"names of {', '.join(EDGE_KINDS)}", self.kinds)
        for kind in kinds:
            choice("Edges", "kinds", kind, EDGE_KINDS)
        asked = ("all",) if "all" in kinds else tuple(kind for kind in EDGE_KINDS if kind in kinds)
        angle = number("Edges", "angle", self.angle, least=0.0)
        if angle > 180.0:
            raise value_error("Edges", "angle", "degrees from 0 to 180", self.angle)
        width = number("Edges", "width", self.width, above=0.0)
        if width > MAX_WIDTH:
            raise value_error("Edges", "width", f"pixels above 0, at most {MAX_WIDTH:g}", self.width)
        set_fields(self, kinds=asked, angle=angle, width=width, only=flag("Edges", "only", self.only))
        for name in ("color", "nonmanifold_color"):
            set_fields(self, **{name: linear_rgb("Edges", name, getattr(self, name))})

    @property
    def steps(self) -> int:
        """The width in 1/256 px, at least 1."""
        return max(1, round(self.width * WIDTH_STEPS))
