"""The files of a rendered frame: their names, what they hold, and how to write them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Container, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, TypeAlias, TypedDict, get_args

import numpy as np

from ..base import atomic_files
from ..base.arrays import Array, Bytes
from ..base.atomic_files import Path as AnyPath
from ..base.validation import choice, flag, known, number, sequence, value_error
from ..base.validation import path as checked_path
from ..errors import InputError
from ..images.depth_png import SCALE
from ..images.layers import LAYER_TABLE
from ..scene.formats.table import EXTENSIONS
from ..scene.model import Scene, Settings, default_tonemap
from ..scene.scalar_colors import color_map_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..images.exr import Compression
    from ..images.tonemap import Operator

FileKind: TypeAlias = Literal["exr", "png", "npz", "depth"]
KINDS: tuple[FileKind, ...] = get_args(FileKind)
FILES: tuple[FileKind, ...] = ("exr", "png")  # written by default
ENDINGS: dict[FileKind, str] = {"exr": ".exr", "png": ".png", "npz": ".npz", "depth": ".depth.png"}
Encoder: TypeAlias = Callable[[BinaryIO], list[str] | None]  # writes to an open file, returns warnings


class SavingOptions(TypedDict, total=False):
    """Keywords of `Frame.save`."""

    files: Sequence[FileKind] | None
    tonemap: Operator | None
    exposure: float
    half: bool
    compression: Compression
    crop: bool
    deterministic: bool
    colorbar: bool
    depth_scale: float


_DEFAULTS: SavingOptions = {"files": None, "tonemap": None, "exposure": 0.0, "half": False, "compression": "zip"}
_DEFAULTS |= {"crop": False, "deterministic": False, "colorbar": False, "depth_scale": SCALE}
SAVING = tuple(_DEFAULTS)
ASKED = ("Frame.save", "path")

# Headers leave fields of Settings out where they are as by default, from this one on.
_FIRST_LEFT_OUT = [field.name for field in fields(Settings)].index("scalars")

_IMAGES = ".jpg .jpeg .jp2 .jxl .webp .avif .heic .gif .apng .bmp .tif .tiff .tga .ico .ppm .pgm .pnm .pfm"
_IMAGES += " .hdr .rgbe .pic .dds .dpx .cin .psd .svg .pdf .eps"
_OTHERS = ".csv .mp4 .mov .avi .mkv .webm"
OTHER_FORMATS = (*_IMAGES.split(), *EXTENSIONS, *_OTHERS.split())  # extensions of formats that are not written


def output_paths(path: AnyPath, argument: tuple[str, str] = ASKED) -> tuple[Path, Path]:
    """Return the paths of the EXR and the PNG that `Frame.save` writes for `path`. Raises InputError if it names no file,
    standard output, or a file of another format. argument: function and argument that errors name."""
    stem = _stem(path, argument)
    return stem.with_name(stem.name + ".exr"), stem.with_name(stem.name + ".png")


def _stem(path: AnyPath, argument: tuple[str, str]) -> Path:
    """Return what the names of all files for `path` begin with. Raises InputError like `output_paths`."""
    path = Path(checked_path(*argument, path))
    ending = path.suffix.lower()
    stem = path.with_suffix("") if ending in (".exr", ".png", ".npz") else path
    if stem.name in ("", ".."):
        raise value_error(*argument, "a file name", str(path))
    if path.name == "-" or ending in OTHER_FORMATS:
        name = path.stem if path.name != "-" else "image"
        both = f"a file name such as {name}, for {name}.exr and {name}.png: other formats are not written"
        raise value_error(*argument, both, str(path))
    return stem


def visible_path(path: AnyPath, ending: str, argument: tuple[str, str] = ASKED) -> Path:
    """Return the path of the table of shares of instances that is written with `path`. ending: csv or json."""
    stem = _stem(path, argument)
    return stem.with_name(f"{stem.name}_visible.{ending}")


def default_files(path: AnyPath) -> tuple[FileKind, ...]:
    """Return the files that `Frame.save` writes for `path` unless it is told which."""
    return ("npz",) if os.fspath(path).lower().endswith(".npz") else FILES


def chosen_paths(path: AnyPath, files: Sequence[FileKind] | None = None) -> dict[FileKind, Path]:
    """Return the paths of the files that `Frame.save` writes. Raises InputError like `output_paths`, and for files other
    than KINDS, or none."""
    stem = _stem(path, ASKED)
    chosen = default_files(path) if files is None else sequence(files)
    if not chosen or isinstance(files, str):
        raise value_error("Frame.save", "files", f"some of {', '.join(KINDS)}, such as ('png',)", files)
    for kind in chosen:
        choice("Frame.save", "files", kind, KINDS)
    return {kind: stem.with_name(stem.name + ENDINGS[kind]) for kind in KINDS if kind in chosen}


def check_layers(files: Container[str], layers: Container[str]) -> None:
    """Raise InputError if a file shows a layer that is not there."""
    if "depth" in files and "Z" not in layers:
        raise InputError("Frame.save: files: depth needs a frame with the layer Z")


def check_output(
    path: AnyPath,
    settings: Settings | None = None,
    argument: tuple[str, str] = ASKED,
    **options: Unpack[SavingOptions],
) -> SavingOptions:
    """Return the options of `Frame.save`, complete with defaults. Raises what it would raise for these arguments, as far as
    can be known without writing. settings: of the frame, which needs scalars for a colorbar."""
    from ..images import exr
    from ..images.tonemap import checked

    known("Frame.save", options, SAVING)
    chosen: SavingOptions = {**_DEFAULTS, **options}
    for name, value in chosen.items():
        if name in ("half", "crop", "deterministic", "colorbar"):
            flag("Frame.save", name, value)
    if chosen["colorbar"] and settings is not None and settings.scalars is None:
        raise InputError("Frame.save: colorbar: needs scalars, whose color map it shows")
    checked("srgb" if chosen["tonemap"] is None else chosen["tonemap"], chosen["exposure"])
    choice("exr", "compression", chosen["compression"], exr.COMPRESSIONS)
    number("Frame.save", "depth_scale", chosen["depth_scale"], above=0.0)
    _stem(path, argument)
    for file in chosen_paths(path, chosen["files"]).values():
        atomic_files.check(file)
    return chosen


def header(scene: Scene, settings: Settings, layers: Container[str]) -> dict[str, Any]:
    """Return the EXR's header attributes that do not depend on times or checks; see `Frame.metadata`."""
    from ..scene.geometry import camera_metadata
    from .layers import number_names

    attributes = camera_metadata(scene.camera)
    values = [(field.name, getattr(settings, field.name), field.default) for field in fields(settings)]
    written = (each for k, each in enumerate(values) if k < _FIRST_LEFT_OUT or each[1] != each[2])
    attributes["settings"] = ", ".join(f"{name}={value}" for name, value, _ in written)
    if settings.scalars is not None:
        color_map = color_map_of(scene, settings.scalars)
        attributes |= {"scalarName": settings.scalars.name, "scalarLow": color_map.low, "scalarHigh": color_map.high}
    attributes["scene"] = f"{scene.name or 'unnamed'}, {scene.face_count} triangles"
    around = scene.environment
    if around is not None and (settings.shader == "pbr" or settings.background == "environment"):
        turned = f"rotation={around.rotation:g}, intensity={around.intensity:g}"
        attributes["environment"] = f"{around.name or 'unnamed'}, {turned}"
    for layer, row in LAYER_TABLE.items():  # the names of what their numbers count as JSON, number -> name
        if row.names and layer in layers:
            names = {number: name for number, name in number_names(scene, layer) if name}
            attributes |= {row.names: json.dumps(names, ensure_ascii=False)} if names else {}
    return attributes


def with_colorbar(image: Bytes, scene: Scene, settings: Settings, tonemap: Operator | None, exposure: float) -> Bytes:
    """Return the 8-bit image with a bar of the color map of `settings.scalars` to its right, on its background, or
    on white if that is no color."""
    from ..images import figures
    from ..images.tonemap import WHITE
    from ..images.tonemap import tonemap as apply

    scalars: Any = settings.scalars
    ground = np.array(WHITE, np.uint8)
    if scene.background is not None and settings.background != "environment":
        color = np.asarray(scene.background, np.float32)[None, None]
        ground = apply(color, tonemap or default_tonemap(scene), exposure)[0, 0]
    color_map = color_map_of(scene, scalars)
    return figures.with_colorbar(image, scalars.colormap, (color_map.low, color_map.high), scalars.name, ground)


def encode_npz(file: BinaryIO, arrays: Mapping[str, Array]) -> None:
    """Write arrays to an open .npz, as `numpy.savez_compressed` does; `numpy.load` reads them without pickle.

    Equal arrays give equal bytes: members have the date 1980-01-01, which `ZipFile.open` gives them.
    Raises ValueError for arrays of objects.
    """
    import zipfile

    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:  # higher ones gain little
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)


def write_files(paths: Mapping[FileKind, Path], encoders: Mapping[FileKind, Encoder]) -> list[str]:
    """Write the files of `chosen_paths`, all or none; return the warnings. Raises OutputError."""
    with atomic_files.replacing_all(*paths.values()) as opened:
        file = dict(zip(paths, opened, strict=True))

        def write(kind: FileKind) -> list[str]:
            with atomic_files.naming(paths[kind]):
                return encoders[kind](file[kind]) or []

        first, *others = paths
        # All release the GIL while they compress, so they run concurrently.
        with ThreadPoolExecutor(max(1, len(others))) as beside:
            waiting = [beside.submit(write, kind) for kind in others]
            lines = write(first)
            return [*lines, *(line for future in waiting for line in future.result())]
