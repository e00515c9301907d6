"""What a scene holds, as tables: meshes, materials, textures, scalars, camera, lights, animations; counts of its surface."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array, connected_components
from ..base.text_tables import as_lines
from .camera import Camera
from .geometry import _cross, _edge_exponent, _edges, bounding_box, row_blocks, welded
from .lights import described
from .metallic_roughness import MAPS
from .model import Material, Mesh, Scene, Texture
from .objects import first_instances, object_numbers
from .scalar_colors import at_vertices

MOST_FACES = 1 << 22  # of which shapes and edges are counted: seconds, and some hundred MB


def scene_contents(scene: Scene, seconds: Sequence[float | None] = (), cameras: int | None = None) -> dict[str, Any]:
    """Return what a scene holds as JSON-compatible values; least and most are None of scalars without a number.

    seconds: length of each animation, None where it is not known. cameras: how many the file has, if the scene does not
    say. What was added to a file, lights and camera, is not listed.
    """
    low, high = bounding_box(scene)
    lights = scene.lights if scene.own_lights else ()
    materials = {id(mesh.material): mesh.material for mesh in scene.meshes}
    textures = {id(each): each for material in materials.values() for each in _textures(material).values()}
    material_numbers, texture_numbers = ({key: k for k, key in enumerate(each, 1)} for each in (materials, textures))
    objects = object_numbers(scene)
    numbers = zip(objects, first_instances(scene), strict=True)
    lengths = [*seconds, *[None] * (len(scene.animations) - len(seconds))]
    return {
        "name": scene.name,
        "preset": scene.preset,
        "triangles": scene.face_count,
        "bounds": [low.tolist(), high.tolist()],
        "cameras": int(not scene.fitted) if cameras is None else cameras,
        "camera": None if scene.fitted else _camera(scene.camera),
        "lights": len(lights),
        "added_lights": len(scene.lights) - len(lights),
        "light_scale": scene.light_scale,
        "environment": scene.environment is not None,
        "animations": [{"name": name, "seconds": s} for name, s in zip(scene.animations, lengths, strict=True)],
        "each_light": [light.facts() for light in lights],
        "objects": max(objects, default=0),
        "meshes": [
            {"number": number, "object": own, "first_instance": first, **_mesh(mesh, material_numbers)}
            for number, (mesh, (own, first)) in enumerate(zip(scene.meshes, numbers, strict=True), 1)
        ],
        "materials": [_material(k, each, texture_numbers) for k, each in enumerate(materials.values(), 1)],
        "textures": [
            {"number": k, "name": each.name, "size": [*each.texels.shape[1::-1]], "channels": each.texels.shape[2]}
            for k, each in enumerate(textures.values(), 1)
        ],
    }


def _camera(camera: Camera) -> dict[str, Any]:
    height = camera.plane[0]
    angle = math.degrees(2.0 * math.atan2(height / 2.0, camera.focal))
    size = {"view_height": height} if camera.orthographic else {"view_angle": angle}
    return {
        "position": camera.eye.tolist(),
        "focal_point": camera.lookat.tolist(),
        "up": camera.up.tolist(),
        **size,
        "resolution": list(camera.resolution),
    }


def _textures(material: Material) -> dict[str, Texture]:
    """Return the textures of a material by what they are for."""
    found = {"color": material.texture}
    if material.pbr is not None:
        found |= {name.removesuffix("_texture"): getattr(material.pbr, name) for name in MAPS}
    return {name: texture for name, texture in found.items() if texture is not None}


def _material(number: int, material: Material, numbers: dict[int, int]) -> dict[str, Any]:
    pbr = material.pbr
    if pbr is None:
        model: dict[str, Any] = {name: np.asarray(getattr(material, name)).tolist() for name in ("ka", "kd", "ks", "n")}
    else:
        model = {"metallic": pbr.metallic, "roughness": pbr.roughness}
    alpha = "blend" if material.blend else "opaque" if material.alpha_cutoff is None else "mask"
    return {
        "number": number,
        "name": material.name,
        "color": material.color.tolist(),
        **model,
        "opacity": material.opacity,
        "alpha": alpha,
        "textures": {name: numbers[id(texture)] for name, texture in _textures(material).items()},
    }


def _mesh(mesh: Mesh, numbers: dict[int, int]) -> dict[str, Any]:
    return {
        "name": mesh.name,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.verts),
        "instances": len(np.asarray(mesh.instances)),
        "instance_names": list(mesh.instance_names),
        "material": mesh.material.name,
        "material_number": numbers[id(mesh.material)],
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
        (
            _shown(m["name"]),
            *(f"{m[name]:,}" for name in ("number", "triangles", "vertices", "instances", "material_number", "object")),
        )
        for m in meshes
    ]
    lines = [
        *_general_lines(contents),
        "",
        *as_lines(("mesh", "number", "triangles", "vertices", "instances", "material", "object"), rows),
    ]
    lines += _material_lines(contents)
    found = [
        (_shown(s["name"]), f"{m['number']}", s["of"], _number(s["least"]), _number(s["most"]), f"{s['nan']:,}")
        for m in meshes
        for s in m["scalars"]
    ]
    lines += _light_lines(contents)
    animations = [(_shown(a["name"]), f"{k}", _number(a["seconds"])) for k, a in enumerate(contents["animations"])]
    lines += ["", *as_lines(("animation", "number", "seconds"), animations)] if animations else []
    lines += _instance_lines(meshes)
    if found:
        lines += ["", *as_lines(("scalars", "mesh", "of", "least", "most", "NaN"), found)]
    return "\n".join(lines if found else [*lines, "no scalars"])


def _instance_lines(meshes: list[dict[str, Any]]) -> list[str]:
    """Return a table of the instances that have names, nothing without any. Numbers are those of the layer instance_id."""
    found: dict[int, tuple[str, str, str]] = {}
    for mesh in meshes:
        for number, name in enumerate(mesh["instance_names"], mesh["first_instance"]):
            if name:
                found.setdefault(number, (_shown(name), f"{number}", f"{mesh['object']}"))
    return ["", *as_lines(("instance", "number", "object"), [*found.values()])] if found else []


def _general_lines(contents: dict[str, Any]) -> list[str]:
    """Return a line each on the scene, its bounding box and its camera."""
    low, high = contents["bounds"]
    camera, count = contents["camera"], contents["cameras"]
    lines = [
        f"scene   {_shown(contents['name'])}: {contents['triangles']:,} triangles, preset {contents['preset']}",
        f"bounds  {_vector(low)} to {_vector(high)}, size {_vector(np.subtract(high, low))}",
    ]
    if camera is None:
        unused = f", {count} without use" if count else ""
        return [*lines, f"camera  none{unused}: one that shows all is added"]
    seen = f"view angle {camera['view_angle']:.4g}" if "view_angle" in camera else f"height {camera['view_height']:.6g}"
    size = "x".join(map(str, camera["resolution"]))
    first = f", the first of {count}" if count > 1 else ""
    return [*lines, f"camera  {_vector(camera['position'])} to {_vector(camera['focal_point'])}, {seen}, {size}{first}"]


def _material_lines(contents: dict[str, Any]) -> list[str]:
    """Return tables of the materials and their textures."""
    rows = []
    uses: dict[int, dict[str, list[str]]] = {}
    for each in contents["materials"]:
        names = ("metallic", "roughness") if "metallic" in each else ("ka", "kd", "ks", "n")
        model = ", ".join(f"{name} {_vector(np.unique(each[name]))}" for name in names)
        alpha = each["alpha"] + (f" {each['opacity']:.4g}" if each["opacity"] != 1.0 else "")
        rows.append((_shown(each["name"]), f"{each['number']}", _vector(each["color"]), model, alpha))
        for name, number in each["textures"].items():
            uses.setdefault(number, {}).setdefault(name, []).append(f"{each['number']}")
    lines = ["", *as_lines(("material", "number", "color", "model", "alpha"), rows)]
    textures = [
        (
            *(_shown(each["name"]), f"{each['number']}", "x".join(map(str, each["size"])), f"{each['channels']}"),
            "; ".join(f"{name} of {','.join(numbers)}" for name, numbers in uses[each["number"]].items()),
        )
        for each in contents["textures"]
    ]
    head = ("texture", "number", "size", "channels", "used as, by material")
    return lines + (["", *as_lines(head, textures)] if textures else [])


def _light_lines(contents: dict[str, Any]) -> list[str]:
    """Return a line of each light, or one on those that are added."""
    lights, added = contents["each_light"], contents["added_lights"]
    if added:
        return ["", f"no lights: {added} are added, or with shader pbr the studio"]
    lines = ["", *(f"light {number}: {each['kind']} {described(each)}" for number, each in enumerate(lights))]
    if contents["light_scale"] != 1.0:
        lines.append(f"intensities are the file's, in candela and lux, times {contents['light_scale']:.6g}")
    return lines if lights else []


def _shown(name: str) -> str:
    return (name if name.isprintable() else ascii(name)) or "unnamed"


def _vector(values: Any) -> str:
    return " ".join(f"{value + 0.0:.6g}" for value in values)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"


@dataclass(frozen=True)
class SurfaceFacts:
    """Counts and area of all triangles in world space; every instance counts.

    vertices: those of the meshes; positions: different ones. shapes: sets of triangles that are connected by vertices
    at equal positions, of whichever mesh. boundary_edges: edges of one triangle; non_manifold_edges: of more than two;
    a closed surface has neither. Triangles with two equal corners, which have no area, count in none of the three.
    positions, shapes and edges are None for more than MOST_FACES triangles.
    area: in squared scene units.
    """

    vertices: int
    triangles: int
    area: float
    positions: int | None = None
    shapes: int | None = None
    boundary_edges: int | None = None
    non_manifold_edges: int | None = None

    @property
    def closed(self) -> bool | None:
        """Whether there are shapes, and every edge has two triangles; None if edges were not counted."""
        if self.boundary_edges is None:
            return None
        return bool(self.shapes) and not (self.boundary_edges or self.non_manifold_edges)


def surface_facts(scene: Scene) -> SurfaceFacts:
    """Return counts and area of a scene's triangles."""
    vertices = sum(len(mesh.verts) * len(np.asarray(mesh.instances)) for mesh in scene.meshes)
    triangles = scene.face_count
    area = sum((_area(verts, faces) for mesh in scene.meshes for verts, faces in _placed(mesh)), 0.0)
    if triangles > MOST_FACES:
        return SurfaceFacts(vertices, triangles, area)
    return SurfaceFacts(vertices, triangles, area, *_topology(scene))


def _placed(mesh: Mesh) -> Iterator[tuple[Array, Array]]:
    """Yield the vertices (K, 3) float64 in world space and the faces (F, 3) of some instances after the other; none for a
    mesh without faces."""
    placements = np.asarray(mesh.instances) if len(mesh.faces) else np.zeros((0, 4, 4))
    verts, faces = mesh.verts.astype(np.float64), mesh.faces.astype(np.int64)
    many = max(1, (1 << 14) // len(verts))
    for first in range(0, len(placements), many):
        some = placements[first : first + many]
        placed = verts @ some[:, :3, :3].transpose(0, 2, 1) + some[:, None, :3, 3]
        placed[(some == np.eye(4)).all(axis=(1, 2))] = verts
        starts = len(verts) * np.arange(len(some))
        yield placed.reshape(-1, 3), (faces + starts[:, None, None]).reshape(-1, 3)


def _area(verts: Array, faces: Array) -> float:
    """Return the area of triangles, scaled by a power of two meanwhile so that squares neither overflow nor vanish."""
    exponent, total = _edge_exponent(verts, faces), 0.0
    for block in row_blocks(len(faces)):
        edges = _edges(verts, faces[block], exponent)
        squares = sum(np.square(_cross(edges, axis)) for axis in range(3))
        total += float(np.sqrt(squares).sum())
    with np.errstate(over="ignore", under="ignore"):
        return float(np.ldexp(2.0 * total, 2 * exponent))  # half of the cross product of edges, which are halved


def _topology(scene: Scene) -> tuple[int, int, int, int]:
    """Return the numbers of positions, shapes, boundary and non-manifold edges."""
    points, faces, count = [], [], 0
    for mesh in scene.meshes:
        for verts, own in _placed(mesh):
            points.append(verts)
            faces.append(own + count)
            count += len(verts)
    if not points:
        return 0, 0, 0, 0
    corners = welded(np.concatenate(points))[1][np.concatenate(faces)]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    start, end = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    edges, uses = np.unique(np.minimum(start, end).astype(np.int64) << 32 | np.maximum(start, end), return_counts=True)
    used = np.unique(corners)
    labels = connected_components(int(used.max(initial=-1)) + 1, edges >> 32, edges & 0xFFFFFFFF)
    shapes = int(np.count_nonzero(labels[used] == used))
    return len(used), shapes, int(np.count_nonzero(uses == 1)), int(np.count_nonzero(uses > 2))
