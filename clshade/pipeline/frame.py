"""A rendered frame: image, layers, statistics, and how to save it."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, TypeAlias, TypedDict, get_args, overload

import numpy as np

from ..base import display
from ..base.arrays import Array, Bytes, Floats, Reals, UInt32s
from ..base.spelling import hint
from ..base.validation import choice, flag, known, value_error
from ..base.validation import path as checked_path
from ..images.layer_words import LAYER_WORDS
from ..scene.model import Scene, Settings, default_tonemap
from ..scene.scalar_colors import color_map_of
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
)  # extensions of formats that are not written


ASKED = ("Frame.save", "path")  # function and argument that errors name, unless a caller names its own


FileKind: TypeAlias = Literal["exr", "png"]
FILES: tuple[FileKind, ...] = get_args(FileKind)  # in the order of `output_paths`


class SavingOptions(TypedDict, total=False):
    """Keywords of `Frame.save`."""

    files: Sequence[FileKind]
    tonemap: Operator | None
    exposure: float
    half: bool
    compression: Compression
    crop: bool
    deterministic: bool
    colorbar: bool


SAVING = tuple(SavingOptions.__annotations__)


class Frame:
    """A rendered image with its layers.

    ``frame[name]`` gives a layer, ``name in frame`` tests for one, and iteration gives their names.
    M and N are the numbers of rows and columns; row 0 is at the top. The frame owns its arrays.

    Attributes
    ----------
    scene : Scene
        What was drawn.
    settings : Settings
        How it was drawn.
    check : Check or None
        The latest result of `clshade.check`, None before.
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
        """Pickle the frame with its stats, which are computed only on request."""
        return {**vars(self), "_stats": self.stats, "_make_stats": None}

    @property
    def rgba(self) -> Reals:
        """(M, N, 4) float32, or float64 with precision float64: linear RGB and coverage."""
        return self._rgba

    @property
    def rgb(self) -> Reals:
        """(M, N, 3), linear, never clamped; composited over the background if there is one."""
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
        """Times of the stages in ms, counts, features used and left out, device."""
        make = self._make_stats  # another thread may be here at the same time
        if make is not None:
            self._stats, self._make_stats = {**make(), "nonfinite": self.scene.nonfinite}, None
        return self._stats

    @overload
    def __getitem__(self, name: Literal["id", "object_id", "material_id"]) -> UInt32s: ...
    @overload
    def __getitem__(self, name: Literal["P"]) -> Floats: ...
    @overload
    def __getitem__(self, name: Literal["Z", "N", "albedo", "uv", "barycentrics", "scalar"]) -> Reals: ...
    @overload
    def __getitem__(self, name: str) -> Array: ...
    def __getitem__(self, name: str) -> Array:
        """Return a layer.

        Layers are sampled at each pixel's sample nearest the center, never averaged.

        Parameters
        ----------
        name : str
            One of the layers that were asked for:

            ``"Z"``
                Camera z in scene units; infinity in the background.
            ``"id"``
                uint32, the face's index plus 1; faces are counted mesh by mesh, instance by
                instance.
            ``"object_id"``
                uint32, the mesh's index in the scene plus 1, the same for all instances.
            ``"material_id"``
                uint32, the number of the mesh's material, from 1 in the order of the meshes; equal
                materials have the same number.
            ``"N"``
                3 components: the unit normal used for lighting, in world space; 0 where there is
                none.
            ``"P"``
                3 components, float64: the visible point in world space, accurate to a few roundings
                of its distance from the eye.
            ``"albedo"``
                3 components: vertex color times material color times texel, or the color of the
                color map: the factor of the light.
            ``"uv"``
                2 components: the mesh's texture coordinates, not wrapped.
            ``"barycentrics"``
                3 components: the barycentric coordinates, in the order of the face's corners in the
                mesh.
            ``"scalar"``
                The scalar that ``settings.scalars`` names, before its color map; NaN where there is
                none.

        Returns
        -------
        ndarray
            (M, N) or (M, N, components), of the type of `rgba` unless another is named above. 0 in
            the background, except for Z and scalar.

        Raises
        ------
        InputError
            If the layer was not asked for.

        Notes
        -----
        N, albedo, uv, barycentrics and scalar are interpolated as ``settings.interpolation`` says; P and Z
        are always interpolated in perspective.
        """
        if not isinstance(name, str) or name not in self._layers:
            expected = f"one that was asked for with layers= ({', '.join(self._layers) or 'none were'})"
            near = hint(name, LAYERS, LAYER_WORDS, remarks=LAYER_REMARKS)
            raise value_error("Frame", "layer", expected, name, near)
        return self._layers[name]

    def __contains__(self, name: object) -> bool:
        """Return whether a layer of this name was asked for."""
        return name in self._layers

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the layers."""
        return iter(self._layers)

    def channels(self) -> dict[str, Array]:
        """Return the EXR's channels.

        Returns
        -------
        dict of str to ndarray
            R, G, B, A and the layers, by name; also ``error``, (M, N), if every pixel was checked.
        """
        named = {name: self._rgba[..., i] for i, name in enumerate("RGBA")}
        checked = {} if self.check is None or self.check.image is None else {"error": self.check.image}
        return {**named, **self._layers, **checked}

    def metadata(self, *, deterministic: bool = False) -> dict[str, Any]:
        """Return the EXR's header attributes other than its channels.

        Parameters
        ----------
        deterministic : bool, default False
            Leave out times.

        Returns
        -------
        dict
            Camera, settings, scene, names of objects and materials, and the result of the check if
            there is one.
        """
        from ..scene.camera_matrices import camera_metadata

        metadata = camera_metadata(self.scene.camera)
        settings = {
            key: value
            for key, value in vars(self.settings).items()
            if value is not None or key not in ("scalars", "edges")
        }
        metadata["settings"] = ", ".join(f"{key}={value}" for key, value in settings.items())
        metadata |= self._scalars()
        metadata["scene"] = f"{self.scene.name or 'unnamed'}, {self.scene.face_count} triangles"
        metadata |= self._names()
        if not deterministic:
            metadata["renderTimeSeconds"] = self.stats["times_ms"]["frame"] / 1000.0
        return metadata if self.check is None else {**metadata, **self.check.metadata()}

    def _names(self) -> dict[str, str]:
        """Return the names of the object_id and material_id layers as JSON, number -> name, unnamed ones left out."""
        meshes, found = self.scene.meshes, {}
        if "object_id" in self._layers:
            found["objectNames"] = {number: mesh.name for number, mesh in enumerate(meshes, 1) if mesh.name}
        if "material_id" in self._layers:
            numbered = zip(material_numbers(self.scene), meshes, strict=True)
            found["materialNames"] = {n: mesh.material.name for n, mesh in numbered if mesh.material.name}
        return {name: json.dumps(names, ensure_ascii=False) for name, names in found.items() if names}

    def _scalars(self) -> dict[str, Any]:
        """Return the name of the scalars shown, and the ends of their color map."""
        scalars = self.settings.scalars
        if scalars is None:
            return {}
        color_map = color_map_of(self.scene, scalars)
        return {"scalarName": scalars.name, "scalarLow": color_map.low, "scalarHigh": color_map.high}

    def to_png8(self, tonemap: Operator | None = None, exposure: float = 0.0) -> Bytes:
        """Return the tone-mapped 8-bit image.

        Parameters
        ----------
        tonemap : {"none", "srgb", "reinhard", "hable", "aces", "neutral", "agx"}, optional
            Operator, see `clshade.images.tonemap`. Default: ``"none"`` for course scenes, else
            ``"srgb"``.
        exposure : float, default 0.0
            Stops, -300 to 300; +1 doubles the radiance.

        Returns
        -------
        ndarray of uint8, (M, N, 3)
            The image.

        Raises
        ------
        InputError
            If the operator or the exposure is refused.
        """
        from ..images.tonemap import tonemap as apply

        return apply(self.rgb, tonemap or default_tonemap(self.scene), exposure)

    def __repr__(self) -> str:
        rows, columns = self._rgba.shape[:2]
        layers = f", layers {', '.join(self._layers)}" if self._layers else ""
        return f"<Frame of {self.scene.name or 'an unnamed scene'}, {columns}x{rows}{layers}>"

    def _repr_png_(self) -> bytes:
        """Return the tone-mapped image for notebooks; large images are reduced."""
        image: bytes = display.notebook().encoded(self.to_png8())
        return image

    def show(self, tonemap: Operator | None = None, exposure: float = 0.0) -> None:
        """Show the image: in a notebook below the cell, elsewhere in the desktop's image viewer.

        Parameters
        ----------
        tonemap, exposure
            See `to_png8`.

        Raises
        ------
        OutputError
            If no program that shows images is found.
        """
        display.notebook().show_frame(self, tonemap, exposure)

    def view(
        self, path: str | os.PathLike[str] | None = None, tonemap: Operator | None = None, exposure: float = 0.0
    ) -> Any:
        """Return an HTML page for inspecting the frame: exposure, tone maps, every value of every layer.

        Notebooks display the page, which needs no network and stays in a static export.

        Parameters
        ----------
        path : str or path-like, optional
            A file to write the page to, such as ``"frame.html"``.
        tonemap, exposure
            As chosen at first, see `to_png8`.

        Returns
        -------
        clshade.view.page.Page
            The page: ``html`` is its text, ``save(path)`` writes it.

        Raises
        ------
        InputError
            If the operator or the exposure is refused.
        OutputError
            If the file cannot be written.
        """
        return display.notebook().view_frame(self, path, tonemap, exposure)

    def plot_layers(self) -> Any:
        """Plot the image, its coverage and all layers. Notebooks display the figure.

        Returns
        -------
        matplotlib.figure.Figure
            Each layer is shown by its kind: ids in distinct colors, normals as (n + 1)/2, depths
            and positions scaled to their range, infinity in gray.
        """
        return display.notebook().plot_layers(self)

    def save(self, path: str | os.PathLike[str], **options: Unpack[SavingOptions]) -> list[str]:
        """Write ``path.exr`` and ``path.png``, both complete or neither.

        Parameters
        ----------
        path : str or path-like
            File name; an extension .exr or .png is dropped.
        files : sequence of {"exr", "png"}, default ("exr", "png")
            Files to write.
        tonemap : {"none", "srgb", "reinhard", "hable", "aces", "neutral", "agx"}, optional
            Operator of the PNG, see `clshade.images.tonemap`. Default: ``"none"`` for course
            scenes, else ``"srgb"``.
        exposure : float, default 0.0
            Exposure of the PNG in stops, -300 to 300.
        half : bool, default False
            Store the EXR's floats as half, except the layers Z, P and scalar.
        compression : str, default "zip"
            Compression of the EXR, see `clshade.exr.write`.
        crop : bool, default False
            Keep only the smallest window of the EXR that holds everything but the background, which
            must then be black or None. Outside of it clshade reads Z as infinity, other programs as
            0.
        deterministic : bool, default False
            Leave times out of the EXR's header.
        colorbar : bool, default False
            Add to the right of the PNG a bar of the color map with its values, which makes it
            wider; it needs ``settings.scalars``.

        Returns
        -------
        list of str
            The warnings.

        Warns
        -----
        UserWarning
            One line each for values that `half` or float32 cannot hold, and for what a lossy
            compression changes.

        Raises
        ------
        InputError
            If an argument is refused.
        OutputError
            If a file cannot be written.
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
        files: Sequence[FileKind] = FILES,
        tonemap: Operator | None = None,
        exposure: float = 0.0,
        half: bool = False,
        compression: Compression = "zip",
        crop: bool = False,
        deterministic: bool = False,
        colorbar: bool = False,
    ) -> list[str]:
        """Write the files as `save` does, but return the warnings without issuing them.

        Parameters
        ----------
        path, files, tonemap, exposure, half, compression, crop, deterministic, colorbar
            See `save`.

        Returns
        -------
        list of str
            The warnings.

        Raises
        ------
        InputError
            If an argument is refused.
        OutputError
            If a file cannot be written.
        """
        from ..base import atomic_files
        from ..images import exr, png

        flags = {"half": half, "crop": crop, "deterministic": deterministic, "colorbar": colorbar}
        for name, value in flags.items():
            flag("Frame.save", name, value)
        if colorbar and self.settings.scalars is None:
            raise value_error("Frame.save", "colorbar", "False without scalars, whose color map it shows", colorbar)
        check_output(path, tonemap=tonemap, exposure=exposure, compression=compression)
        paths = chosen_paths(path, files)

        def encode_png(file: BinaryIO) -> None:
            with atomic_files.naming(paths["png"]):
                image = self.to_png8(tonemap, exposure)
                png.encode(file, self._with_colorbar(image, tonemap, exposure) if colorbar else image)

        def encode_exr(file: BinaryIO) -> list[str]:
            with atomic_files.naming(paths["exr"]):
                return exr.encode(
                    file,
                    self.channels(),
                    compression=compression,
                    half=half,
                    metadata=self.metadata(deterministic=deterministic),
                    window="covered" if crop else "drawn",
                )

        with atomic_files.replacing_all(*paths.values()) as opened:
            file = dict(zip(paths, opened, strict=True))
            if "exr" not in file:
                encode_png(file["png"])
                return []
            if "png" not in file:
                return encode_exr(file["exr"])
            # Both release the GIL while they compress, so they run concurrently.
            with ThreadPoolExecutor(1) as beside:
                encoded = beside.submit(encode_png, file["png"])
                lines = encode_exr(file["exr"])
                encoded.result()
        return lines

    def _with_colorbar(self, image: Bytes, tonemap: Operator | None, exposure: float) -> Bytes:
        """Return the 8-bit image with a bar of the color map to its right, on its background."""
        from ..images.colorbar import with_colorbar
        from ..images.tonemap import tonemap as apply

        scalars: Any = self.settings.scalars
        color = np.zeros(3) if self.scene.background is None else self.scene.background
        ground = apply(np.asarray(color, np.float32)[None, None], tonemap or default_tonemap(self.scene), exposure)[
            0, 0
        ]
        color_map = color_map_of(self.scene, scalars)
        return with_colorbar(image, scalars.colormap, (color_map.low, color_map.high), scalars.name, ground)


def output_paths(path: str | os.PathLike[str], asked: tuple[str, str] = ASKED) -> tuple[Path, Path]:
    """Return the paths of the EXR and the PNG that `Frame.save` writes for `path`. Raises InputError if it names no file,
    standard output, or a file of another format."""
    path = Path(checked_path(*asked, path))
    stem = path.with_suffix("") if path.suffix.lower() in (".exr", ".png") else path
    if stem.name in ("", ".."):
        raise value_error(*asked, "a file name", str(path))
    if path.name == "-" or path.suffix.lower() in OTHER_FORMATS:
        name = path.stem if path.name != "-" else "image"
        both = f"a file name such as {name}, for {name}.exr and {name}.png: other formats are not written"
        raise value_error(*asked, both, str(path))
    return stem.with_name(stem.name + ".exr"), stem.with_name(stem.name + ".png")


def chosen_paths(path: str | os.PathLike[str], files: Sequence[FileKind]) -> dict[FileKind, Path]:
    """Return the paths of the files that `Frame.save` writes. Raises InputError like `output_paths`, and for other files
    than exr and png, or none."""
    if isinstance(files, str) or not files or not set(files) <= set(FILES):
        raise value_error("Frame.save", "files", "exr, png or both, such as ('png',)", files)
    return {kind: path for kind, path in zip(FILES, output_paths(path), strict=True) if kind in files}


def check_output(
    path: str | os.PathLike[str],
    *,
    tonemap: Operator | None = None,
    exposure: float = 0.0,
    compression: Compression = "zip",
    asked: tuple[str, str] = ASKED,
) -> None:
    """Raise what `Frame.save` would raise for these arguments, as far as can be known without writing."""
    from ..base import atomic_files
    from ..images import exr
    from ..images.tonemap import checked

    checked(tonemap or "srgb", exposure)
    choice("exr", "compression", compression, exr.COMPRESSIONS)
    for file in output_paths(path, asked):
        atomic_files.check(file)


def same_bits(a: Frame, b: Frame) -> bool:
    """Return whether two frames agree in every bit of image and layers."""
    return a.layers == b.layers and all(
        np.array_equal(x.view(np.uint32), y.view(np.uint32))
        for x, y in [(a.rgba, b.rgba), *((a[name], b[name]) for name in a.layers)]
    )
