"""What a scene holds, as tables: its meshes, their scalars with their ranges, its lights and its animations."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np

from ..base.text_tables import as_lines
from .model import Light, Mesh, Scene
from .scalar_colors import at_vertices


def scene_contents(scene: Scene) -> dict[str, Any]:
    """Return meshes and scalars as JSON-compatible values; least and most are None of scalars without a number."""
    return {
        "triangles": scene.face_count,
        "lights": len(scene.lights),
        "light_scale": scene.light_scale,
        "animations": list(scene.animations),
        "each_light": [light_facts(light) for light in scene.lights],
        "meshes": [_mesh(number, mesh) for number, mesh in enumerate(scene.meshes, 1)],
    }


def light_facts(light: Light) -> dict[str, Any]:
    """Return kind and fields of a light as JSON-compatible values."""
    found: dict[str, Any] = {"kind": type(light).__name__}
    for field in fields(light):
        value = getattr(light, field.name)
        found[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return found


def _mesh(number: int, mesh: Mesh) -> dict[str, Any]:
    return {
        "number": number,
        "name": mesh.name,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.verts),
        "instances": len(np.asarray(mesh.instances)),
        "instance_names": list(mesh.instance_names),
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
    lines += _light_lines(contents)
    animations = [(_shown(name), f"{number}") for number, name in enumerate(contents["animations"])]
    lines += ["", *as_lines(("animation", "number"), animations)] if animations else []
    lines += _instance_lines(meshes)
    if found:
        lines += ["", *as_lines(("scalars", "mesh", "of", "least", "most", "NaN"), found)]
    return "\n".join(lines if found else [*lines, "no scalars"])


def _instance_lines(meshes: list[dict[str, Any]]) -> list[str]:
    """Return a table of the instances that have names, nothing without any. Numbers are those of the layer instance_id."""
    rows, first = [], 1
    for mesh in meshes:
        named = [(number, name) for number, name in enumerate(mesh["instance_names"], first) if name]
        rows += [(_shown(name), f"{number}", f"{mesh['number']}") for number, name in named]
        first += mesh["instances"]
    return ["", *as_lines(("instance", "number", "mesh"), rows)] if rows else []


def _light_lines(contents: dict[str, Any]) -> list[str]:
    """Return a table of the lights, nothing without any."""
    rows = [
        (
            light["kind"],
            f"{number}",
            _vector(light.get("position")),
            _vector(light.get("direction")),
            _size(light),
            _vector(light["intensity"]),
            f"{light['inner_cone']:.4g} to {light['outer_cone']:.4g}" if "inner_cone" in light else "-",
            light.get("attenuation", "none"),
            _number(light.get("range")),
        )
        for number, light in enumerate(contents["each_light"])
    ]
    if not rows:
        return []
    header = ("light", "number", "position", "direction", "size", "intensity", "cone, degrees", "attenuation", "range")
    lines = ["", *as_lines(header, rows, left=2)]
    if contents["light_scale"] != 1.0:
        lines.append(f"intensities are the file's, in candela and lux, times {contents['light_scale']:.6g}")
    return lines


def _size(light: dict[str, Any]) -> str:
    """Return a sphere's radius, or the width and the height of a rectangle."""
    if "right" in light:
        return " x ".join(_number(2.0 * math.hypot(*light[side])) for side in ("right", "up"))
    return f"radius {light['radius']:.4g}" if light.get("radius") else "-"


def _vector(values: list[float] | None) -> str:
    return "-" if values is None else " ".join(f"{value + 0.0:.4g}" for value in values)


def _shown(name: str) -> str:
    return (name if name.isprintable() else ascii(name)) or "unnamed"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"
