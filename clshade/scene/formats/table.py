"""The file formats of scenes, each declared once. A reader is imported when a file of its format is read."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ...base.atomic_files import Path
    from ..framing import Up
    from ..model import Scene
    from ..texture import Lookup
    from .reading import Options, VertexColors

_MODULES = {  # of the functions read_course and so on
    "course": "clshade.scene.formats.course_npy",
    "obj": "clshade.scene.formats.obj",
    "gltf": "clshade.scene.formats.gltf",
    "ply": "clshade.scene.formats.ply",
    "stl": "clshade.scene.formats.stl",
    "scene": "clshade.scene.formats.scene_json",
}


class Format(NamedTuple):
    """A file format of scenes.

    what: its files, in the help. name: of its reader, in _MODULES. takes: arguments of `load` that not all formats take.
    up: the axis that usually points up. vertex_colors: what they usually are. has_sides: whether files say which sides of
    surfaces are lit; both are in others: on a closed surface that changes no pixel, and on one that is open or inside out
    no side stays dark. lookup: of a texture in place of the file's.
    """

    extensions: tuple[str, ...]
    what: str
    name: str
    takes: tuple[str, ...] = ("texture", "crease", "flat", "up")
    up: Up = "y"
    vertex_colors: VertexColors = "srgb"
    has_sides: bool = False
    lookup: Lookup = "standard"

    def read(self, path: Path, options: Options) -> Scene:
        scene: Scene = getattr(import_module(_MODULES[self.name]), f"read_{self.name}")(path, options)
        return scene


_SURFACES = ("texture", "crease", "flat", "up")
FORMATS = (
    Format((".npy",), "course scene", "course", takes=("texture", "focal"), has_sides=True, lookup="course"),
    Format((".obj",), "meshes", "obj", takes=(*_SURFACES, "weld", "vertex_colors")),
    Format(
        (".gltf", ".glb"),
        "meshes",
        "gltf",
        takes=(*_SURFACES, "time", "animation", "vertex_colors"),
        vertex_colors="linear",
        has_sides=True,
    ),
    Format((".ply",), "meshes", "ply", takes=(*_SURFACES, "weld", "vertex_colors")),
    Format((".stl",), "meshes", "stl", up="z"),
    Format((".json",), "saved scene", "scene", takes=(), has_sides=True),
)
BY_EXTENSION = {extension: form for form in FORMATS for extension in form.extensions}
EXTENSIONS = tuple(BY_EXTENSION)


def extensions_with(argument: str) -> tuple[str, ...]:
    """Return the extensions of the formats that take this argument of `load`."""
    return tuple(extension for extension, form in BY_EXTENSION.items() if argument in form.takes)


def listed() -> str:
    """Return the extensions and what they are, in one line."""
    kinds = dict.fromkeys(form.what for form in FORMATS)
    return "; ".join(" ".join([*(e for e, form in BY_EXTENSION.items() if form.what == kind), kind]) for kind in kinds)
