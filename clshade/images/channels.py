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
    families: dict[tuple[str, str], dict[str, str]] = {}
    for name in channels:
        prefix, _, last = name.rpartition(".")
        letter = last.upper()
        family = next((family for family in FAMILIES if letter in family and len(letter) == 1), "")
        members = families.setdefault((prefix, family) if family else (name, ""), {})
        members.setdefault(letter if family and letter not in members else name, name)
    groups: dict[str, Group] = {}

    def add(title: str, family: str, names: tuple[str, ...]) -> None:
        while title in groups:  # names in a file may collide in any way
            title += "'"
        groups[title] = Group(family, names, tuple(channels[name] for name in names))

    for (prefix, family), members in families.items():
        letters = "".join(letter for letter in family if letter in members)
        together = tuple(members[letter] for letter in letters) if len(letters) > 1 else ()
        if together:
            title = prefix or letters
            add(title if title not in channels else f"{title}.{letters}", family, together)
        for name in members.values():
            if name not in together:
                add(name, "", (name,))
    return groups


def color_group(channels: Mapping[str, Array]) -> tuple[str, list[Array]] | None:
    """Return the layer that is the image, and its planes R, G, B.

    It is `RGB`, else a gray `Y` or `L` three times, else the first color layer of any name; None if there is none.
    """
    groups = grouped(channels)
    colors = {name: group for name, group in groups.items() if group.family == "RGB" and len(group.planes) == 3}
    if "RGB" not in colors:
        for name in ("Y", "L"):
            if name in groups and len(groups[name].planes) == 1:
                return name, [groups[name].planes[0]] * 3
    name = "RGB" if "RGB" in colors else next(iter(colors), "")
    return (name, list(colors[name].planes)) if colors else None
