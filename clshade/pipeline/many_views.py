"""Many rendered views in arrays: images, layers, statistics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, overload

import numpy as np

from ..base.arrays import Array
from ..base.spelling import hint
from ..base.validation import sequence, value_error
from ..errors import InputError
from ..images.layers import LAYER_REMARKS, LAYER_WORDS
from ..scene.camera import Camera
from ..scene.model import Scene, Settings
from .frame import Frame, Picture, missing_layer

_OWNER = "Renderer.render_many"


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
        facts: Sequence[Callable[[], dict[str, Any]]],
        stats: dict[str, Any],
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
        """Return the frame of a view, or a layer of all.

        Parameters
        ----------
        key : int or str
            Index of a view, or the name of a layer that was asked for.

        Returns
        -------
        Frame or ndarray
            A frame whose arrays are views of these. Or the layer, (K, M, N) or (K, M, N, components), see
            `Frame.__getitem__`.

        Raises
        ------
        InputError
            If the layer was not asked for.
        IndexError
            If there is no such view.
        """
        if isinstance(key, (int, np.integer)) and not isinstance(key, bool):
            return self._frame(range(len(self))[key])
        if not isinstance(key, str) or key not in self._layers:
            raise missing_layer("Views", key, self.layers)
        return self._layers[key]

    def _frame(self, index: int) -> Frame:
        facts, mean = self._facts[index], self.stats["times_ms"]["views"] / len(self)
        layers = {name: array[index] for name, array in self._layers.items()}
        times = {"times_ms": {"frame": mean}, "build_ms": 0.0}
        return Frame(self.rgba[index], layers, self._scenes[index], self.settings, lambda: {**times, **facts()})

    def __repr__(self) -> str:
        _, rows, columns = self.rgba.shape[:3]
        layers = f", layers {', '.join(self.layers)}" if self.layers else ""
        return f"<{len(self)} Views, {columns}x{rows}{layers}>"


def check_camera(owner: str, name: str, camera: Any, like: Camera) -> None:
    """Raise InputError for anything but a camera of the same kind as another."""
    if not isinstance(camera, Camera):
        raise value_error(owner, name, "a Camera", camera)
    if camera.orthographic != like.orthographic:
        kind = "an orthographic" if like.orthographic else "a perspective"
        raise value_error(owner, name, f"{kind} camera, as the scene's", "the other kind")


def check_cameras(cameras: Iterable[Camera], like: Camera) -> tuple[Camera, ...]:
    """Return cameras of one resolution, of the kind of another one. Raises InputError."""
    found = None if isinstance(cameras, (str, bytes)) else sequence(cameras)
    if found is None:
        raise value_error(_OWNER, "cameras", "a sequence of Cameras", cameras)
    for index, camera in enumerate(found):
        name = f"cameras[{index}]"
        check_camera(_OWNER, name, camera, like)
        if camera.resolution != found[0].resolution:
            expected = f"the resolution of all, {found[0].resolution} as that of cameras[0]"
            raise value_error(_OWNER, name, expected, camera.resolution)
    return found


def result_arrays(
    kinds: Mapping[str, tuple[tuple[int, ...], np.dtype]],
    out: Mapping[str, Array] | None,
    make: Callable[[tuple[int, ...], np.dtype], Array],
) -> dict[str, Array]:
    """Return an array for each name, of the given shape and type: that of `out`, if it has one, or what `make` returns.
    Raises InputError for other arrays, and if there is no memory."""
    if out is None:
        out = {}
    if not isinstance(out, Mapping):
        raise value_error(_OWNER, "out", "arrays by name, such as {'rgba': array}", out)
    for name in out:
        if name not in kinds:
            near = hint(name, kinds, LAYER_WORDS, remarks=LAYER_REMARKS)
            raise value_error(_OWNER, "out", f"names of {', '.join(kinds)}", name, near)
    found = {}
    for name, (shape, kind) in kinds.items():
        if name in out:
            found[name] = _checked(name, out[name], shape, kind)
    for index, (name, array) in enumerate(found.items()):
        for other in list(found)[:index]:
            if np.shares_memory(array, found[other]):
                raise InputError(f"{_OWNER}: out[{name!r}]: expected memory of its own, found that of out[{other!r}]")
    try:
        return {name: found[name] if name in found else make(*kind) for name, kind in kinds.items()}
    except MemoryError:
        size = sum(np.prod(shape) * kind.itemsize for shape, kind in kinds.values())
        expected = "as many as fit in memory, or memory-mapped arrays as out"
        raise InputError(f"{_OWNER}: cameras: expected {expected}, found {size / 2**30:.1f} GiB of results") from None


def _checked(name: str, array: Any, shape: tuple[int, ...], kind: np.dtype) -> Array:
    field, expected = f"out[{name!r}]", f"an array of shape {shape} and type {kind}"
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != kind:
        raise value_error(_OWNER, field, expected, array)
    if not array.flags.writeable:
        raise InputError(f"{_OWNER}: {field}: expected a writeable array, found a read-only one")
    return array
