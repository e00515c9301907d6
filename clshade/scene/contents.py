"""What a scene holds, as tables: its meshes, and their scalars with their ranges."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.text_tables import as_lines
from .model import Mesh, Scene
from .scalar_colors import at_vertices


def scene_contents(scene: Scene) -> dict[str, Any]:
    """Return meshes and scalars as JSON-compatible values; least and most are None of scalars without a number."""
    return {
        "triangles": scene.face_count,
        "lights": len(scene.lights),
        "meshes": [_mesh(number, mesh) for number, mesh in enumerate(scene.meshes, 1)],
    }


def _mesh(number: int, mesh: Mesh) -> dict[str, Any]:
    return {
        "number": number,
        "name": mesh.name,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.verts),
        "instances": len(np.asarray(mesh.instances)),
        "material": mesh.material.name,
        "scalars": [_scalars(mesh, name) for name in mesh.scalars],
    }


def _scalars(mesh: Mesh, name: str) -> dict[str, Any]:
    values = mesh.scalars[name]
    known = values[~np.isnan(values)]
    ends = (float(known.min()), float(known.max())) if len(known) else (None, None)
    place = "vertices" if at_vertices(mesh, name) else "faces" if values.ndim == 1 else "corners"
    return {"name": name, "of": place, "least": ends[0], "most": ends[1], "nan": int(values.size - len(known))}


def format_contents(contents: dict[str, Any]) -> str:
    """Return the contents as lines for the terminal."""
    meshes = contents["meshes"]
    rows = [
        (_shown(m["name"]), f"{m['number']}", *(f"{m[name]:,}" for name in ("triangles", "vertices", "instances")))
        for m in meshes
    ]
    lines = as_lines(("mesh", "number", "triangles", "vertices", "instances"), rows)
    found = [
        (_shown(s["name"]), f"{m['number']}", s["of"], _number(s["least"]), _number(s["most"]), f"{s['nan']:,}")
        for m in meshes
        for s in m["scalars"]
    ]
    if found:
        lines += ["", *as_lines(("scalars", "mesh", "of", "least", "most", "NaN"), found)]
    return "\n".join(lines if found else [*lines, "no scalars"])


def _shown(name: str) -> str:
    return (name if name.isprintable() else ascii(name)) or "unnamed"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"
