"""Work-precision curves: error against time within families of variants, with fitted powers beside those of theory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...errors import InputError
from ...scene.settings import Precision
from ..timing import Spread
from .measure import Measured
from .power_law import Law, Power, fitted
from .ray_count_errors import MOST, RayCount
from .tessellation import Tessellation
from .variants import BASE, RAY_BASE, Variant

# Largest relative error of one operation: of float32 and float64 half a unit in the last place; of `fast` that of its power
# (kernels/numerics.clh).
ROUNDOFF: dict[Precision, float] = {"fast": 7.4e-6, "float32": 2.0**-24, "float64": 2.0**-53}
SAMPLES, SHADED, GOURAUD, FILTER, PRECISION = "samples", "shaded", "gouraud", "filter", "precision"
LIGHT, OCCLUSION = "light-samples", "occlusion-rays"
COUNTED: dict[str, RayCount] = {LIGHT: "light_samples", OCCLUSION: "ambient_occlusion"}
COUNTS = {LIGHT: "points of each light", OCCLUSION: "rays of each point"}
SHADINGS = {"gouraud": "tessellation, Gouraud", "phong": "tessellation, Phong"}
# Families that differ in the number of samples or rays: the prefix of their variants, and another that
# belongs to them.
SAMPLED = {
    SAMPLES: ("samples-", BASE),
    SHADED: ("shaded-", BASE),
    GOURAUD: ("gouraud-", "gouraud"),
    FILTER: ("trilinear-", "trilinear"),
    LIGHT: ("light-", RAY_BASE),
    OCCLUSION: ("occlusion-", RAY_BASE),
}
SMOOTH = Law(-1.0, "second order in the length of edges", "coarse spheres miss the highlight")
LAWS = {
    SAMPLES: Law(-0.75, "edges in each pixel", "textures and light are looked up once, and their aliasing stays"),
    SHADED: Law(-0.75, "edges in each pixel", below="light and textures vary smoothly in a pixel"),
    GOURAUD: Law(
        0.0, "light at the corners, whose error samples do not cure", below="edges become smooth all the same"
    ),
    FILTER: Law(0.0, "the mip maps' blur, which samples do not cure", below="edges become smooth all the same"),
    LIGHT: Law(-1.0, "points of low discrepancy, light that varies smoothly", "edges of shadows cut the lights"),
    OCCLUSION: Law(-0.75, "points of low discrepancy, edges of what is near"),
    PRECISION: Law(
        1.0,
        "a constant number of roundings",
        "each rounding counts more often",
        "`fast` rounds directions and powers alone, so that its other errors are smaller",
    ),
    **dict.fromkeys(SHADINGS.values(), SMOOTH),
}
TITLES = {SAMPLES: "shaded once", SHADED: "each shaded", GOURAUD: "Gouraud", FILTER: "mip maps"}
ABOUT = {
    SAMPLES: "samples shaded once a pixel",
    SHADED: "samples, each shaded",
    GOURAUD: "light at the corners, samples shaded once a pixel",
    FILTER: "mip maps instead of four texels, samples shaded once a pixel",
    LIGHT: f"points of each light of finite size, against {MOST['light_samples']} of them in the same 16 samples",
    OCCLUSION: f"rays of ambient occlusion, against {MOST['ambient_occlusion']} of them in the same 16 samples",
    PRECISION: "arithmetic: RMS of |value - oracle| / light",
    **dict.fromkeys(SHADINGS.values(), "triangles of a sphere"),
}


class Member(NamedTuple):
    """One variant of a family. size: what the family varies. error: 0 if nothing was found. known: the fit uses it."""

    name: str
    size: float
    ms: Spread
    error: float
    known: bool


@dataclass(frozen=True)
class Family:
    """Variants that differ in one size. what: that size in words. members: by size."""

    name: str
    what: str
    members: tuple[Member, ...]

    @property
    def title(self) -> str:
        """For people."""
        return TITLES.get(self.name, self.name)

    @property
    def law(self) -> Law:
        return LAWS[self.name]

    @property
    def fit(self) -> tuple[Member, ...]:
        """The members whose errors are known."""
        return tuple(each for each in self.members if each.known)

    def by_size(self) -> Power:
        """Return the power of the size that the error follows."""
        return fitted([each.size for each in self.fit], [each.error for each in self.fit])

    def by_time(self) -> Power:
        """Return the power of a frame's time that the error follows."""
        return fitted([each.ms.median for each in self.fit], [each.error for each in self.fit])

    def gain(self) -> float:
        """Return how many times as large the largest known error is as the least."""
        errors = [each.error for each in self.fit]
        return max(errors) / min(errors)

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "family": self.name,
            "about": ABOUT[self.name],
            "size": self.what,
            "members": [{**each._asdict(), "ms": each.ms._asdict()} for each in self.members],
            "slope": self.by_size()._asdict(),
            "by_time": self.by_time()._asdict(),
            "gain": self.gain(),
            "expected": self.law.exponent,
        }


def families(measured: Sequence[Measured], sphere: Tessellation | None, known: float) -> list[Family]:
    """Return the families with three or more known errors: of samples, of precision, and of the sphere's triangles.

    known: the reference's error; errors of images below it are not known.
    """
    found = [_sampled(name, measured, known) for name in SAMPLED]
    found.append(_precision(measured))
    if sphere is not None:
        found += [_tessellated(shader, sphere) for shader in sphere.errors]
    return [each for each in found if len(each.fit) > 2]


def alone(variant: Variant, family: str) -> bool:
    """Return whether the variant belongs to a family: whether it changes nothing but what that varies."""
    if family == PRECISION:
        return not variant.changes.keys() - {"precision"}
    prefix, first = SAMPLED[family]
    return variant.name == first or variant.name.startswith(prefix)


def _sampled(name: str, measured: Sequence[Measured], known: float) -> Family:
    variants = {_size(each, name): each for each in measured if alone(each.variant, name)}
    if 1 not in variants:
        return Family(name, "", ())
    rays = COUNTED.get(name)
    errors = {n: (each.rays.get(rays) or 0.0) if rays else each.error for n, each in variants.items()}
    least = 0.0 if rays else known
    members = (
        Member(each.variant.name, n, each.frame_ms, errors[n], errors[n] > least)
        for n, each in sorted(variants.items())
    )
    return Family(name, f"the number of {COUNTS.get(name, 'samples')}", tuple(members))


def _size(each: Measured, family: str) -> int:
    count: int = getattr(each.settings, COUNTED.get(family, "samples"))
    return count


def _precision(measured: Sequence[Measured]) -> Family:
    variants = {each.settings.precision: each for each in measured if alone(each.variant, PRECISION)}
    members = []
    for name, roundoff in ROUNDOFF.items():
        if name in variants:
            error = variants[name].arithmetic.rms
            members.append(Member(variants[name].variant.name, roundoff, variants[name].frame_ms, error, error > 0.0))
    return Family(PRECISION, "the roundoff of an operation", tuple(members))


def _tessellated(shader: str, sphere: Tessellation) -> Family:
    each = zip(sphere.triangles, sphere.ms[shader], sphere.errors[shader], strict=True)
    members = (Member(f"{count:,}", count, ms, error, error > 0.0) for count, ms, error in each)
    return Family(SHADINGS[shader], "the number of triangles", tuple(members))


def of_families(variants: Sequence[Variant], names: Sequence[str]) -> list[Variant]:
    """Return the variants of these families, all without names. Raises InputError if one has fewer than three, too few to
    fit."""
    chosen: list[Variant] = []
    for name in names:
        own = [each for each in variants if alone(each, name)]
        if len(own) < 3:
            found = ", ".join(each.name for each in own) or "none"
            raise InputError(f"report: --family: three variants that change this scene are needed, {name} has {found}")
        chosen += [each for each in own if each not in chosen]
    return chosen if names else list(variants)
