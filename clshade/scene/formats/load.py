"""Load scenes from files, by the extension of the file name."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...base import console
from ...base.atomic_files import Path, shown
from ...base.declare import facts_of
from ...base.input_files import file_error, quoted, size_of
from ...base.validation import flag, sequence, value_error
from ...base.validation import path as checked_path
from ...errors import InputError
from ..framing import Up
from ..lights import LIGHTS
from ..model import Scene, Texture
from .reading import FPS, Options, VertexColors, as_texture
from .table import BY_EXTENSION, EXTENSIONS, Format, extensions_with

if TYPE_CHECKING:
    from .gltf import Played


def load(
    path: Path,
    *,
    texture: Path | ArrayLike | Texture | None = None,
    focal: float | None = None,
    resolution: tuple[int, int] | None = None,
    lights: Sequence[int] | None = None,
    crease: float | None = None,
    flat: bool = False,
    weld: bool | None = None,
    up: Up | None = None,
    two_sided: bool | None = None,
    fit: bool = False,
    time: float | None = None,
    animation: str | int | None = None,
    vertex_colors: VertexColors | None = None,
) -> Scene:
    """Load a scene from a file.

    A .npy file is a course scene (preset `course`), a .json file a scene of `Scene.to_json`; others
    are meshes (preset `pbr` of glTF files, else `standard`), see clshade/scene/formats/README.md.

    Parameters
    ----------
    path : str or path-like
        File; its extension selects the format.
    texture : str, path-like, array_like or Texture, optional
        Image in place of the file's: an array (h, w, 3) of linear values (integers are divided by
        their type's maximum; row 0 is v = 0), or an image file, which is value/255 for a course
        scene, where it replaces the vertex colors, and decoded from sRGB for a mesh. Not for .json.
    focal : float, optional
        For course files: distance of the image plane from the eye, scene units, in place of the
        file's.
    resolution : (int, int), optional
        (N, M), columns and rows, 1 to 16384 each; the image plane keeps its height, pixels become
        square. Default: the file's, or 800 x 600 for a mesh.
    lights : sequence of int, optional
        Indices, from 0, of the lights to keep, in this order; a mesh has three: key, fill and rim.
        Default: all.
    crease : float, optional
        Degrees, 0 to 180: edges with a larger angle between their faces are sharp, where a mesh lacks
        normals. Default: everything is smooth, but flat in glTF (as its specification says) and STL.
    flat : bool, default False
        Means crease=0; not allowed together with `crease`.
    weld : bool, optional
        Join vertices at one position, for normals, where an OBJ or PLY file has none and at most 30
        degrees lie between the faces, so that no seam shows; `crease` always does. Default: False, but
        True on the command line.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up in the view chosen for a mesh; a camera of a glTF file is not turned.
        Default: z for STL, y for most.
    two_sided : bool, optional
        Light surfaces seen from behind like those seen from the front. Default: as the glTF file
        says; True where its format cannot say.
    fit : bool, default False
        Choose a camera that shows all of the scene, in place of the file's.
    time : float, optional
        Show a glTF file as its animation has it after so many seconds, at least 0; after its end as
        at its end. Default: at rest, with the values that the file has outside animations.
    animation : str or int, optional
        Name of the animation, or its number from 0, see `Scene.animations`; "all": all at once (some
        exporters write one for each node; of several for one property the last counts). Without
        `time`: its beginning. Default: the first.
    vertex_colors : {"srgb", "linear"}, optional
        Whether colors at vertices of an OBJ, PLY or glTF file are codes of sRGB, to be decoded, or
        linear. Default: linear in glTF, as its specification says, else srgb.

    Raises
    ------
    InputError
        The file is missing, unknown, malformed or too large, or an argument is out of range. One
        line names the file, the field (and line), what was expected and what was found.

    Warns
    -----
    UserWarning
        One line on missing files that the file refers to, or on content that is ignored; features
        that are not rendered are also listed in `Scene.ignored`.

    Notes
    -----
    A mesh gets a camera that shows all of its vertices (`clshade.scene.framing.fitted`) and lights
    around it, unless a glTF file has its own; `Scene.fitted` says whether it got the camera.
    Materials and images are opened only inside the file's own folder. Code in a file is never run,
    and nothing is fetched. Loading that takes more than a second is announced on stderr.

    Examples
    --------
    >>> scene = clshade.load("bunny.ply", resolution=(1920, 1080), crease=40)
    """
    arguments = {**locals()}
    with _opened("load", arguments) as (form, options):
        scene = form.read(path, options)
    return scene if lights is None else replace(scene, lights=_kept(scene, lights))


def load_animation(
    path: Path,
    animation: str | int | None = None,
    *,
    count: int | None = None,
    fps: float = FPS,
    texture: Path | ArrayLike | Texture | None = None,
    resolution: tuple[int, int] | None = None,
    crease: float | None = None,
    flat: bool = False,
    up: Up | None = None,
    two_sided: bool | None = None,
    fit: bool = False,
    vertex_colors: VertexColors | None = None,
) -> Played:
    """Load a glTF file as the frames of one of its animations.

    Parameters
    ----------
    path : str or path-like
        File, .gltf or .glb.
    animation : str or int, optional
        As for `load`; a file that has none is refused.
    count : int, optional
        Number of frames, 1 to 1,000,000. Default: as many as `fps` takes, at least 1.
    fps : float, default 30
        Frames per second of the animation's time, rounded so that they divide its length.
    texture, resolution, crease, flat, up, two_sided, fit, vertex_colors
        As for `load`.

    Returns
    -------
    Played
        `scene` is the first frame, with a camera and lights that suit all of them; `poses` and
        `cameras`, by frame number, are what `clshade.farm.draw_frames` takes beside it.

    Examples
    --------
    >>> run = clshade.load_animation("fox.glb", "Run", fps=24)
    >>> clshade.farm.draw_frames(run.scene, run.cameras, "run.##.exr", poses=run.poses)
    """
    arguments = {**locals()}
    with _opened("load_animation", arguments) as (_, options):
        from .gltf import play

        return play(path, options, count=count, fps=fps)


@contextlib.contextmanager
def _opened(who: str, arguments: dict[str, Any]) -> Iterator[tuple[Format, Options]]:
    """Yield the format of a file, and the options of `load` for it from the arguments of `who`. Errors of the block become
    InputErrors of one line that names the file; a slow block is announced."""
    path: Any = arguments["path"]
    checked_path(who, "path", path)
    owner, extension = shown(path), os.path.splitext(os.fspath(path))[1].lower()
    if extension not in BY_EXTENSION:
        raise _no_scene(path, owner, extension)
    form = BY_EXTENSION[extension]
    if who == "load_animation" and "animation" not in form.takes:
        expected = f"one of {', '.join(extensions_with('animation'))}, which have animations"
        raise file_error(owner, "extension", expected, quoted(extension))
    try:
        with console.told_when_slow(f"loading {owner} ..."):
            yield form, _options(who, form, arguments)
    except InputError as error:
        # In one line, with the file in front where it names only a class of the scene model.
        text = " ".join(str(error).split()) if not str(error).isprintable() else str(error)
        raise InputError(f"{owner}: {text}" if text.split(":")[0].split(" ")[0] in _OF_MODEL else text) from None
    except MemoryError:
        raise file_error(owner, "file", "a scene that fits into memory", "too large a one") from None


def _options(who: str, form: Format, arguments: dict[str, Any]) -> Options:
    checks = {
        **facts_of(Options, "check"),
        "flat": flag,
        "texture": lambda who, name, value: as_texture(value, srgb=form.lookup == "standard", lookup=form.lookup),
    }
    flat = flag(who, "flat", arguments["flat"])
    values = {name: arguments[name] for name in checks if arguments.get(name) is not None and (name != "flat" or flat)}
    for name, value in values.items():
        if name not in (*form.takes, "resolution", "two_sided", "fit"):
            *first, last = extensions_with(name)
            formats = f"{', '.join(first)} and {last}" if first else last
            raise value_error(who, name, f"one only for {formats} files", value)
    options = {name: checks[name](who, name, value) for name, value in values.items()}
    if options.pop("flat", False):
        if "crease" in options:
            raise InputError(f"{who}: crease: expected either crease or flat, which is a crease of 0, found both")
        options["crease"] = 0.0
    usual = {"up": form.up, "vertex_colors": form.vertex_colors, "two_sided": None if form.has_sides else True}
    return Options(**usual | options)


def _no_scene(path: Path, owner: str, extension: str) -> InputError:
    """Build the error for a file with another extension: it is missing, or something else."""
    extensions, kind = ", ".join(EXTENSIONS), f"the extension {quoted(extension)}" if extension else "no extension"
    try:
        os.stat(path)
    except FileNotFoundError:
        return file_error(owner, "file", f"an existing file, one of {extensions}", f"no such file, and {kind}")
    except (OSError, ValueError):
        pass  # reported by the next line, as are folders and devices
    size_of(path)
    image = extension in (".exr", ".png")
    hint = ", an image: `clshade inspect` shows it, and -o names the output" if image else ""
    return file_error(owner, "extension", f"one of {extensions}", f"{quoted(extension)}{hint}")


def _kept(scene: Scene, selection: Any) -> tuple[Any, ...]:
    """Return the lights with these indices. Raises InputError for one that does not exist or is repeated."""
    count = len(scene.lights)
    indices = sequence(selection)
    good = indices is not None and all(isinstance(index, (int, np.integer)) and 0 <= index < count for index in indices)
    if indices is None or not good or len(set(indices)) != len(indices):
        expected = f"different indices of the {count} lights, from 0" if count else "none: the scene has no lights"
        raise value_error("load", "lights", expected, selection)
    return tuple(scene.lights[index] for index in indices)


# Classes that a scene consists of, whose errors do not name the file.
_OF_MODEL = {"Camera", "Texture", "Material", "MetallicRoughness", "Mesh", "Scene", *(kind.__name__ for kind in LIGHTS)}
