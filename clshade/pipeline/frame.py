"""A rendered frame: image, layers, what it took, and how to keep it."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, TypedDict, overload

import numpy as np

from ..base import display
from ..base.arrays import Array, Bytes, Floats, Reals, UInt32s
from ..base.spelling import hint
from ..base.validation import choice, flag, known, value_error
from ..base.validation import path as checked_path
from ..images.layer_words import LAYER_WORDS
from ..scene.model import Scene, Settings, default_tonemap
from ..scene.settings import LAYER_REMARKS, LAYERS
from .image_check import Check
from .layer_buffers import material_numbers

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..images.exr import Compression
    from ..images.tonemap import Operator

OTHER_FORMATS = (
    *(".jpg", ".jpeg", ".jp2", ".jxl", ".webp", ".avif", ".heic", ".gif", ".bmp", ".tif", ".tiff", ".tga", ".ico"),
    *(".ppm", ".pgm", ".pnm", ".pfm", ".hdr", ".rgbe", ".pic", ".dds", ".dpx", ".cin", ".psd", ".svg", ".pdf", ".eps"),
    *(
        ".npy",
        ".npz",
        ".csv",
        ".json",
        ".obj",
        ".glb",
        ".gltf",
        ".ply",
        ".stl",
        ".mp4",
        ".mov",
        ".avi",
        ".mkv",
        ".webm",
    ),
)  # extensions by which somebody asks for what is not written here


ASKED = ("Frame.save", "path")  # who is refused, and what, unless a command or another function asks


class SavingOptions(TypedDict, total=False):
    """Keywords of `Frame.save`."""

    tonemap: Operator | None
    exposure: float
    half: bool
    compression: Compression
    crop: bool
    deterministic: bool


SAVING = tuple(SavingOptions.__annotations__)


class Frame:
    """An image with its layers. Arrays are (M, N, ...), row 0 at the top; the frame owns them.

    scene, settings: what was drawn and how. check: what `clshade.check` found of it last, None before.
    """

    def __init__(
        self,
        rgba: Reals,
        layers: Mapping[str, Array],
        scene: Scene,
        settings: Settings,
        stats: Callable[[], dict[str, Any]],
    ) -> None:
        self._rgba, self._layers = rgba, dict(layers)
        self.scene, self.settings = scene, settings
        self.check: Check | None = None
        self._make_stats: Callable[[], dict[str, Any]] | None = stats
        self._stats: dict[str, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        """A frame is pickled with its stats, which a renderer makes only when they are asked for."""
        return {**vars(self), "_stats": self.stats, "_make_stats": None}

    @property
    def rgba(self) -> Reals:
        """(M, N, 4) float32, or float64 with precision float64: linear RGB and coverage."""
        return self._rgba

    @property
    def rgb(self) -> Reals:
        """(M, N, 3), linear, never clamped; composited over the background where there is one."""
        return self._rgba[..., :3]

    @property
    def alpha(self) -> Reals:
        """(M, N) coverage, 0 to 1."""
        return self._rgba[..., 3]

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers that were asked for."""
        return tuple(self._layers)

    @property
    def stats(self) -> dict[str, Any]:
        """Stage times in ms, counts, features used and left out, device."""
        if self._make_stats is not None:
            self._stats, self._make_stats = {**self._make_stats(), "nonfinite": self.scene.nonfinite}, None
        return self._stats

    @overload
    def __getitem__(self, name: Literal["id", "object_id", "material_id"]) -> UInt32s: ...
    @overload
    def __getitem__(self, name: Literal["P"]) -> Floats: ...
    @overload
    def __getitem__(self, name: Literal["Z", "N", "albedo", "uv", "barycentrics"]) -> Reals: ...
    @overload
    def __getitem__(self, name: str) -> Array: ...
    def __getitem__(self, name: str) -> Array:
        """A layer, of each pixel's sample nearest the center, never a mean; (M, N, ...), of the type of `rgba` but where
        another is named. Of the background Z is infinity, everything else 0.

        Z: camera z in scene units. id (uint32): the face's index plus 1, faces counted mesh by mesh, instance by
        instance. object_id, material_id (uint32): the mesh's index in the scene plus 1, all instances alike; the number
        of its material, from 1 in the order of the meshes, equal materials alike. N (3 components): the unit normal
        that the light sees, world space, 0 where there is none. P (3, float64): the position seen, world space, right
        to a few roundings of its distance from the eye. albedo (3): vertex color times material's color times texel,
        what the light is multiplied by. uv (2): texture coordinates as the mesh has them, not wrapped. barycentrics
        (3): the weights of the face's corners, in the order in which the mesh names them. N, albedo, uv and
        barycentrics are interpolated as the settings say; P, as Z, always in perspective.
        """
        if not isinstance(name, str) or name not in self._layers:
            expected = f"one that was asked for with layers= ({', '.join(self._layers) or 'none were'})"
            near = hint(name, LAYERS, LAYER_WORDS, remarks=LAYER_REMARKS)
            raise value_error("Frame", "layer", expected, name, near)
        return self._layers[name]

    def __contains__(self, name: object) -> bool:
        """Whether a layer of this name was asked for."""
        return name in self._layers

    def __iter__(self) -> Iterator[str]:
        """The names of the layers."""
        return iter(self._layers)

    def channels(self) -> dict[str, Array]:
        """The EXR's channels, name -> (M, N); `error` where every pixel was checked."""
        named = {name: self._rgba[..., i] for i, name in enumerate("RGBA")}
        checked = {} if self.check is None or self.check.image is None else {"error": self.check.image}
        return {**named, **self._layers, **checked}

    def metadata(self, *, deterministic: bool = False) -> dict[str, Any]:
        """The EXR's header besides its channels; `deterministic` leaves times out."""
        from ..scene.camera_matrices import camera_metadata

        metadata = camera_metadata(self.scene.camera)
        metadata["settings"] = ", ".join(f"{key}={value}" for key, value in vars(self.settings).items())
        metadata["scene"] = f"{self.scene.name or 'unnamed'}, {self.scene.face_count} triangles"
        metadata |= self._names()
        if not deterministic:
            metadata["renderTimeSeconds"] = self.stats["times_ms"]["frame"] / 1000.0
        return metadata if self.check is None else {**metadata, **self.check.metadata()}

    def _names(self) -> dict[str, str]:
        """What the numbers of the layers object_id and material_id stand for: JSON, number -> name, where it has one."""
        meshes, found = self.scene.meshes, {}
        if "object_id" in self._layers:
            found["objectNames"] = {number: mesh.name for number, mesh in enumerate(meshes, 1) if mesh.name}
        if "material_id" in self._layers:
            numbered = zip(material_numbers(self.scene), meshes, strict=True)
            found["materialNames"] = {n: mesh.material.name for n, mesh in numbered if mesh.material.name}
        return {name: json.dumps(names, ensure_ascii=False) for name, names in found.items() if names}

    def to_png8(self, tonemap: Operator | None = None, exposure: float = 0.0) -> Bytes:
        """(M, N, 3) uint8; tonemap None: `none` for course scenes, else `srgb`."""
        from ..images.tonemap import tonemap as apply

        return apply(self.rgb, tonemap or default_tonemap(self.scene), exposure)

    def __repr__(self) -> str:
        rows, columns = self._rgba.shape[:2]
        layers = f", layers {', '.join(self._layers)}" if self._layers else ""
        return f"<Frame of {self.scene.name or 'an unnamed scene'}, {columns}x{rows}{layers}>"

    def _repr_png_(self) -> bytes:
        """For notebooks: the tone-mapped image, large ones reduced."""
        image: bytes = display.notebook().encoded(self.to_png8())
        return image

    def show(self, tonemap: Operator | None = None, exposure: float = 0.0) -> None:
        """Shows the image: in a notebook below the cell, elsewhere in the desktop's image viewer.

        tonemap, exposure: see `save`. Raises OutputError where no program shows images.
        """
        display.notebook().show_frame(self, tonemap, exposure)

    def plot_layers(self) -> Any:
        """A matplotlib figure of the image, its coverage and all layers, each as what it holds: ids in colors of their own,
        normals as (n + 1)/2, depths and positions by their range, with infinity in gray. Notebooks show it."""
        return display.notebook().plot_layers(self)

    def save(self, path: str | os.PathLike[str], **options: Unpack[SavingOptions]) -> list[str]:
        """Writes path.exr and path.png (an extension .exr or .png of `path` is dropped), whole, or neither of them.

        options: tonemap, exposure: of the PNG, see `clshade.images.tonemap`; tonemap None: `none` for course scenes, else
        `srgb`. half, compression: of the EXR, see `clshade.exr.encode`. crop: keep of the EXR the smallest window that
        holds all that is not background, which must be black or None for that; Z outside reads as infinity here, as 0
        elsewhere. deterministic: leave times out of its header.
        Warns, in a line each, of values that `half` or float32 cannot hold and of what a compression changes; returns
        those lines. Raises OutputError when a file can't be written.
        """
        known("Frame.save", options, SAVING)
        lines = self.write(path, **options)
        for line in lines:
            warnings.warn(line, stacklevel=2)
        return lines

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        tonemap: Operator | None = None,
        exposure: float = 0.0,
        half: bool = False,
        compression: Compression = "zip",
        crop: bool = False,
        deterministic: bool = False,
    ) -> list[str]:
        """The same, for callers that do the warning: its lines are returned."""
        from ..base import atomic_files
        from ..images import exr, png

        for name, value in (("half", half), ("crop", crop), ("deterministic", deterministic)):
            flag("Frame.save", name, value)
        check_output(path, tonemap=tonemap, exposure=exposure, compression=compression)
        paths = output_paths(path)

        def encode_png(file: BinaryIO) -> None:
            with atomic_files.naming(paths[1]):
                png.encode(file, self.to_png8(tonemap, exposure))

        # Both compress outside Python's lock, so they do it side by side.
        with atomic_files.replacing_all(*paths) as (exr_file, png_file), ThreadPoolExecutor(1) as beside:
            encoded = beside.submit(encode_png, png_file)
            with atomic_files.naming(paths[0]):
                lines = exr.encode(
                    exr_file,
                    self.channels(),
                    compression=compression,
                    half=half,
                    metadata=self.metadata(deterministic=deterministic),
                    window="covered" if crop else "drawn",
                )
            encoded.result()
        return lines


def output_paths(path: str | os.PathLike[str], asked: tuple[str, str] = ASKED) -> tuple[Path, Path]:
    """The EXR and the PNG that `Frame.save` writes for `path`. Raises InputError where it names no file, standard
    output, or a file of another format."""
    path = Path(checked_path(*asked, path))
    stem = path.with_suffix("") if path.suffix.lower() in (".exr", ".png") else path
    if stem.name in ("", ".."):
        raise value_error(*asked, "a file name", str(path))
    if path.name == "-" or path.suffix.lower() in OTHER_FORMATS:
        name = path.stem if path.name != "-" else "image"
        both = f"a file name such as {name}, for {name}.exr and {name}.png: other formats are not written"
        raise value_error(*asked, both, str(path))
    return stem.with_name(stem.name + ".exr"), stem.with_name(stem.name + ".png")


def check_output(
    path: str | os.PathLike[str],
    *,
    tonemap: Operator | None = None,
    exposure: float = 0.0,
    compression: Compression = "zip",
    asked: tuple[str, str] = ASKED,
) -> None:
    """Raises what `Frame.save` would for these arguments, as far as can be told without writing."""
    from ..base import atomic_files
    from ..images import exr
    from ..images.tonemap import checked

    checked(tonemap or "srgb", exposure)
    choice("exr", "compression", compression, exr.COMPRESSIONS)
    for file in output_paths(path, asked):
        atomic_files.check(file)


def same_bits(a: Frame, b: Frame) -> bool:
    """Whether two frames agree in every bit of image and layers."""
    return a.layers == b.layers and all(
        np.array_equal(x.view(np.uint32), y.view(np.uint32))
        for x, y in [(a.rgba, b.rgba), *((a[name], b[name]) for name in a.layers)]
    )
