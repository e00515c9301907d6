"""The record of how an image was drawn, which its EXR's header has, and the seal of that header.

`python -m clshade verify` computes the image again from it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, cast

import numpy as np

from ..base.input_files import file_error
from ..base.json_values import found_text, parse_text, plain
from ..base.version import VERSION
from ..errors import InputError
from ..images import exr, exr_limits
from ..images.tonemap import Operator, checked
from ..scene.camera import MAX_RESOLUTION, Camera
from ..scene.description import PARTS, digest_of, part_digests
from ..scene.edges import Edges
from ..scene.image_part import PartCamera
from ..scene.model import Scene, Settings, default_tonemap
from ..scene.scalars import Scalars
from .kernel_files import kernels_digest
from .struct_layout import SUBPIXEL_BITS

RECORD, SEAL = "clshade", "clshadeSeal"  # names of the header's attributes
_STEPS, _FIRST_STEPS = 1 << SUBPIXEL_BITS, 256  # of snapped corners, per pixel: now, and when records did not name them
_PICTURE_TYPES = {"tonemap": str, "exposure": float, "colorbar": bool}
_STORAGE_TYPES = {"png": dict, "half": bool, "compression": str, "crop": bool}
# What the EXR's writer adds to the header is not sealed.
NOT_SEALED = {*exr.PROTECTED, *exr.WRITTEN, *exr_limits.OUTSIDE.values(), SEAL}


@dataclass(frozen=True)
class Picture:
    """How the PNG beside an EXR is made of it, if there is one."""

    tonemap: Operator
    exposure: float
    colorbar: bool


@dataclass(frozen=True)
class Storage:
    """What a frame's files keep of it, as of `Frame.save`."""

    png: Picture
    half: bool = False
    compression: str = "zip"
    crop: bool = False

    @classmethod
    def of(cls, scene: Scene, saving: Mapping[str, Any]) -> Storage:
        """Return what the files keep of an image of a scene. saving: keywords of `Frame.save`."""
        operator = saving.get("tonemap") or default_tonemap(scene)
        picture = Picture(operator, float(saving.get("exposure", 0.0)), bool(saving.get("colorbar", False)))
        return cls(picture, **{name: saving[name] for name in ("half", "compression", "crop") if name in saving})


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


def record_of(
    scene: Scene, settings: Settings, storage: Storage, *, device: str | None = None, command: str | None = None
) -> dict[str, Any]:
    """Return the record of an image as JSON-compatible values. scene, settings: as drawn; fields of the settings are those
    that differ from `Settings()`. The camera is None for a part of an image, and for one of more than 16384
    pixels a side."""
    is_part, usual = isinstance(scene.camera, PartCamera), vars(Settings())
    found = {
        "version": VERSION,
        "scene": part_digests(scene),
        "name": scene.name,
        "camera": None if is_part or max(scene.camera.resolution) > MAX_RESOLUTION else _values(scene.camera),
        "settings": {name: plain_value(value) for name, value in vars(settings).items() if value != usual[name]},
        "storage": {**_values(storage), "png": _values(storage.png)},
        "kernels": kernels_digest(),
        "subpixels": _STEPS,
        "device": device,
        "command": command,
    }
    return {name: value for name, value in found.items() if value is not None or name == "camera"}


def _values(instance: Any) -> dict[str, Any]:
    return {each.name: plain(getattr(instance, each.name)) for each in fields(instance)}


def plain_value(value: Any) -> Any:
    """Return the value of a field of Settings as a record has it."""
    return _values(value) if isinstance(value, (Edges, Scalars)) else plain(value)


def sealed(metadata: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the header's attributes with the record, as JSON, and the seal: the SHA-256 of all of them."""
    text = json.dumps(record, ensure_ascii=False, separators=(",", ":"))
    header = {**{name: value for name, value in metadata.items() if value is not None}, RECORD: text}
    return {**header, SEAL: seal_of(header)}


def seal_of(header: Mapping[str, Any]) -> str:
    """Return the seal that belongs to a header, as it is written or as `exr.read` returns it."""
    return digest_of({name: _stored(value) for name, value in header.items() if name not in NOT_SEALED})


def _stored(value: Any) -> Any:
    """Return an attribute as an EXR stores it."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode("utf-8")
    if isinstance(value, (float, np.ndarray, np.floating)):
        with np.errstate(over="ignore"):
            return np.asarray(value, np.float32)
    return value if isinstance(value, (bool, int)) else str(value)


def read_record(header: Mapping[str, Any], owner: str) -> Record:
    """Return the record in a header that `exr.read` returned. owner: the file, for messages. Raises InputError of one line
    if there is none, or none that could have been written."""
    text = header.get(RECORD)
    if not isinstance(text, str):
        expected = "an EXR that clshade drew, with the record of how"
        raise file_error(owner, f"header: {RECORD}", expected, "none")
    value = parse_text(text.encode("utf-8", "replace"), owner, "the record of a drawing", unique=True)
    get = partial(_get, value, owner)
    steps = get("subpixels", int, _FIRST_STEPS)
    if steps != _STEPS:
        drawn = f"1/{steps} px: only the version of clshade that drew the image can verify it"
        raise file_error(owner, f"header: {RECORD}.subpixels", f"corners snapped to 1/{_STEPS} px", drawn)
    scene = get("scene", dict)
    if set(scene) != set(PARTS) or not all(isinstance(each, str) for each in scene.values()):
        raise file_error(owner, f"{RECORD}.scene", f"digests of {', '.join(PARTS)}", found_text(scene))
    make = partial(_made, owner)
    storage = get("storage", dict)
    picture = make(Picture, _typed(owner, storage.get("png"), _PICTURE_TYPES, "storage.png"), "storage.png")
    _typed(owner, storage, _STORAGE_TYPES, "storage")
    make(checked, {"operator": picture.tonemap, "exposure": picture.exposure}, "storage.png")
    camera = value.get("camera")
    settings = make(_settings, get("settings", dict), "settings")
    if picture.colorbar and settings.scalars is None:
        raise file_error(owner, f"header: {RECORD}.storage.png", "no colorbar without scalars", "one")
    return Record(
        scene=scene,
        name=get("name", str),
        camera=None if camera is None else make(Camera, camera, "camera"),
        settings=settings,
        storage=make(Storage, {**storage, "png": picture}, "storage"),
        kernels=get("kernels", str),
        version=get("version", str),
        device=get("device", str, None),
        command=get("command", str, None),
    )


def _get(value: Any, owner: str, name: str, kind: type, *default: Any) -> Any:
    found = value.get(name, *default) if isinstance(value, dict) else None
    if not isinstance(found, kind) and not (default and found is None):
        raise file_error(owner, f"header: {RECORD}.{name}", kind.__name__, found_text(found))
    return found


def _typed(owner: str, values: Any, types: Mapping[str, type], name: str) -> Any:
    """Return values that are a mapping with these names and types. Raises InputError for others."""
    if not isinstance(values, dict) or {key: type(each) for key, each in values.items()} != types:
        expected = ", ".join(f"{key}: {each.__name__}" for key, each in types.items())
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
