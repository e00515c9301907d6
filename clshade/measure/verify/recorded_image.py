"""Images in files with the record of how they were drawn, and what their stored values may have been."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from ...base.arrays import Array, Floats
from ...base.atomic_files import shown
from ...base.input_files import file_error
from ...base.json_values import found_text, parse_text
from ...errors import InputError
from ...images import exr, exr_limits
from ...images.layers import LAYER_TABLE
from ...images.tonemap import Operator, checked
from ...pipeline.frame_results import EXR, PNG, RECORD, SEAL, STEPS, seal_of
from ...scene.camera import Camera
from ...scene.description import PARTS
from ...scene.model import Settings
from ...scene.settings import Edges, Scalars

_ITS_VERSION = "only the version of clshade that drew the image can verify it"
_FIRST_STEPS = 256  # of snapped corners, per pixel, when records did not name them
_LARGEST = {np.dtype(np.float16): 2.0**16, np.dtype(np.float32): 2.0**128}  # what would follow the largest finite one


@dataclass(frozen=True)
class Storage:
    """What a frame's files keep of it: options of `Frame.save`. The first three are those of the PNG beside the EXR."""

    tonemap: Operator
    exposure: float
    colorbar: bool
    half: bool
    compression: str
    crop: bool


@dataclass(frozen=True)
class Record:
    """A record that was read. scene: SHA-256 of each of `description.PARTS`."""

    scene: dict[str, str]
    name: str
    camera: Camera | None
    settings: Settings
    storage: Storage
    kernels: str
    version: str
    device: str | None
    command: str | None


@dataclass(frozen=True, eq=False)
class RecordedImage:
    """An EXR with its record. channels: by layer, `RGBA` among them, (M, N, ...). others: channels that are of no layer.
    faults: what is wrong with the header."""

    path: Path
    record: Record
    channels: Mapping[str, Array]
    others: tuple[str, ...]
    faults: tuple[str, ...]

    @property
    def exact(self) -> bool:
        """Whether colors are stored with the bits of the frame."""
        return not self.record.storage.half and self.record.settings.precision != "float64"


def read_recorded(path: str | os.PathLike[str]) -> RecordedImage:
    """Read an EXR that a frame was saved to. Raises InputError of one line if it is none, has no record, or one of another
    size, or was compressed with loss."""
    planes, header = exr.read(path)
    owner = shown(path)
    record = read_record(header, owner)
    if header["compression"] in exr.LOSSY:
        expected = "a lossless one, whose values can be judged"
        raise file_error(owner, "compression", expected, header["compression"])
    rows, columns = planes["R"].shape if "R" in planes else (0, 0)
    if record.camera is None:
        raise file_error(owner, f"{RECORD}.camera", "the camera of a whole image of up to 16384 pixels a side", "none")
    if record.camera.resolution != (columns, rows):
        size = "{} x {} pixels".format(*record.camera.resolution)
        raise file_error(owner, "R", f"{size}, as the header says", f"{columns} x {rows}")
    if any(plane.shape != (rows, columns) for plane in planes.values()) or not set("RGBA") <= set(planes):
        raise file_error(owner, "channels", "R, G, B and A of the whole image", ", ".join(planes))
    faults, channels = set[str](), {}
    named = {
        name: [f"{name}.{component}" for component in LAYER_TABLE[name].components] for name in record.settings.layers
    }
    for name, names in (("RGBA", list("RGBA")), *named.items()):
        if not set(names or [name]) <= set(planes):
            raise file_error(owner, "channels", f"the layer {name}, as the header says", "none")
        parts = [planes.pop(channel) for channel in names or [name]]
        faults.update(_type_faults(parts, name, record, owner))
        channels[name] = np.stack(parts, axis=-1) if names else parts[0]
    all_faults = (*_header_faults(header, record), *sorted(faults))
    return RecordedImage(Path(path), record, channels, tuple(planes), all_faults)


def read_record(header: Mapping[str, Any], owner: str) -> Record:
    """Return the record in a header that `exr.read` returned. owner: the file, for messages. Raises InputError of one line
    if there is none, or none that could have been written."""
    text = header.get(RECORD)
    if not isinstance(text, str):
        raise file_error(owner, f"header: {RECORD}", "an EXR that clshade drew, with the record of how", "none")
    value = parse_text(text.encode("utf-8", "replace"), owner, "the record of a drawing", unique=True)
    get = partial(_get, value, owner)
    steps = get("subpixels", int, _FIRST_STEPS)
    if steps != STEPS:
        raise file_error(
            owner, f"header: {RECORD}.subpixels", f"corners snapped to 1/{STEPS} px", f"1/{steps} px: {_ITS_VERSION}"
        )
    scene = get("scene", dict)
    if set(scene) != set(PARTS) or not all(isinstance(digest, str) for digest in scene.values()):
        raise file_error(owner, f"{RECORD}.scene", f"digests of {', '.join(PARTS)}", found_text(scene))
    make = partial(_made, owner)
    storage = get("storage", dict)
    picture = _typed(owner, storage.get("png"), PNG, "storage.png")
    _typed(owner, storage, {"png": dict, **EXR}, "storage")
    make(checked, {"operator": picture["tonemap"], "exposure": picture["exposure"]}, "storage.png")
    camera = value.get("camera")
    drawn = get("settings", dict)
    if drawn.get("precision") == "fast":  # which had bits of its own
        field = f"header: {RECORD}.settings.precision"
        raise file_error(owner, field, "float32 or float64", f"fast: {_ITS_VERSION}")
    settings = make(_settings, drawn, "settings")
    if picture["colorbar"] and settings.scalars is None:
        raise file_error(owner, f"header: {RECORD}.storage.png", "no colorbar without scalars", "one")
    return Record(
        scene=scene,
        name=get("name", str),
        camera=None if camera is None else make(Camera, camera, "camera"),
        settings=settings,
        storage=Storage(**picture, **{name: storage[name] for name in EXR}),
        kernels=get("kernels", str),
        version=get("version", str),
        device=get("device", str, None),
        command=get("command", str, None),
    )


def _get(value: Any, owner: str, name: str, kind: type, *default: Any) -> Any:
    field = value.get(name, *default) if isinstance(value, dict) else None
    if not isinstance(field, kind) and not (default and field is None):
        raise file_error(owner, f"header: {RECORD}.{name}", kind.__name__, found_text(field))
    return field


def _typed(owner: str, values: Any, types: Mapping[str, type], name: str) -> Any:
    """Return values that are a mapping with these names and types. Raises InputError for others."""
    if not isinstance(values, dict) or {key: type(value) for key, value in values.items()} != types:
        expected = ", ".join(f"{key}: {kind.__name__}" for key, kind in types.items())
        raise file_error(owner, f"header: {RECORD}.{name}", expected, found_text(values))
    return values


def _made(owner: str, make: Callable[..., Any], values: Any, name: str) -> Any:
    """Return what these arguments make. Raises InputError, naming the part of the record, where they make nothing."""
    try:
        return make(**cast("dict[str, Any]", values))
    except (InputError, TypeError, ValueError, OverflowError) as error:
        raise file_error(owner, f"header: {RECORD}.{name}", "what clshade writes", str(error)) from None


def _settings(**values: Any) -> Settings:
    for name, kind in (("edges", Edges), ("scalars", Scalars)):
        if values.get(name) is not None:
            values[name] = kind(**values[name])
    return Settings(**values)


def _type_faults(planes: list[Array], name: str, record: Record, owner: str) -> list[str]:
    """Return what is wrong with the floats of a layer's planes. Raises InputError if they are not of its kind."""
    row = None if name == "RGBA" else LAYER_TABLE[name]  # type: ignore[index]
    is_half = record.storage.half and name not in exr.FULL_PRECISION
    expected = np.dtype(np.uint32 if row and row.kind == "uint32" else np.float16 if is_half else np.float32)
    dtypes = [plane.dtype for plane in planes]
    if any(dtype.kind != expected.kind for dtype in dtypes):
        raise file_error(owner, "channels", f"{name} as {expected}", ", ".join(map(str, dtypes)))
    return [f"the file was written again: {dtype} where it had {expected}" for dtype in dtypes if dtype != expected]


def _header_faults(header: Mapping[str, Any], record: Record) -> tuple[str, ...]:
    """Return what is not in the header as it was written."""
    faults = []
    if header.get(SEAL) != seal_of(header):
        faults.append(f"the header was changed: its seal, {SEAL}, is not that of its attributes")
    usual: dict[str, Any] = {**exr.WRITTEN, "screenWindowWidth": 1.0, "screenWindowCenter": (0.0, 0.0)}
    usual |= {"lineOrder": "increasing_y", **{exr_limits.OUTSIDE[name]: value for name, value in exr.FAR.items()}}
    for name, value in usual.items():
        if name in header and not np.array_equal(header[name], value, equal_nan=isinstance(value, float)):
            faults.append(f"the header was changed: {name} is not {value}")
    faults += [f"the header was changed: it has no {name}" for name in exr.WRITTEN if name not in header]
    if header["compression"] != record.storage.compression:
        faults.append(f"the file was compressed again: {header['compression']}, not {record.storage.compression}")
    return tuple(faults)


def stored_range(values: Array) -> tuple[Floats, Floats]:
    """Return the least and the largest value that may be stored as these floats, float64 of the same shape."""
    limit = _LARGEST[values.dtype]
    with np.errstate(over="ignore", invalid="ignore"):
        up, down = (np.nextafter(values, values.dtype.type(to)).astype(np.float64) for to in (np.inf, -np.inf))
        stored = values.astype(np.float64)
        near = np.clip(stored, -limit, limit)
        low, high = ((near + np.clip(bound, -limit, limit)) / 2.0 for bound in (down, up))
    return np.where(stored == -np.inf, stored, low), np.where(stored == np.inf, stored, high)


def nearest_stored(values: Array, expected: Array) -> Floats:
    """Return what is nearest to the expected values of all that may be stored as these floats, float64; NaN where they
    are."""
    low, high = stored_range(values)
    with np.errstate(invalid="ignore"):
        return np.where(np.isnan(expected), values.astype(np.float64), np.clip(expected, low, high))
