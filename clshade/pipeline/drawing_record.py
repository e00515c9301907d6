"""The record of how an image was drawn, which its EXR's header has for `clshade verify`, and the seal of that header."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from ..base.json_values import plain
from ..base.version import VERSION
from ..images import exr, exr_limits
from ..scene.camera import MAX_RESOLUTION
from ..scene.description import digest_of, part_digests
from ..scene.edges import Edges
from ..scene.image_part import PartCamera
from ..scene.model import Scene, Settings, default_tonemap
from ..scene.scalars import Scalars
from .frame_files import SavingOptions
from .kernel_files import kernels_digest
from .struct_layout import SUBPIXEL_BITS

RECORD, SEAL = "clshade", "clshadeSeal"  # names of the header's attributes
STEPS = 1 << SUBPIXEL_BITS  # of snapped corners, per pixel
# Types of the options of `Frame.save` that a record holds, those of the PNG in its member `png`.
PNG = {"tonemap": str, "exposure": float, "colorbar": bool}
EXR = {"half": bool, "compression": str, "crop": bool}
# What the EXR's writer adds to the header is not sealed.
NOT_SEALED = {*exr.PROTECTED, *exr.WRITTEN, *exr_limits.OUTSIDE.values(), SEAL}


def record_of(
    scene: Scene, settings: Settings, saving: SavingOptions, *, device: str | None = None, command: str | None = None
) -> dict[str, Any]:
    """Return the record of an image as JSON-compatible values. scene, settings: as drawn; fields of the settings are those
    that differ from `Settings()`. saving: all options. The camera is None for a part of an image, and for one of more than
    16384 pixels a side."""
    is_part, usual = isinstance(scene.camera, PartCamera), vars(Settings())
    options: dict[str, Any] = {**saving, "tonemap": saving["tonemap"] or default_tonemap(scene)}
    png, storage = ({name: kind(options[name]) for name, kind in kinds.items()} for kinds in (PNG, EXR))
    found = {
        "version": VERSION,
        "scene": part_digests(scene),
        "name": scene.name,
        "camera": None if is_part or max(scene.camera.resolution) > MAX_RESOLUTION else _values(scene.camera),
        "settings": {name: plain_value(value) for name, value in vars(settings).items() if value != usual[name]},
        "storage": {"png": png, **storage},
        "kernels": kernels_digest(),
        "subpixels": STEPS,
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
