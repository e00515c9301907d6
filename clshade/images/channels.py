"""Grouping of the channels of an image file into layers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ..base.arrays import Array

FAMILIES = ("RGB", "XYZ", "UVW")  # components that belong together, by the last part of a channel's name


class Group(NamedTuple):
    """A layer: one plane (M, N), or two or three of a family of components.

    family: `RGB`, `XYZ` or `UVW`; "" for a single channel.
    names, planes: of its channels, in the family's order.
    """

    family: str
    names: tuple[str, ...]
    planes: tuple[Array, ...]


def grouped(channels: Mapping[str, Array]) -> dict[str, Group]:
    """Return layers by name, in the order of their first channels.

    R, G, B (X, Y, Z; U, V, W) of one prefix, at least two of them, in either case, form the layer of that prefix: N.X,
    N.Y and N.Z are `N`; without a prefix R, G and B are `RGB`. All other channels, including A, are layers of their
    own.
    """
    found: dict[tuple[str, str], dict[str, str]] = {}
    for name in channels:
        prefix, _, last = name.rpartition(".")
        family = next((each for each in FAMILIES if last.upper() in each and len(last) == 1), "")
        members = found.setdefault((prefix, family) if family else (name, ""), {})
        members.setdefault(last.upper() if family and last.upper() not in members else name, name)
    groups: dict[str, Group] = {}
    for (prefix, family), members in found.items():
        letters = [letter for letter in family if letter in members]
        together = [members[letter] for letter in letters] if len(letters) > 1 else []
        if together:
            title = prefix or "".join(letters)
            groups[_free(title if title not in channels else f"{title}.{''.join(letters)}", groups)] = Group(
                family, tuple(together), tuple(channels[name] for name in together)
            )
        for name in members.values():
            if name not in together:
                groups[_free(name, groups)] = Group("", (name,), (channels[name],))
    return groups


def _free(title: str, taken: Mapping[str, Group]) -> str:
    """Return the title, with primes appended while another layer has it: names in a file may collide in any way."""
    while title in taken:
        title += "'"
    return title


def color_group(channels: Mapping[str, Array]) -> tuple[str, list[Array]] | None:
    """Return the layer that is the image, and its planes R, G, B.

    It is `RGB`, else a gray `Y` or `L` three times, else the first color layer of any name; None if there is none.
    """
    groups = grouped(channels)
    colors = {name: group for name, group in groups.items() if group.family == "RGB" and len(group.planes) == 3}
    if "RGB" in colors:
        return "RGB", list(colors["RGB"].planes)
    for name in ("Y", "L"):
        if name in groups and len(groups[name].planes) == 1:
            return name, [groups[name].planes[0]] * 3
    for name, group in colors.items():
        return name, list(group.planes)
    return None
