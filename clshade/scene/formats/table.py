"""The file formats of scenes, each declared once. A reader is imported when a file of its format is read."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ...base.atomic_files import Path
    from ..framing import Up
    from ..model import Lookup, Scene
    from .options import Options


class Format(NamedTuple):
    """A file format of scenes.

    what: its files, in the help. takes: arguments of `load` that not all formats take. up: the axis that usually points
    up. has_sides: whether files say which sides of surfaces are lit; both are in others: on a closed surface that changes
    no pixel, and on one that is open or inside out no side stays dark. lookup: of a texture in place of the file's.
    """

    extensions: tuple[str, ...]
    what: str
    read: Callable[[Path, Options], Scene]
    takes: tuple[str, ...] = ("texture", "crease", "flat", "up")
    up: Up = "y"
    has_sides: bool = False
    lookup: Lookup = "standard"


def _course(path: Path, options: Options) -> Scene:
    from .course_npy import read_course

    return read_course(path, options)


def _obj(path: Path, options: Options) -> Scene:
    from .obj import read_obj

    return read_obj(path, options)


def _gltf(path: Path, options: Options) -> Scene:
    from .gltf import read_gltf

    return read_gltf(path, options)


def _ply(path: Path, options: Options) -> Scene:
    from .ply import read_ply

    return read_ply(path, options)


def _stl(path: Path, options: Options) -> Scene:
    from .stl import read_stl

    return read_stl(path, options)


def _json(path: Path, options: Options) -> Scene:
    from .scene_json import read_scene

    return read_scene(path, options)


FORMATS = (
    Format((".npy",), "course scene", _course, takes=("texture", "focal"), has_sides=True, lookup="course"),
    Format((".obj",), "meshes", _obj, takes=("texture", "crease", "flat", "weld", "up")),
    Format(
        (".gltf", ".glb"),
        "meshes",
        _gltf,
        takes=("texture", "crease", "flat", "up", "time", "animation"),
        has_sides=True,
    ),
    Format((".ply",), "meshes", _ply, takes=("texture", "crease", "flat", "weld", "up")),
    Format((".stl",), "meshes", _stl, up="z"),
    Format((".json",), "saved scene", _json, takes=(), has_sides=True),
)
BY_EXTENSION = {extension: each for each in FORMATS for extension in each.extensions}
EXTENSIONS = tuple(BY_EXTENSION)


def extensions_with(argument: str) -> tuple[str, ...]:
    """Return the extensions of the formats that take this argument of `load`."""
    return tuple(extension for extension, each in BY_EXTENSION.items() if argument in each.takes)


def listed() -> str:
    """Return the extensions and what they are, in one line."""
    kinds = dict.fromkeys(each.what for each in FORMATS)
    return "; ".join(" ".join([*(e for e, each in BY_EXTENSION.items() if each.what == kind), kind]) for kind in kinds)
