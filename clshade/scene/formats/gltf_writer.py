"""Writing scenes as binary glTF 2.0 files, .glb."""

from __future__ import annotations

import os
import warnings
from typing import Any

import numpy as np

from ...base import atomic_files
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error
from ...base.validation import path as checked_path
from ..fitting import bounding_sphere
from ..model import Scene
from ..objects import object_numbers
from .glb import Glb, add_camera, add_lights, add_placement
from .gltf_writer_materials import MaterialWriter
from .gltf_writer_meshes import MeshWriter, named

ENDING = ".glb"
_OWNER = "to_glb"


def write_glb(scene: Scene, path: Path) -> None:
    """Write a scene as a binary glTF 2.0 file, see `Scene.to_glb`."""
    checked_path(_OWNER, "path", path)
    if os.path.splitext(path)[1].lower() != ENDING:
        raise file_error(_OWNER, "path", f"a name ending in {ENDING}", shown(path))
    atomic_files.check(path)
    glb, lost = Glb(), _unsaid(scene)
    decode = scene.preset == "course"
    materials = MaterialWriter(glb, np.asarray(scene.ambient), lost, decode=decode)
    meshes = MeshWriter(glb, lost, decode=decode)
    nodes: list[int] = []
    written: dict[Any, dict[str, Any]] = {}  # by object and nodes: the parts of an object become primitives of one mesh
    for number, mesh in zip(object_numbers(scene), scene.meshes, strict=True):
        placements = np.asarray(mesh.instances)
        if not len(mesh.faces) or not len(placements):
            continue
        sets = 0 if mesh.uvs is None else 1 + len(mesh.more_uvs)
        names = mesh.instance_names or (mesh.name,) * len(placements)
        with np.errstate(over="ignore", invalid="ignore"):
            primitive, own = meshes.write(mesh, materials.write(mesh.material, sets))
            key = number, placements.tobytes(), own.tobytes()
            if key in written:
                written[key]["primitives"].append(primitive)
                continue
            written[key] = {**named(mesh.name), "primitives": [primitive]}
            index = glb.add("meshes", written[key])
            nodes += [
                add_placement(glb, each @ own, mesh=index, **named(name))
                for each, name in zip(placements, names, strict=True)
            ]
    sphere = bounding_sphere(scene.meshes)
    nodes.append(add_camera(glb, scene.camera, sphere, lost))
    if scene.lights and scene.own_lights:
        placed, extension = add_lights(glb, scene.lights, sphere, scene.light_scale, lost)
        nodes += placed
        glb.extensions["KHR_lights_punctual"] = extension
    glb.add("scenes", {**named(scene.name), "nodes": nodes, "extras": {"clshade": _extras(scene)}})
    glb.write(path, _OWNER)
    if lost:
        line = f"{shown(path)}: not in the file as in the scene: {', '.join(dict.fromkeys(lost))}"
        warnings.warn(line if line.isprintable() else ascii(line), stacklevel=3)


def _unsaid(scene: Scene) -> list[str]:
    return [] if scene.environment is None else ["the environment (none)"]


def _extras(scene: Scene) -> dict[str, Any]:
    """Return what glTF cannot say of a scene."""
    background = None if scene.background is None else np.asarray(scene.background).tolist()
    return {"preset": scene.preset, "ambient": np.asarray(scene.ambient).tolist(), "background": background}
