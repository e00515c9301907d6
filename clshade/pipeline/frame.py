"""Rendered frames: image, layers, statistics, and how they are written."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias, overload

import numpy as np

from ..base import exchange
from ..base.arrays import Array, Bytes, Reals
from ..base.atomic_files import Path
from ..base.json_values import plain
from ..base.spelling import hint
from ..base.validation import choice, flag, value_error
from ..images.layers import LAYER_REMARKS, LAYER_WORDS, LAYERS, lists_layers
from ..scene.camera import Camera, PartCamera
from ..scene.model import Scene, Settings, default_tonemap
from . import frame_files
from .frame_files import FileKind, SavingOptions
from .frame_results import FLOWS, Check, Flow, FlowName, record_of, sealed, why_unseen

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..images.cryptomatte import Matte, MatteKind
    from ..images.tonemap import Operator


Stats: TypeAlias = dict[str, Any]  # times, counts and so on, by name


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

    def _layer(self, name: Any) -> Array:
        if not isinstance(name, str) or name not in self._layers:
            expected = f"one that was asked for with layers= ({', '.join(self._layers) or 'none were'})"
            near = hint(name, LAYERS, LAYER_WORDS, remarks=LAYER_REMARKS)
            raise value_error(type(self).__name__, "layer", expected, name, near)
        return self._layers[name]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return `rgb`, for `np.asarray`: a copy if `copy`, and None as needed, which NumPy 1 does not ask for; ValueError
        if it is False and another type needs one."""
        kind = self.rgb.dtype if dtype is None else np.dtype(dtype)
        if kind == self.rgb.dtype and not copy:
            return self.rgb
        if copy is False:
            raise ValueError(f"expected type {self.rgb.dtype}, which takes no copy, found {kind}")
        return self.rgb.astype(kind)

    def _shown(self) -> str:
        *_, rows, columns, _ = self._rgba.shape
        return f"{columns}x{rows}" + (f", layers {', '.join(self._layers)}" if self._layers else "")


class Frame(Picture):
    """A rendered image with its layers.

    ``frame[name]`` gives a layer, ``name in frame`` tests for one, and iteration gives their names.
    M and N are the numbers of rows and columns; row 0 is at the top. The frame owns its arrays, and
    ``np.asarray(frame)`` is its `rgb`.

    Attributes
    ----------
    scene, settings
        What was drawn, and how.
    check : Check or None
        The latest result of `clshade.check`, None before.
    flows : dict of str to Flow
        Optical flow to the next image, "flow", and to the one before, "flow_back"; see `clshade.flow`.
    mattes : dict of str to Matte
        Cryptomatte layers, each a part of its own in the EXR; see `clshade.cryptomatte`.
    command : str or None
        The command line that draws it, if one did. Flows and mattes, none at first, and this are
        written to the EXR.
    """

    def __init__(
        self, rgba: Reals, layers: Mapping[str, Array], scene: Scene, settings: Settings, stats: Callable[[], Stats]
    ) -> None:
        super().__init__(rgba, layers)
        self.scene, self.settings = scene, settings
        self.check: Check | None = None
        self.flows: dict[FlowName, Flow] = {}
        self.mattes: Mapping[MatteKind, Matte] = {}
        self.command: str | None = None
        self._make_stats: Callable[[], Stats] | None = stats
        self._stats: Stats = {}

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the frame with its stats, which are computed only on request."""
        return {**vars(self), "_stats": self.stats, "_make_stats": None}

    @property
    def stats(self) -> Stats:
        """Times of the stages in ms, counts, features used and left out, device."""
        make = self._make_stats  # another thread may be here at the same time
        if make is not None:
            self._stats, self._make_stats = {**make(), "nonfinite": self.scene.nonfinite}, None
        return self._stats

    @lists_layers
    def __getitem__(self, name: str) -> Array:
        """Return a layer, (M, N) or (M, N, components).

        Layers are sampled at each pixel's sample nearest the center, never averaged. Reals are of the
        type of `rgba`; the background is 0, except of Z, infinity, and scalar, NaN. Raises InputError for one
        that was not asked for.

        Parameters
        ----------
        name : str
            One of the layers that were asked for, of `LAYER_TABLE`:

        Notes
        -----
        N, albedo, uv, barycentrics and scalar are interpolated as ``settings.interpolation`` says; P and Z
        are always interpolated in perspective. Beyond the largest number of its type scalar saturates,
        and a corner's scalar at twice that number.
        """
        return self._layer(name)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the layers."""
        return iter(self._layers)

    def channels(self) -> dict[str, Array]:
        """Return the EXR's channels by name.

        These are R, G, B, A and the layers; ``flow`` and ``flow_occluded``, ``flow_back`` and
        ``flow_back_occluded`` of `flows`; also ``error``, (M, N), if every pixel was checked.
        """
        channels = {**{name: self._rgba[..., i] for i, name in enumerate("RGBA")}, **self._layers}
        for name, flow in self.flows.items():
            choice("Frame", "flows", name, FLOWS)
            channels |= {name: flow.vectors, f"{name}_occluded": flow.occluded.astype(np.uint32)}
        return channels if self.check is None or self.check.image is None else {**channels, "error": self.check.image}

    def metadata(self, *, deterministic: bool = False) -> dict[str, Any]:
        """Return the EXR's header attributes other than its channels.

        These are the camera, settings, scene, names of objects, materials and instances, and the result of
        the check if there is one.

        Parameters
        ----------
        deterministic : bool, default False
            Leave out times.
        """
        metadata = frame_files.header(self.scene, self.settings, self._layers)
        if not flag("Frame.metadata", "deterministic", deterministic):
            metadata["renderTimeSeconds"] = self.stats["times_ms"]["frame"] / 1000.0
        return metadata if self.check is None else {**metadata, **self.check.metadata()}

    def arrays(self, *, deterministic: bool = False) -> dict[str, Array]:
        """Return what an .npz of this frame holds, all of it arrays that `numpy.load` reads without pickle.

        By name, ``rgba``, (M, N, 4), and each layer; ``error`` if every pixel was checked; the camera's ``K``
        (3, 3) and ``pose`` (4, 4), float64, with their ``convention`` and ``pixel_center`` as for
        `Camera.from_matrix`, and ``resolution``, (2,), N and M. An orthographic camera has ``plane`` (2,) in
        place of K. ``metadata`` is a text, JSON.

        Parameters
        ----------
        deterministic : bool, default False
            Leave out times.
        """
        camera = self.scene.camera
        if camera.orthographic:
            arrays: dict[str, Any] = {"pose": camera.pose(), "plane": camera.plane}
        else:
            arrays = {**dict(zip(("K", "pose"), camera.to_matrix(), strict=True)), "pixel_center": 0.5}
        metadata = json.dumps(plain(self.metadata(deterministic=deterministic)), ensure_ascii=False)
        arrays |= {"convention": "opencv", "resolution": camera.resolution, "metadata": metadata}
        layers = {name: array for name, array in self.channels().items() if name not in ("R", "G", "B", "A")}
        return {"rgba": self._rgba, **layers, **{name: np.asarray(value) for name, value in arrays.items()}}

    def to_png8(self, tonemap: Operator | None = None, exposure: float = 0.0) -> Bytes:
        """Return the tone-mapped 8-bit image, (M, N, 3), or (M, N, 4) without a background.

        The latter has straight alpha: the color is divided by the coverage before it is tone-mapped, and
        alpha is the coverage times 255, rounded.

        Parameters
        ----------
        tonemap : {"none", "srgb", "reinhard", "hable", "aces", "neutral", "agx"}, optional
            Operator, see `clshade.images.tonemap`. Default: by the scene's preset, ``"none"`` for
            `course`, ``"neutral"`` for `pbr`, ``"srgb"`` for `standard`.
        exposure : float, default 0.0
            Stops, -300 to 300; +1 doubles the radiance.
        """
        from ..images.tonemap import tonemap as apply
        from ..images.tonemap import tonemap_rgba

        operator = default_tonemap(self.scene) if tonemap is None else tonemap
        if self.scene.background is None:
            return tonemap_rgba(self.rgba, operator, exposure)
        return apply(self.rgb, operator, exposure)

    def __repr__(self) -> str:
        return f"<Frame of {self.scene.name or 'an unnamed scene'}, {self._shown()}>"

    def _repr_png_(self) -> bytes:
        """Return the tone-mapped image for notebooks; large images are reduced."""
        return bytes(exchange.get("notebook").encoded(self.to_png8()))

    def show(self, tonemap: Operator | None = None, exposure: float = 0.0) -> None:
        """Show the image in a notebook or the desktop's image viewer; raise OutputError if there is none.

        Parameters
        ----------
        tonemap, exposure
            See `to_png8`.
        """
        exchange.get("notebook").show_frame(self, tonemap, exposure)

    def view(self, path: Path | None = None, tonemap: Operator | None = None, exposure: float = 0.0) -> Any:
        """Return an HTML page for inspecting the frame: exposure, tone maps, every value of every layer.

        Notebooks display it, a `clshade.view.page.Page`, which needs no network and stays in a static export.

        Parameters
        ----------
        path : str or path-like, optional
            A file to write the page to, such as ``"frame.html"``.
        tonemap, exposure
            As chosen at first, see `to_png8`.
        """
        return exchange.get("notebook").view_frame(self, path, tonemap, exposure)

    def plot_layers(self) -> Any:
        """Return a matplotlib figure of the image, its coverage and all layers, which notebooks display.

        Each layer is shown by its kind: ids in distinct colors, normals as (n + 1)/2, depths and positions
        scaled to their range, infinity in gray.
        """
        return exchange.get("notebook").plot_layers(self)

    def save(self, path: Path, **options: Unpack[SavingOptions]) -> list[str]:
        """Write ``path.exr`` and ``path.png``, or other files, all complete or none.

        Parameters
        ----------
        path : str or path-like
            File name; an extension .exr, .png or .npz is dropped.
        files : sequence of {"exr", "png", "npz", "depth"}, optional
            ``path.exr``, ``path.png``, ``path.npz`` with what `arrays` returns, and ``path.depth.png`` with
            the layer Z as 16-bit codes, 0 in the background. Default: EXR and PNG, or the .npz alone if the
            path ends so.
        tonemap, exposure
            Of the PNG, see `to_png8`.
        half : bool, default False
            Store the EXR's floats as half, except the layers Z, P and scalar.
        compression : str, default "zip"
            Compression of the EXR, see `clshade.exr.write`.
        crop : bool, default False
            Keep only the smallest window of the EXR that holds everything but the background, which must
            then be black or None. Outside of it clshade reads Z as infinity, other programs as 0.
        deterministic : bool, default False
            Leave times out of the EXR's header and the .npz.
        colorbar : bool, default False
            Widen the PNG by a bar of the color map with its values; it needs ``settings.scalars``.
        depth_scale : float, default 0.001
            Scene units of one step of the depth PNG, whose text ``depthScale`` has it; a depth is
            refused that would need a code beyond 1 to 65535.

        Returns
        -------
        list of str
            The warnings, which are also issued: a line each for values that `half` or float32 cannot hold,
            for what a lossy compression changes, and for an image that shows nothing of its scene. OutputError
            is raised if a file cannot be written.
        """
        lines = self.write(path, **options)
        for line in lines:
            warnings.warn(line, stacklevel=2)
        return lines

    def write(self, path: Path, **options: Unpack[SavingOptions]) -> list[str]:
        """Write the files as `save` does, but return the warnings without issuing them.

        Parameters
        ----------
        path, **options
            See `save`.
        """
        from ..images import depth_png, png

        saving = frame_files.check_output(path, self.settings, **options)
        paths = frame_files.chosen_paths(path, saving["files"])
        frame_files.check_layers(paths, self._layers)
        display, deterministic = (saving["tonemap"], saving["exposure"]), saving["deterministic"]

        def image() -> Bytes:
            pixels, bar = self.to_png8(*display), saving["colorbar"]
            return frame_files.with_colorbar(pixels, self.scene, self.settings, *display) if bar else pixels

        encoders: dict[FileKind, frame_files.Encoder] = {
            "exr": lambda file: self._encode_exr(file, saving),
            "png": lambda file: png.encode(file, image()),
            "npz": lambda file: frame_files.encode_npz(file, self.arrays(deterministic=deterministic)),
            "depth": lambda file: depth_png.encode(file, self["Z"], saving["depth_scale"]),
        }
        lines = frame_files.write_files(paths, encoders)
        line = why_unseen(self.rgba, self.scene, self.settings, self.stats)
        return [*lines, line] if line else lines

    def _encode_exr(self, file: BinaryIO, saving: SavingOptions) -> list[str]:
        from ..images import exr

        device = None if saving["deterministic"] else self.stats.get("device")
        record = record_of(self.scene, self.settings, saving, device=device, command=self.command)
        tiled = isinstance(self.scene.camera, PartCamera)  # its pixels can then be joined with those of other parts
        return exr.encode(
            file,
            self.channels(),
            compression=saving["compression"],
            half=saving["half"],
            metadata=sealed(self.metadata(deterministic=saving["deterministic"]), record),
            window=None if tiled else "covered" if saving["crop"] else "drawn",
            parts={kind: (matte.channels, matte.metadata) for kind, matte in self.mattes.items()},
            tiled=tiled,
        )


class Views(Picture):
    """Rendered views of one scene with their layers, from `Renderer.render_many`.

    ``views[k]`` gives the frame of view k, 0 to K - 1 or from the end -1 to -K, and iteration gives all;
    ``views[name]`` gives a layer of all views, ``name in views`` tests for one. K is the number of views, M
    and N those of rows and columns; row 0 is at the top. ``np.asarray(views)`` is their `rgb`.

    Attributes
    ----------
    arrays : dict of str to ndarray
        ``"rgba"`` and the layers, by name, each (K, M, N, ...).
    settings : Settings
        How all were drawn.
    stats : dict
        Number of views, sums of the stages' times in ms, ``times_ms["views"]`` of the whole call, device. What is
        counted is in ``views[k].stats``.
    """

    def __init__(
        self,
        arrays: Mapping[str, Array],
        scenes: Sequence[Scene],
        settings: Settings,
        facts: Sequence[Callable[[], Stats]],
        stats: Stats,
    ) -> None:
        super().__init__(arrays["rgba"], {name: array for name, array in arrays.items() if name != "rgba"})
        self.arrays, self.settings, self.stats = dict(arrays), settings, stats
        self._scenes, self._facts = tuple(scenes), tuple(facts)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The K cameras."""
        return tuple(scene.camera for scene in self._scenes)

    def __len__(self) -> int:
        """Return the number of views, K."""
        return len(self._scenes)

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over the frames of the views."""
        return (self[index] for index in range(len(self)))

    @overload
    def __getitem__(self, key: int) -> Frame: ...
    @overload
    def __getitem__(self, key: str) -> Array: ...
    def __getitem__(self, key: int | str) -> Frame | Array:
        """Return the frame of a view, whose arrays are views of these, or a layer of all.

        Parameters
        ----------
        key : int or str
            Index of a view, or the name of a layer, which is then (K, M, N) or (K, M, N, components), see
            `Frame.__getitem__`.
        """
        if isinstance(key, bool) or not isinstance(key, (int, np.integer)):
            return self._layer(key)
        index = range(len(self))[key]
        facts = self._facts[index]
        times = {"times_ms": {"frame": self.stats["times_ms"]["views"] / len(self)}, "build_ms": 0.0}
        layers = {name: array[index] for name, array in self._layers.items()}
        return Frame(self.rgba[index], layers, self._scenes[index], self.settings, lambda: {**times, **facts()})

    def __repr__(self) -> str:
        return f"<{len(self)} Views, {self._shown()}>"


def same_bits(a: Frame, b: Frame) -> bool:
    """Return whether two frames agree in every bit of image and layers."""
    return a.layers == b.layers and all(
        np.array_equal(x.view(np.uint32), y.view(np.uint32))
        for x, y in [(a.rgba, b.rgba), *((a[name], b[name]) for name in a.layers)]
    )
