"""A rendered frame: image, layers, statistics."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, overload

import numpy as np

from ..base import exchange
from ..base.arrays import Array, Bytes, Floats, Reals, UInt32s
from ..base.spelling import hint
from ..base.validation import flag, known, value_error
from ..errors import InputError
from ..images.depth_png import SCALE
from ..images.layers import LAYER_REMARKS, LAYER_WORDS, LAYERS, NumberLayer, PointLayer, RealLayer, lists_layers
from ..scene.image_part import PartCamera
from ..scene.model import Scene, Settings, default_tonemap
from . import drawing_record, frame_files
from .flow_vectors import Flow, FlowName, flow_channels
from .frame_files import SAVING, FileKind, SavingOptions
from .image_check import Check
from .unseen import why_unseen

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..images.cryptomatte import Matte, MatteKind
    from ..images.tonemap import Operator


_DEFAULTS: SavingOptions = {"files": None, "tonemap": None, "exposure": 0.0, "half": False, "compression": "zip"}
_DEFAULTS |= {"crop": False, "deterministic": False, "colorbar": False, "depth_scale": SCALE}


class Picture:
    """What a frame and several views have in common. Shapes are those of a frame; of views each begins with K."""

    def __init__(self, rgba: Reals, layers: Mapping[str, Array]) -> None:
        self._rgba, self._layers = rgba, dict(layers)

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

    def __contains__(self, name: object) -> bool:
        """Return whether a layer of this name was asked for."""
        return name in self._layers

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return `rgb`, for `np.asarray`: a copy if `copy`, and None as needed, which NumPy 1 does not ask for; ValueError
        if it is False and another type needs one."""
        kind = self.rgb.dtype if dtype is None else np.dtype(dtype)
        if kind == self.rgb.dtype and not copy:
            return self.rgb
        if copy is False:
            raise ValueError(f"expected type {self.rgb.dtype}, which takes no copy, found {kind}")
        return self.rgb.astype(kind)


class Frame(Picture):
    """A rendered image with its layers.

    ``frame[name]`` gives a layer, ``name in frame`` tests for one, and iteration gives their names.
    M and N are the numbers of rows and columns; row 0 is at the top. The frame owns its arrays, and
    ``np.asarray(frame)`` is its `rgb`.

    Attributes
    ----------
    scene : Scene
        What was drawn.
    settings : Settings
        How it was drawn.
    check : Check or None
        The latest result of `clshade.check`, None before.
    flows : dict of str to Flow
        Optical flow to other images that is written to the EXR: "flow" to the next, "flow_back" to the
        one before; empty at first, see `clshade.flow`.
    mattes : dict of str to Matte
        Cryptomatte layers that are written to the EXR, each as a part of its own; empty at first, see
        `clshade.cryptomatte`.
    command : str or None
        The command line that draws it, if one did; it is written to the EXR.
    """

    def __init__(
        self,
        rgba: Reals,
        layers: Mapping[str, Array],
        scene: Scene,
        settings: Settings,
        stats: Callable[[], dict[str, Any]],
    ) -> None:
        super().__init__(rgba, layers)
        self.scene, self.settings = scene, settings
        self.check: Check | None = None
        self.flows: dict[FlowName, Flow] = {}
        self.mattes: Mapping[MatteKind, Matte] = {}
        self.command: str | None = None
        self._make_stats: Callable[[], dict[str, Any]] | None = stats
        self._stats: dict[str, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the frame with its stats, which are computed only on request."""
        return {**vars(self), "_stats": self.stats, "_make_stats": None}

    @property
    def stats(self) -> dict[str, Any]:
        """Times of the stages in ms, counts, features used and left out, device."""
        make = self._make_stats  # another thread may be here at the same time
        if make is not None:
            self._stats, self._make_stats = {**make(), "nonfinite": self.scene.nonfinite}, None
        return self._stats

    @overload
    def __getitem__(self, name: NumberLayer) -> UInt32s: ...
    @overload
    def __getitem__(self, name: PointLayer) -> Floats: ...
    @overload
    def __getitem__(self, name: RealLayer) -> Reals: ...
    @overload
    def __getitem__(self, name: str) -> Array: ...
    @lists_layers
    def __getitem__(self, name: str) -> Array:
        """Return a layer.

        Layers are sampled at each pixel's sample nearest the center, never averaged.

        Parameters
        ----------
        name : str
            One of the layers that were asked for, of `LAYER_TABLE`:

        Returns
        -------
        ndarray
            (M, N) or (M, N, components); reals are of the type of `rgba`. 0 in the background, except
            for Z, infinity, and scalar, NaN.

        Raises
        ------
        InputError
            If the layer was not asked for.

        Notes
        -----
        N, albedo, uv, barycentrics and scalar are interpolated as ``settings.interpolation`` says; P and Z
        are always interpolated in perspective. Beyond the largest number of its type scalar saturates,
        and a corner's scalar at twice that number.
        """
        if not isinstance(name, str) or name not in self._layers:
            raise missing_layer("Frame", name, self._layers)
        return self._layers[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the layers."""
        return iter(self._layers)

    def channels(self) -> dict[str, Array]:
        """Return the EXR's channels.

        Returns
        -------
        dict of str to ndarray
            R, G, B, A and the layers, by name; ``flow`` and ``flow_occluded``, ``flow_back`` and
            ``flow_back_occluded`` of `flows`; also ``error``, (M, N), if every pixel was checked.
        """
        named = {name: self._rgba[..., i] for i, name in enumerate("RGBA")}
        checked = {} if self.check is None or self.check.image is None else {"error": self.check.image}
        return {**named, **self._layers, **flow_channels(self.flows), **checked}

    def metadata(self, *, deterministic: bool = False) -> dict[str, Any]:
        """Return the EXR's header attributes other than its channels.

        Parameters
        ----------
        deterministic : bool, default False
            Leave out times.

        Returns
        -------
        dict
            Camera, settings, scene, names of objects, materials and instances, and the result of the check if
            there is one.
        """
        metadata = frame_files.header(self.scene, self.settings, self._layers)
        if not flag("Frame.metadata", "deterministic", deterministic):
            metadata["renderTimeSeconds"] = self.stats["times_ms"]["frame"] / 1000.0
        return metadata if self.check is None else {**metadata, **self.check.metadata()}

    def arrays(self, *, deterministic: bool = False) -> dict[str, Array]:
        """Return what an .npz of this frame holds, all of it arrays that `numpy.load` reads without pickle.

        Parameters
        ----------
        deterministic : bool, default False
            Leave out times.

        Returns
        -------
        dict of str to ndarray
            ``rgba``, (M, N, 4), and each layer by its name; ``error`` if every pixel was checked; the
            camera's ``K`` (3, 3) and ``pose`` (4, 4), float64, with their ``convention`` and
            ``pixel_center`` as for `Camera.from_matrix`, and ``resolution``, (2,), N and M. An
            orthographic camera has ``plane`` (2,) in place of K. ``metadata`` is a text, JSON.
        """
        metadata = self.metadata(deterministic=deterministic)
        return frame_files.named_arrays(self.scene.camera, self._rgba, self.channels(), metadata)

    def to_png8(self, tonemap: Operator | None = None, exposure: float = 0.0) -> Bytes:
        """Return the tone-mapped 8-bit image.

        Parameters
        ----------
        tonemap : {"none", "srgb", "reinhard", "hable", "aces", "neutral", "agx"}, optional
            Operator, see `clshade.images.tonemap`. Default: by the scene's preset, ``"none"`` for
            `course`, ``"neutral"`` for `pbr`, ``"srgb"`` for `standard`.
        exposure : float, default 0.0
            Stops, -300 to 300; +1 doubles the radiance.

        Returns
        -------
        ndarray of uint8, (M, N, 3) or (M, N, 4)
            The image; without a background with straight alpha: the color is divided by the
            coverage before it is tone-mapped, and alpha is the coverage times 255, rounded.
        """
        operator = default_tonemap(self.scene) if tonemap is None else tonemap
        if self.scene.background is None:
            from ..images.transparency import tonemap_rgba

            return tonemap_rgba(self.rgba, operator, exposure)
        from ..images.tonemap import tonemap as apply

        return apply(self.rgb, operator, exposure)

    def __repr__(self) -> str:
        rows, columns = self._rgba.shape[:2]
        layers = f", layers {', '.join(self._layers)}" if self._layers else ""
        return f"<Frame of {self.scene.name or 'an unnamed scene'}, {columns}x{rows}{layers}>"

    def _repr_png_(self) -> bytes:
        """Return the tone-mapped image for notebooks; large images are reduced."""
        image: bytes = exchange.get("notebook").encoded(self.to_png8())
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
        exchange.get("notebook").show_frame(self, tonemap, exposure)

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
        """
        return exchange.get("notebook").view_frame(self, path, tonemap, exposure)

    def plot_layers(self) -> Any:
        """Plot the image, its coverage and all layers. Notebooks display the figure.

        Returns
        -------
        matplotlib.figure.Figure
            Each layer is shown by its kind: ids in distinct colors, normals as (n + 1)/2, depths
            and positions scaled to their range, infinity in gray.
        """
        return exchange.get("notebook").plot_layers(self)

    def save(self, path: str | os.PathLike[str], **options: Unpack[SavingOptions]) -> list[str]:
        """Write ``path.exr`` and ``path.png``, or other files, all complete or none.

        Parameters
        ----------
        path : str or path-like
            File name; an extension .exr, .png or .npz is dropped.
        files : sequence of {"exr", "png", "npz", "depth"}, optional
            Files to write: ``path.exr``, ``path.png``, ``path.npz`` with the arrays that `arrays`
            returns, and ``path.depth.png`` with the layer Z as 16-bit codes, 0 in the background.
            Default: EXR and PNG, or the .npz alone if the path ends so.
        tonemap : {"none", "srgb", "reinhard", "hable", "aces", "neutral", "agx"}, optional
            Operator of the PNG, see `clshade.images.tonemap`. Default: by the scene's preset, see
            `to_png8`.
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
            Leave times out of the EXR's header and the .npz.
        colorbar : bool, default False
            Add to the right of the PNG a bar of the color map with its values, which makes it
            wider; it needs ``settings.scalars``.
        depth_scale : float, default 0.001
            Scene units of one step of the depth PNG, whose text ``depthScale`` has it; a depth is
            refused that would need a code beyond 1 to 65535.

        Returns
        -------
        list of str
            The warnings.

        Warns
        -----
        UserWarning
            One line each for values that `half` or float32 cannot hold, for what a lossy
            compression changes, and for an image that shows nothing of its scene.

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

    def write(self, path: str | os.PathLike[str], **options: Unpack[SavingOptions]) -> list[str]:
        """Write the files as `save` does, but return the warnings without issuing them.

        Parameters
        ----------
        path, **options
            See `save`.
        """
        from ..images import depth_png, exr, npz, png

        chosen: SavingOptions = {**_DEFAULTS, **options}
        deterministic, tonemap, exposure = chosen["deterministic"], chosen["tonemap"], chosen["exposure"]
        frame_files.check_output(path, self.settings, **chosen)
        paths = frame_files.chosen_paths(path, chosen["files"])
        frame_files.check_layers(paths, self._layers)

        def image() -> Bytes:
            pixels = self.to_png8(tonemap, exposure)
            if not chosen["colorbar"]:
                return pixels
            return frame_files.with_colorbar(pixels, self.scene, self.settings, tonemap, exposure)

        def encode_exr(file: BinaryIO) -> list[str]:
            device = None if deterministic else self.stats.get("device")
            storage = drawing_record.Storage.of(self.scene, chosen)
            record = drawing_record.record_of(self.scene, self.settings, storage, device=device, command=self.command)
            metadata = drawing_record.sealed(self.metadata(deterministic=deterministic), record)
            tiled = isinstance(self.scene.camera, PartCamera)  # its pixels can then be joined with those of other parts
            window: Literal["covered", "drawn"] | None = None if tiled else "covered" if chosen["crop"] else "drawn"
            return exr.encode(
                file,
                self.channels(),
                compression=chosen["compression"],
                half=chosen["half"],
                metadata=metadata,
                window=window,
                parts={kind: (matte.channels, matte.metadata) for kind, matte in self.mattes.items()},
                tiled=tiled,
            )

        scale = chosen["depth_scale"]
        encoders: dict[FileKind, frame_files.Encoder] = {
            "exr": encode_exr,
            "png": lambda file: png.encode(file, image()),
            "npz": lambda file: npz.encode(file, self.arrays(deterministic=deterministic)),
            "depth": lambda file: depth_png.encode(file, self["Z"], scale, ("Frame.save", "depth_scale")),
        }
        lines = frame_files.write_files(paths, encoders)
        line = why_unseen(self.rgba, self.scene, self.settings, self.stats)
        return [*lines, line] if line else lines


def missing_layer(owner: str, name: Any, asked: Iterable[str]) -> InputError:
    """Return the error for a layer that was not asked for."""
    expected = f"one that was asked for with layers= ({', '.join(asked) or 'none were'})"
    return value_error(owner, "layer", expected, name, hint(name, LAYERS, LAYER_WORDS, remarks=LAYER_REMARKS))


def same_bits(a: Frame, b: Frame) -> bool:
    """Return whether two frames agree in every bit of image and layers."""
    return a.layers == b.layers and all(
        np.array_equal(x.view(np.uint32), y.view(np.uint32))
        for x, y in [(a.rgba, b.rgba), *((a[name], b[name]) for name in a.layers)]
    )
