"""Animations of a glTF file: the properties of nodes at a time (glTF 2.0, section 3.11 and appendix C)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...base.arrays import Array, Floats
from ...base.input_files import file_error, quoted
from ...base.spelling import hint
from .gltf_data import Buffers, Item

# By node: translation, rotation, scale, weights, those that are animated.
NodeValues: TypeAlias = dict[int, dict[str, Floats]]

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3, "weights": 0}  # of a value; weights: one for each morph target
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
ALL = "all"  # in place of an animation: some exporters write one for each node
_POINTER = "KHR_animation_pointer"


@dataclass(frozen=True, eq=False)
class Channel:
    """A property of a node over time.

    times: (n,), seconds, increasing. values: (n, width); quaternions have length 1, but for those of CUBICSPLINE, which
    are the file's. tangents: (n, 2, width) of CUBICSPLINE, those that arrive at each value and those that leave it, per
    second; else None.
    """

    node: int
    path: str
    interpolation: str
    times: Floats
    values: Floats
    tangents: Floats | None

    def at(self, time: float) -> Floats:
        """Return the value (width,) at a time in seconds; before the first and after the last it is theirs."""
        k = int(np.searchsorted(self.times, time, "right")) - 1
        if k < 0 or k >= len(self.times) - 1 or self.interpolation == "STEP":
            return np.asarray(self.values[max(k, 0)])
        step = float(self.times[k + 1] - self.times[k])
        t, before, after = (time - float(self.times[k])) / step, self.values[k], self.values[k + 1]
        if self.tangents is not None:
            value = hermite(t, before, after, step * self.tangents[k, 1], step * self.tangents[k + 1, 0])
            return unit(value) if self.path == "rotation" else value
        if self.path == "rotation":
            return slerp(t, before, after)
        return np.asarray((1.0 - t) * before + t * after)


@dataclass(frozen=True, eq=False)
class Animation:
    """An animation of a file. seconds: the last time of its channels."""

    name: str
    seconds: float
    channels: tuple[Channel, ...]

    def at(self, time: float) -> NodeValues:
        """Return what is animated, at a time in seconds."""
        with np.errstate(over="ignore"):
            time = float(np.float32(time))  # as the file's times are: a step at 0.1 s has begun at 0.1
        pose: NodeValues = {}
        for channel in self.channels:
            pose.setdefault(channel.node, {})[channel.path] = channel.at(time)
        return pose


def hermite(t: float, before: Floats, after: Floats, leaving: Floats, arriving: Floats) -> Floats:
    """Return the cubic Hermite spline at t from 0 to 1; tangents are per interval."""
    t2, t3 = t * t, t * t * t
    return (
        (2.0 * t3 - 3.0 * t2 + 1.0) * before
        + (t3 - 2.0 * t2 + t) * leaving
        + (3.0 * t2 - 2.0 * t3) * after
        + (t3 - t2) * arriving
    )


def slerp(t: float, before: Floats, after: Floats) -> Floats:
    """Interpolate unit quaternions, at constant speed, on the shorter of the two arcs (glTF 2.0, appendix C.4)."""
    cosine = float(before @ after)
    after = after if cosine >= 0.0 else -after
    # From the half chords: near 0, where arccos(cosine) would lose half of the digits, this angle keeps them.
    angle = 2.0 * math.atan2(float(np.linalg.norm(after - before)), float(np.linalg.norm(after + before)))
    if angle < 1e-9:
        return unit((1.0 - t) * before + t * after)
    return unit(math.sin((1.0 - t) * angle) * before + math.sin(t * angle) * after)


def unit(quaternion: Floats) -> Floats:
    """Return a quaternion of length 1; 0, through which a spline may pass, is the identity."""
    length = float(np.linalg.norm(quaternion))
    return quaternion / length if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])


def names_of(document: Item) -> tuple[str, ...]:
    """Return the names of the file's animations, "" where they have none or are broken: `read_animation` refuses those."""
    entries = document.value.get("animations")
    entries = entries if isinstance(entries, list) else []
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    return tuple(n.encode("utf-8", "replace").decode("utf-8") if isinstance(n, str) else "" for n in names)


def read_animation(buffers: Buffers, selection: str | int | None) -> Animation:
    """Read an animation: by name, by number from 0, also as text, or the first; or all of them at once, by ALL, of
    which the last counts where several animate one property.

    Raises InputError for an unknown animation, and for broken samplers.
    """
    document = buffers.document
    count = document.count("animations")
    if selection == ALL and count and ALL not in names_of(document):
        animations = [_animation(buffers, index) for index in range(count)]
        by_property = {
            (channel.node, channel.path): channel for animation in animations for channel in animation.channels
        }
        return Animation(ALL, max(animation.seconds for animation in animations), tuple(by_property.values()))
    return _animation(buffers, _chosen(document, selection))


def _animation(buffers: Buffers, index: int) -> Animation:
    item = buffers.document.entry("animations", index)
    channels: dict[tuple[int, str], Channel] = {}
    for entry in item.items("channels"):
        target = entry.item("target")
        if target is None:
            raise entry.error("target", "an object", "none")
        path, node = target.text("path"), target.reference("node", "nodes")
        if path == "pointer":
            buffers.ignored.append(_POINTER)
        elif path not in _WIDTHS:
            raise target.error("path", "one of " + ", ".join(_WIDTHS), quoted(path) if path else "none")
        elif node is not None:  # without a node it is the target of an extension
            if (node, path) in channels:
                raise target.error("path", "one channel for each property", f"another for {path} of nodes[{node}]")
            channels[node, path] = _channel(buffers, item, entry, node, path)
    seconds = max((float(channel.times[-1]) for channel in channels.values()), default=0.0)
    return Animation(item.text("name") or f"animation {index}", seconds, tuple(channels.values()))


def _chosen(document: Item, selection: str | int | None) -> int:
    names = names_of(document)
    if not names:
        raise file_error(document.owner, "animations", "an animation to show", "none")
    if selection is None:
        return 0
    if isinstance(selection, str) and selection in names:
        return names.index(selection)
    text = str(selection)
    if text.isascii() and text.isdigit() and len(text) < 9 and int(text) < len(names):
        return int(text)
    listed = [shortened(name) for name in names if name][:16]
    expected = "one of " + ", ".join([*listed, f"a number from 0 to {len(names) - 1}", ALL])
    raise file_error(document.owner, "animation", expected, quoted(text) + hint(text, [name for name in names if name]))


def shortened(name: str) -> str:
    """Return a name of a file as it is printed: in one line, and not longer than that."""
    name = name if name.isprintable() else ascii(name)
    return name if len(name) <= 64 else name[:64] + "..."


def _channel(buffers: Buffers, item: Item, entry: Item, node: int, path: str) -> Channel:
    number, samplers = entry.integer("sampler"), list(item.items("samplers"))
    if number >= len(samplers):
        raise entry.error("sampler", f"an index of the {len(samplers)} samplers", str(number))
    animated = buffers.document.entry("nodes", node)
    if path != "weights" and "matrix" in animated.value:
        raise entry.error("target.node", "a node without a matrix", f"nodes[{node}], which has one")
    width = _WIDTHS[path] or target_count(animated)
    if not width:
        raise entry.error("target.node", "a node whose mesh has morph targets", f"nodes[{node}]")
    sampler = samplers[number]
    kind = sampler.text("interpolation", "LINEAR")
    if kind not in _INTERPOLATIONS:
        raise sampler.error("interpolation", "one of " + ", ".join(_INTERPOLATIONS), quoted(kind))
    times = _times(buffers, sampler)
    values = _values(buffers, sampler, len(times), width, path, cubic=kind == "CUBICSPLINE")
    keys = values[:, values.shape[1] // 2]
    if path == "rotation":
        lengths = np.linalg.norm(keys, axis=1)
        if not lengths.all():
            raise sampler.error("output", "quaternions other than 0", f"0 in row {int(np.argmin(lengths))}")
        if values.shape[1] == 1:  # the tangents of a spline belong to the values as they are
            keys = keys / lengths[:, None]
    tangents = values[:, [0, 2]] if values.shape[1] == 3 else None
    return Channel(node, path, kind, times, keys, tangents)


def target_count(node: Item) -> int:
    """Return the number of morph targets of a node's mesh."""
    mesh = node.reference("mesh", "meshes")
    primitives = [] if mesh is None else list(node.entry("meshes", mesh).items("primitives"))
    return len(list(primitives[0].items("targets"))) if primitives else 0


def _times(buffers: Buffers, sampler: Item) -> Floats:
    index = sampler.index("input", "accessors")
    array = buffers.array(index)
    if array.shape[1] != 1 or array.dtype != np.float32:
        raise sampler.error("input", "float32 of type SCALAR", f"another type in accessors[{index}]")
    times: Floats = array[:, 0].astype(np.float64)
    good = np.isfinite(times) & (times >= 0.0)
    if not good.all():
        row = int(np.argmin(good))
        raise sampler.error("input", "finite times from 0 on", f"{times[row]:g} in row {row} of accessors[{index}]")
    if not (np.diff(times) > 0.0).all():
        row = int(np.argmin(np.diff(times) > 0.0)) + 1
        found = f"{times[row]:g} after {times[row - 1]:g} in row {row} of accessors[{index}]"
        raise sampler.error("input", "times that increase", found)
    return times


def _values(buffers: Buffers, sampler: Item, count: int, width: int, path: str, *, cubic: bool) -> Floats:
    """Return (count, 1 or 3, width) numbers: values, or tangent, value and tangent of a spline."""
    index = sampler.index("output", "accessors")
    array: Array = buffers.array(index)
    columns, parts = 1 if path == "weights" else width, 3 if cubic else 1
    rows = count * parts * (width // columns)
    if array.dtype != np.float32:
        raise sampler.error("output", "float32 or normalized integers", f"others in accessors[{index}]")
    if array.shape != (rows, columns):
        expected = f"{rows} rows of {columns} for {count} times"
        raise sampler.error("output", expected, f"{array.shape[0]} of {array.shape[1]} in accessors[{index}]")
    if not np.isfinite(array).all():
        row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise sampler.error("output", "finite numbers", f"{array[row].tolist()} in row {row} of accessors[{index}]")
    return array.astype(np.float64).reshape(count, parts, width)
