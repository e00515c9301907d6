"""Renderer: a scene that stays on the device and is drawn any number of times, also many frames one behind the other."""

from __future__ import annotations

import contextlib
import os
import pickle
import threading
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Array, Integers
from ..base.spelling import hint
from ..base.validation import arguments, items, known, one_of, sequence, value_error
from ..errors import ClshadeError, DeviceError, InputError
from ..images.decode import CodedImage
from ..images.layers import LAYER_REMARKS, LAYER_WORDS
from ..scene.camera import Camera
from ..scene.environment import Environment
from ..scene.material import MetallicRoughness
from ..scene.model import Material, Scene, Settings, Texture, with_fields
from ..scene.settings import LAYERS, Preset, RenderOptions
from . import programs
from .buffers import ALIGNMENT, Buffer, Pool, finish, transfers, wait
from .camera_space import CameraSpace
from .draw import SceneDrawing, compiles_longer
from .effective_settings import effective_settings
from .features import OPTIONAL, at_lanes, ignored
from .frame import Frame, Views
from .launches import FrameInFlight
from .opencl.device import Device, shared_device
from .programs import running_time
from .scene_tables import pack

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

STREAMED_PIXELS = 1 << 19  # from here on images do not fit in caches, which they would only empty
_OWNER = "Renderer.render_many"
_LEAST_ALIGNMENT = 16  # bytes, of memory to which kernels write four float32 at once


def event_ms(event: Any) -> float:
    """Return the time of a kernel, from its event, or of several launches from a list."""
    events = event if isinstance(event, list) else [event]
    return float(sum(launch.profile.end - launch.profile.start for launch in events)) / 1e6


def _is_aligned(array: Array, alignment: int) -> bool:
    """Return whether each of the images in an array is contiguous and begins at a multiple of so many bytes."""
    begins_well = array.ctypes.data % alignment == 0 and (len(array) < 2 or array.strides[0] % alignment == 0)
    return begins_well and all(first.flags.c_contiguous for first in array[:1])


class FrameQueue:
    """The drawing of many frames into arrays, (K, M, N, ...) in any layout by name: `rgba` and the layers. Kernels write
    straight into them where they can, elsewhere into one of two buffers, from which they are copied.

    Nothing else may be drawn meanwhile. After `draw`: facts, a function for each frame, see
    `SceneDrawing.facts_of`; stage_ms, the times of the stages, of all frames together.
    """

    def __init__(self, drawing: SceneDrawing, arrays: Mapping[str, Array]) -> None:
        self._drawing, self._device, types = drawing, drawing.device, drawing.layers.kernel_types
        self.facts: list[Callable[[], dict[str, Any]]] = []
        self.stage_ms: Counter[str] = Counter()
        self._arrays = {name: array.view(np.ndarray) for name, array in arrays.items()}
        self._staged = {}
        for name, array in self._arrays.items():
            kind, alignment = types.get(name, array.dtype), ALIGNMENT if array.dtype == np.float64 else _LEAST_ALIGNMENT
            if not (drawing.tables["image"].is_shared and array.dtype == kind and _is_aligned(array, alignment)):
                self._staged[name] = [drawing.pool.take(array.shape[1:], kind) for _ in range(2)]
        image, is_direct = self._arrays["rgba"], "rgba" not in self._staged
        together = image if is_direct else image[:1]
        self._streams = together[..., 0].size >= STREAMED_PIXELS and (not is_direct or _is_aligned(image, ALIGNMENT))
        shape = image.shape[1:3]
        self._owners = [drawing.pool.take(shape, np.int32) for _ in range(2) if drawing.features["OWNERS"]]
        self._tables = drawing.tables, drawing.resident.new_tables()
        self._transfers = transfers(self._device)

    def draw(self, spaces: Sequence[CameraSpace]) -> None:
        """Draw a frame for each space. Raises as `Renderer.render`."""
        pending = deque[tuple[int, FrameInFlight, list[Any]]]()
        for index, space in enumerate(spaces):
            if not self._device.has_fp64 and pending:  # the host projects into memory that kernels read
                self._complete(*pending.popleft())
            targets = {
                name: self._staged[name][index % 2][0] if name in self._staged else Buffer(self._device, array[index])
                for name, array in self._arrays.items()
            }
            owners = self._owners[index % 2][0] if self._owners else None
            rgba, tables = targets.pop("rgba"), self._tables[index % 2]
            frame = self._drawing.frame(space, tables, rgba, owners, streams=self._streams)
            frame.layers = targets
            self._drawing.enqueue(frame)
            pending.append((index, frame, self._fetch(frame)))
            if len(pending) > 1:
                self._complete(*pending.popleft())
        if pending:
            self._complete(*pending.popleft())

    def _fetch(self, frame: FrameInFlight) -> list[Any]:
        """Enqueue the copies from a device with memory of its own; return the events after which the frame is complete."""
        last = next(reversed(frame.events.values()))
        if self._transfers is None:
            return [last]
        self._device.queue.flush()
        names = "rgba", "counters", *(["owners"] if "P" in frame.layers else [])
        wanted = [*frame.layers.values(), *map(frame.values.get, names)]
        return [buffer.fetch(self._transfers, last) for buffer in wanted if buffer is not None]

    def _complete(self, index: int, frame: FrameInFlight, done: list[Any]) -> None:
        """Wait for a frame, draw it again if nothing of it was drawn, and do the host's part of its layers."""
        wait(self._device, done)
        if frame.counters is None:
            counters = frame.values["counters"].array[0].copy()
            frame.counters, frame.host_ms["sort"] = counters, 0.0
            if counters["to_clip"] or counters["entries"] > frame.room:
                self._drawing.draw_again(frame)
                wait(self._device, self._fetch(frame))
        self._write_results(index, frame)
        self.stage_ms.update({name: event_ms(event) for name, event in frame.events.items() if event is not None})
        frame.events.clear()
        self.stage_ms.update(frame.host_ms)
        self.facts.append(self._drawing.facts_of(frame))

    def _write_results(self, index: int, frame: FrameInFlight) -> None:
        """Complete the layers, and copy what the kernels did not write to its place."""
        arrays = {name: buffer.array for name, buffer in {"rgba": frame.values["rgba"], **frame.layers}.items()}
        results = {name: array[index] for name, array in self._arrays.items()}
        if frame.values["owners"] is not None:
            self._drawing.layers.finish(arrays, results, frame.values["owners"].array, frame.space)
        for name in self._staged:
            if name != "P":
                np.copyto(results[name], arrays[name])


def check_camera(owner: str, name: str, camera: Any, like: Camera) -> None:
    """Raise InputError for anything but a camera of the same kind as another."""
    if not isinstance(camera, Camera):
        raise value_error(owner, name, "a Camera", camera)
    if camera.orthographic != like.orthographic:
        kind = "an orthographic" if like.orthographic else "a perspective"
        raise value_error(owner, name, f"{kind} camera, as the scene's", "the other kind")


def check_cameras(cameras: Iterable[Camera], like: Camera) -> tuple[Camera, ...]:
    """Return cameras of one resolution, of the kind of another one. Raises InputError."""
    listed = None if isinstance(cameras, (str, bytes)) else sequence(cameras)
    if listed is None:
        raise value_error(_OWNER, "cameras", "a sequence of Cameras", cameras)
    for index, camera in enumerate(listed):
        check_camera(_OWNER, f"cameras[{index}]", camera, like)
        if camera.resolution != listed[0].resolution:
            expected = f"the resolution of all, {listed[0].resolution} as that of cameras[0]"
            raise value_error(_OWNER, f"cameras[{index}]", expected, camera.resolution)
    return listed


def result_arrays(
    kinds: Mapping[str, tuple[tuple[int, ...], np.dtype]],
    out: Mapping[str, Array] | None,
    make: Callable[[tuple[int, ...], np.dtype], Array],
) -> dict[str, Array]:
    """Return an array for each name, of the given shape and type: that of `out`, if it has one, or what `make` returns.
    Raises InputError for other arrays, and if there is no memory."""
    out = {} if out is None else out
    if not isinstance(out, Mapping):
        raise value_error(_OWNER, "out", "arrays by name, such as {'rgba': array}", out)
    for name in out:
        if name not in kinds:
            near = hint(name, kinds, LAYER_WORDS, remarks=LAYER_REMARKS)
            raise value_error(_OWNER, "out", f"names of {', '.join(kinds)}", name, near)
    arrays = {name: out[name] for name in kinds if name in out}
    for name, array in arrays.items():
        (shape, kind), field = kinds[name], f"out[{name!r}]"
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != kind:
            raise value_error(_OWNER, field, f"an array of shape {shape} and type {kind}", array)
        if not array.flags.writeable:
            raise InputError(f"{_OWNER}: {field}: expected a writeable array, found a read-only one")
    for one, another in combinations(arrays, 2):
        if np.shares_memory(arrays[one], arrays[another]):
            raise InputError(f"{_OWNER}: out[{another!r}]: expected memory of its own, found that of out[{one!r}]")
    try:
        return {name: arrays[name] if name in arrays else make(*kind) for name, kind in kinds.items()}
    except MemoryError:
        size = sum(np.prod(shape) * kind.itemsize for shape, kind in kinds.values())
        expected = "as many as fit in memory, or memory-mapped arrays as out"
        raise InputError(f"{_OWNER}: cameras: expected {expected}, found {size / 2**30:.1f} GiB of results") from None


# Of the frame with which a device is tested: columns and rows, and most faces, with which it takes no time of its own.
_TRIAL_SIZE, _TRIAL_FACES = (64, 48), 1 << 18


def _with_small_images(value: Any, replaced: dict[int, Any]) -> Any:
    """Return a texture or environment with 2x2 texels at most, all as bright as its brightest: it takes the same programs.
    Or a material that has such. replaced: what was returned before, by id."""
    if id(value) not in replaced:
        small = value
        if isinstance(value, (Texture, Environment)):
            texels = value.texels if isinstance(value, Texture) else value.image
            brightest = texels.brightest() if isinstance(texels, CodedImage) else texels.max(axis=(0, 1))
            height, width, channels = texels.shape
            small = replace(value, image=np.broadcast_to(brightest, (min(height, 2), min(width, 2), channels)))
        elif isinstance(value, (Material, MetallicRoughness)):
            parts = {field.name: _with_small_images(getattr(value, field.name), replaced) for field in fields(value)}
            small = replace(value, **parts)
        replaced[id(value)] = small
    return replaced[id(value)]


def trial_of(scene: Scene, settings: Settings, forced: Collection[str]) -> bytes:
    """Return pickled arguments of a renderer that needs the same programs for a small image; empty for a large scene, and
    for one of the user's own types that cannot be copied or pickled."""
    if scene.face_count > _TRIAL_FACES:
        return b""
    with contextlib.suppress(Exception):
        replaced: dict[int, Any] = {}
        meshes = tuple(with_fields(mesh, material=_with_small_images(mesh.material, replaced)) for mesh in scene.meshes)
        first = programs.this_thread.is_first and compiles_longer(scene, settings)
        camera = replace(scene.camera, resolution=_TRIAL_SIZE)
        around = _with_small_images(scene.environment, replaced)
        small = with_fields(scene, camera=camera, meshes=meshes, environment=around)
        return pickle.dumps(({"scene": small, "settings": settings, "forced": forced}, first))
    return b""


_KEPT_WHEN_CLOSED = {"scene", "settings", "features", "device", "_lock", "_process", "_closed"}


class Renderer:
    """A scene on the device, uploaded once and drawn any number of times, with a camera per frame.

    Use it as a context manager, or call `close`. Threads may share a renderer; their frames are
    drawn one after the other. Its attributes `scene` and `settings` are those it draws, `device` is
    where, and `features` are those that the kernels are compiled with.

    Parameters
    ----------
    scene : Scene
        The scene to draw. A CPU device works in the scene's own arrays: do not change them
        while the renderer is open.
    preset : {"course", "standard", "pbr"}, optional
        Preset of the settings. Default: the scene's own.
    device : Device or str, optional
        An open device or the name of one: ``"pocl"``, ``"intel"``, ``"nvidia"``, ``"amd"``,
        ``"rusticl"``, part of the name of a platform or device, or ``"P:D"`` (indices of platform
        and device). Default: the environment variable CLSHADE_DEVICE, else PoCL, Intel, any.
    settings : Settings, optional
        Complete settings, in place of a preset.
    forced : collection of str, optional
        Names in ``features.OPTIONAL`` of work to do even if the scene does not need it, which is slower.
    lanes : {1, 4, 8, 16}, optional
        Number of pixels processed together. Default: what suits the device. The bits of the image
        depend neither on it nor on `forced`.
    **fields
        Any field of `Settings`, which replaces that of the preset or of `settings`, and
        ``resolution=(N, M)``, columns and rows, which replaces that of the scene's camera.

    Raises
    ------
    InputError, DeviceError
        If an argument is refused, or the scene does not fit into this machine's memory; if no OpenCL
        device works, or the scene does not fit into its memory.

    Examples
    --------
    >>> import clshade
    >>> scene = clshade.builtin("teapot")
    >>> with clshade.Renderer(scene, samples=4) as renderer:
    ...     frame = renderer.render()
    """

    @arguments(forced=items, lanes=partial(one_of, numbers=(1, 4, 8, 16)))
    def __init__(
        self,
        scene: Scene,
        *,
        preset: Preset | None = None,
        device: Device | str | None = None,
        settings: Settings | None = None,
        forced: Collection[str] = frozenset(),
        lanes: int | None = None,
        **fields: Unpack[RenderOptions],
    ) -> None:
        start, waited = running_time(), programs.this_thread.waited
        self._lock, self._process, self._closed = threading.Lock(), os.getpid(), False
        self.scene, self.settings = effective_settings(scene, preset, settings, **fields)
        known("Renderer: forced", forced, OPTIONAL)
        packed = pack(self.scene, self.settings, forced=forced)
        packed_at = running_time()

        if not isinstance(device, Device):
            device = shared_device(device, trial=partial(trial_of, self.scene, self.settings, forced))
        self.device = device
        if packed.instances is not None and not device.has_fp64:
            packed = pack(self.scene, self.settings, forced=forced, has_fp64=False)
        self.features = at_lanes(packed.features, device.lanes, lanes)
        opened_at = running_time()
        self._drawing = SceneDrawing(device, packed, self.features, lanes)
        self.stages = self._drawing.stages
        self._results = Pool(self.device, keep=2, kinds=len(LAYERS) + 1)
        times = {"pack": packed_at - start, "open": opened_at - packed_at, "upload": running_time() - opened_at}
        self._times = {name: seconds * 1e3 for name, seconds in times.items()}
        self._build_ms = (programs.this_thread.waited - waited) * 1e3

    def place_samples(self, places: Integers) -> None:
        """Set where the next frames' pixels are sampled, of settings with several samples.

        Parameters
        ----------
        places : ndarray, (S, 2) int
            As `sample_positions` returns them, at most as many as in the settings.
        """
        self._drawing.resident.places = places

    def render(self, camera: Camera | None = None) -> Frame:
        """Draw one frame, which owns its arrays and stays valid after `close`.

        Parameters
        ----------
        camera : Camera, optional
            Camera of this frame, of the same kind (perspective or orthographic) as the scene's.
            Default: the scene's camera.

        Raises
        ------
        InputError, DeviceError, ClshadeError
            For a camera that is refused, or too many triangles after clipping; if the device fails, or the
            renderer was created in another process, before a fork; if the renderer is closed.
        """
        camera = self.scene.camera if camera is None else camera
        check_camera("Renderer.render", "camera", camera, self.scene.camera)
        columns, rows = camera.resolution
        with self._holding("render"):
            start, waited = running_time(), programs.this_thread.waited
            drawing = self._drawing
            rgba, image = drawing.pool.take((rows, columns, 4), self.stages.structs.real)
            owners, _kept = drawing.pool.take((rows, columns), np.int32) if self.features["OWNERS"] else (None, None)
            streams = rows * columns >= STREAMED_PIXELS
            frame = drawing.frame(self._space(camera), drawing.tables, rgba, owners, streams=streams)
            layers = drawing.draw(frame)
            rgba.to_host()
            times = self._times_since(start, waited, "frame", frame.host_ms)
            facts_of = drawing.facts_of(frame)
            events = frame.events

        def stats() -> dict[str, Any]:
            kernels = {name: event_ms(event) for name, event in events.items() if event is not None}
            return {**times, "times_ms": {**kernels, **times["times_ms"]}, **facts_of()}

        return Frame(image, layers, self._seen_by(camera), self.settings, stats)

    @contextlib.contextmanager
    def _holding(self, name: str) -> Iterator[None]:
        """Hold the renderer for a block that draws; name: the method's. Raises as `render`."""
        with self._lock:
            if self._closed:
                raise ClshadeError(f"Renderer.{name}: the renderer is closed")
            if os.getpid() != self._process:
                raise DeviceError(f"Renderer.{name}: expected the process that made the renderer, found a fork of it")
            try:
                yield
            except BaseException:
                with contextlib.suppress(DeviceError):  # the first error says more
                    self._finish()  # running kernels still write to memory that the error may free
                raise

    def render_many(self, cameras: Iterable[Camera], out: Mapping[str, Array] | None = None) -> Views:
        """Draw a view for each camera, with the bits of `render`, in less time.

        While the device draws one view, the host completes the last and enqueues the next, and
        kernels write straight into the arrays of all: the images and the layers of all K views, in the order
        of the cameras; K may be 0. The next call uses their memory again once nothing refers to it.

        Errors are those of `render`; cameras and arrays are refused before the first view is drawn. After an
        error or an interrupt `out` holds the views drawn so far, and the renderer stays usable.

        Parameters
        ----------
        cameras : iterable of Camera
            The cameras, all of one resolution and of the same kind as the scene's.
        out : mapping of str to ndarray, optional
            Arrays to write into, by name: ``"rgba"``, (K, M, N, 4), and layers that were asked for, each
            with the shape and type that it has in `Views`; the others are made. Memory-mapped ones
            serve for more views than fit in memory. A CPU device's kernels write straight into images that
            are contiguous and begin at multiples of 16 bytes, float64 of 64; elsewhere they are copied to.

        Examples
        --------
        >>> import clshade
        >>> from clshade.scene.adjust_camera import adjusted
        >>> scene = clshade.builtin("icosphere", resolution=(64, 48))
        >>> cameras = [adjusted(scene.camera, azimuth=10.0 * k) for k in range(36)]
        >>> with clshade.Renderer(scene, layers=("Z", "id")) as renderer:
        ...     views = renderer.render_many(cameras)
        >>> views.rgb.shape, views["Z"].shape
        ((36, 48, 64, 3), (36, 48, 64))
        """
        chosen = check_cameras(cameras, self.scene.camera)
        columns, rows = (chosen[0] if chosen else self.scene.camera).resolution
        with self._holding("render_many"):
            start, waited = running_time(), programs.this_thread.waited
            drawing = self._drawing
            kinds = {"rgba": ((4,), np.dtype(self.stages.structs.real)), **drawing.layers.kinds}
            wanted = {name: ((len(chosen), rows, columns, *width), kind) for name, (width, kind) in kinds.items()}
            arrays = result_arrays(wanted, out, self._results.take_host)
            queue = FrameQueue(drawing, arrays)
            queue.draw([self._space(camera) for camera in chosen])
            stats = {
                "views": len(chosen),
                "resolution": (columns, rows),
                **drawing.source.sizes,
                **self._times_since(start, waited, "views", queue.stage_ms),
                "ignored": ignored(self.scene, self.settings),
                "device": self.device.title,
                "lanes": self.stages.lanes,
                "bytes": {"scene": drawing.scene_bytes, "arrays": sum(array.nbytes for array in arrays.values())},
            }
        return Views(arrays, list(map(self._seen_by, chosen)), self.settings, queue.facts, stats)

    def _seen_by(self, camera: Camera) -> Scene:
        return self.scene if camera is self.scene.camera else with_fields(self.scene, camera=camera)

    def _space(self, camera: Camera) -> CameraSpace:
        return CameraSpace.of(camera, self._drawing.extent, self.settings.near)

    def _times_since(self, start: float, waited: float, total: str, stage_ms: Mapping[str, float]) -> dict[str, Any]:
        """Return times in ms for `stats`, those of making the renderer the first time. total: name of the time of all."""
        times = {**self._times, **stage_ms, total: (running_time() - start) * 1e3}
        build_ms = self._build_ms + (programs.this_thread.waited - waited) * 1e3
        self._times, self._build_ms = dict.fromkeys(self._times, 0.0), 0.0
        return {"times_ms": times, "build_ms": build_ms}

    def _finish(self) -> None:
        if os.getpid() == self._process:
            finish(self.device)

    def close(self) -> None:
        """Release the device's memory. Frames stay valid; the renderer cannot draw any more."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._finish()
            for name in vars(self).keys() - _KEPT_WHEN_CLOSED:
                delattr(self, name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def render(
    scene: Scene,
    *,
    preset: Preset | None = None,
    device: Device | str | None = None,
    settings: Settings | None = None,
    **fields: Unpack[RenderOptions],
) -> Frame:
    """Draw a scene once.

    Parameters
    ----------
    scene, preset, device, settings, **fields
        See `Renderer`, which draws any number of frames, for arguments and errors.

    Examples
    --------
    >>> import clshade
    >>> frame = clshade.render(clshade.builtin("teapot"), resolution=(320, 240), samples=4)
    >>> frame.rgba.shape
    (240, 320, 4)
    >>> frame.save("teapot")  # teapot.exr and teapot.png
    []
    """
    with Renderer(scene, preset=preset, device=device, settings=settings, **fields) as renderer:
        return renderer.render()
