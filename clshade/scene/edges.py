"""Which edges of the meshes are drawn as lines, and how."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from numpy.typing import ArrayLike

from ..base import declare
from ..base.arrays import Converted
from ..base.validation import choice, sequence, value_error
from ..images.colors import Rgb, linear_rgb

EdgeKind: TypeAlias = Literal["all", "feature", "silhouette", "boundary", "nonmanifold"]
EDGE_KINDS: tuple[EdgeKind, ...] = get_args(EdgeKind)
MAX_WIDTH = 64.0  # pixels
WIDTH_STEPS = 256  # a pixel: widths are rounded to this grid, on which coverage is exact
PAPER = (1.0, 1.0, 1.0)  # background of drawings of lines alone

AskedKinds: TypeAlias = EdgeKind | Iterable[EdgeKind]


def _kinds(owner: str, name: str, value: Any) -> tuple[str, ...]:
    kinds = (value,) if isinstance(value, str) else sequence(value)
    if not kinds:
        raise value_error(owner, name, f"names of {', '.join(EDGE_KINDS)}", value)
    for kind in kinds:
        choice(owner, name, kind, EDGE_KINDS)
    return ("all",) if "all" in kinds else tuple(kind for kind in EDGE_KINDS if kind in kinds)


@dataclass(frozen=True)
class Edges:
    """Edges drawn as lines over the surfaces, hidden where a surface lies before them."""

    kinds: Converted[AskedKinds, tuple[EdgeKind, ...]] = declare.other(
        ("all",),
        "str or iterable of str",
        _kinds,
        "KIND,...",
        "which: all; feature, between faces at an angle; silhouette; boundary, of one face; nonmanifold, of more than two, "
        "in red",
        "Normals of faces at `feature` edges differ by more than `angle`. All faces of a `silhouette` lie on the same side "
        "of it, as seen from the eye; that includes boundaries. Vertices at the same place are one. Kept as a tuple.",
    )
    angle: float = declare.real(30.0, "DEG", "least angle of feature edges", unit="degrees", least=0.0, most=180.0)
    width: float = declare.real(
        1.5,
        "PIXELS",
        f"of the lines, at most {MAX_WIDTH:g}",
        "Rounded to 1/256.",
        unit="pixels",
        above=0.0,
        most=MAX_WIDTH,
    )
    color: Converted[ArrayLike, Rgb] = declare.other(
        (0.0, 0.0, 0.0),
        "color",
        linear_rgb,
        "COLOR",
        "of the lines: a name, #rrggbb, or R,G,B, linear",
        "As for `Settings.background`; it is not lit.",
        "black",
    )
    nonmanifold_color: Converted[ArrayLike, Rgb] = declare.other(
        (1.0, 0.0, 0.0), "color", linear_rgb, "COLOR", "of edges of more than two faces", usual="red"
    )
    only: bool = declare.flag(False, "the lines alone, on white, hidden by the surfaces")

    def __post_init__(self) -> None:
        declare.check_fields(self)

    @property
    def steps(self) -> int:
        """The width in 1/256 px, at least 1."""
        return max(1, round(self.width * WIDTH_STEPS))


Edges.__doc__ = declare.documented(Edges)
