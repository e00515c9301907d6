"""Changes of the values of a glTF document, by their places."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from mesh_writers import Gltf, pack_glb
from scene_files import change


def changed(document: Gltf, changes: dict[str, Any], path) -> str:
    """Write a document of which values were changed by their places, with dots between keys. Arrays become accessors, as do
    pairs of an array and fields of its accessor."""
    accessors = {}
    for place, value in changes.items():
        if isinstance(value, np.ndarray):
            accessors[place] = document.accessor(value)
        elif isinstance(value, tuple):
            accessors[place] = document.accessor(value[0], **value[1])
    document.glb(path)
    for place, value in {**changes, **accessors}.items():
        change(document.json, (int(key) if key.isdigit() else key for key in place.split(".")), value)
    path.write_bytes(pack_glb(json.dumps(document.json).encode(), document.data))
    return str(path)
