"""Mistakes made in the OpenCL kernels and in finished images, by other code than what explains them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...base.arrays import Floats

_APART = "fma(twice, normal.{0}, -(l.{0} + view[k].{0}))"
_GATE = "seen[k] = (cosine[k] > 0.0f) & (t[k] < 1.0f);"
_DARK = "    if (!any_lane(some))\n        return;\n"
_LAMBERT = "reals lambert = cosine[k] > 0.0f ? cosine[k] : (reals)(0.0f);"
_REVERSED = tuple((_APART.format(axis), f"-fma(twice, normal.{axis}, view[k].{axis} - l.{axis})") for axis in "xyz")

# Texts of kernels/phong_terms.clh and what stands in their place, by the mistake's label.
KERNELS: dict[str, tuple[tuple[str, str], ...]] = {
    "N.L not clamped": ((_DARK, ""), (_LAMBERT, "reals lambert = cosine[k];")),
    "N.L by absolute value": ((_DARK, ""), (_LAMBERT, "reals lambert = fabs(cosine[k]);")),
    "highlight without gate": ((_DARK, ""), (_GATE, "seen[k] = t[k] < 1.0f;")),
    "R with the wrong sign": _REVERSED,
    "R.V by absolute value": (
        (_GATE, "t[k] = t[k] < 1.0f ? t[k] : 2.0f - t[k];\n        seen[k] = cosine[k] > 0.0f;"),
    ),
    "R without its factor 2": (
        (
            _GATE,
            f"t[k] = 1.0f - (cosine[k] * dot3(normal, view[k]) - dot3(l, view[k]));\n        {_GATE}",
        ),
    ),
}
IMAGES: dict[str, Callable[[Floats], Floats]] = {
    "upside down": lambda image: image[::-1],
    "mirrored": lambda image: image[:, ::-1],
    "turned by 180 degrees": lambda image: image[::-1, ::-1],
    "axes swapped (about the diagonal from the top left)": lambda image: image.swapaxes(0, 1),
}


def rewritten(label: str, source: str, options: Sequence[str]) -> str | None:
    """Return a source with the mistake, for `programs.rewriting`; None if it has no such light."""
    for here, there in KERNELS[label]:
        if here not in source:
            return None
        source = source.replace(here, there)
    return source
