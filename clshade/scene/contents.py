"""What a scene holds: its objects and their instances; tables of meshes, materials, textures, scalars, camera, lights and
animations; counts of its surface.

An object is a mesh, or several meshes of one material each that are parts of one thing (`Mesh.part_of`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array, connected_components
from ..base.text_tables import as_lines
from ..base.validation import value_error
from .camera import Camera
from .geometry import _cross, _edge_exponent, _edges, bounding_box, row_blocks, welded
from .lights import described
from .material import MAPS
from .model import Material, Mesh, Scene, Texture
from .scalar_colors import at_vertices

_MODEL = ("ka", "kd", "ks", "n", "metallic", "roughness")  # what tells of a material's reflection
MAX_COUNTED_FACES = 1 << 22  # of which shapes and edges are counted: seconds, and some hundred MB


def object_numbers(scene: Scene) -> list[int]:
    """Return the number of each mesh's object, from 1, in the order in which objects begin."""
    numbers: dict[str | int, int] = {}
    keys = (mesh.part_of or number for number, mesh in enumerate(scene.meshes))
    return [numbers.setdefault(key, len(numbers) + 1) for key in keys]


def object_names(scene: Scene) -> list[str]:
    """Return the name of each object: that of the first of its meshes."""
    numbers = object_numbers(scene)
    names = dict(zip(reversed(numbers), (mesh.name for mesh in reversed(scene.meshes)), strict=True))
    return [names[number] for number in sorted(names)]


def first_instances(scene: Scene) -> list[int]:
    """Return the number of each mesh's first instance. Instances are counted from 1, object by object: an object has as
    many as the part with the most.

    Raises InputError for more than a uint32 counts.
    """
    objects = object_numbers(scene)
    counts = np.zeros(max(objects, default=0) + 1, np.int64)
    np.maximum.at(counts, objects, [len(mesh.instances) for mesh in scene.meshes])
    first = 1 + np.cumsum(counts)
    if first[-1] > 1 << 32:
        limit = f"at most {(1 << 32) - 1} instances with the layer instance_id"
        raise value_error("render", "scene", limit, int(first[-1]) - 1)
    return (first - counts)[objects].tolist()  # type: ignore[no-any-return]


def instance_names(scene: Scene) -> list[str]:
    """Return the name of each instance, the first that a part of its object gives it, "" for none."""
    names: dict[int, str] = {}
    for first, mesh in zip(first_instances(scene), scene.meshes, strict=True):
        for number, name in enumerate(mesh.instance_names or len(mesh.instances) * ("",), first):
            names[number] = names.get(number) or name
    return [names[number] for number in sorted(names)]


def scene_contents(scene: Scene, seconds: Sequence[float | None] = (), cameras: int | None = None) -> dict[str, Any]:
    """Return what a scene holds as JSON-compatible values; least and most are None of scalars without a number.

    seconds: length of each animation, None where it is not known. cameras: how many the file has, if the scene does not
    say. What was added to a file, lights and camera, is not listed.
    """
    low, high = bounding_box(scene)
    lights = scene.lights if scene.own_lights else ()
    materials = {id(mesh.material): mesh.material for mesh in scene.meshes}
    textures = {id(texture): texture for material in materials.values() for texture in _textures(material).values()}
    numbers = {key: number for table in (materials, textures) for number, key in enumerate(table, 1)}
    objects = object_numbers(scene)
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
            {"number": k, "object": number, "first_instance": first, **_mesh(mesh, numbers)}
            for k, (mesh, number, first) in enumerate(
                zip(scene.meshes, objects, first_instances(scene), strict=True), 1
            )
        ],
        "materials": [{"number": k, **_material(item, numbers)} for k, item in enumerate(materials.values(), 1)],
        "textures": [
            {"number": k, "name": item.name, "size": [*item.texels.shape[1::-1]], "channels": item.texels.shape[2]}
            for k, item in enumerate(textures.values(), 1)
        ],
    }


def _camera(camera: Camera) -> dict[str, Any]:
    height = camera.plane[0]
    angle = math.degrees(2.0 * math.atan2(height / 2.0, camera.focal))
    return {
        "position": camera.eye.tolist(),
        "focal_point": camera.lookat.tolist(),
        "up": camera.up.tolist(),
        **({"view_height": height} if camera.orthographic else {"view_angle": angle}),
        "resolution": list(camera.resolution),
    }


def _textures(material: Material) -> dict[str, Texture]:
    """Return the textures of a material by what they are for."""
    maps = {} if material.pbr is None else {name: getattr(material.pbr, name) for name in MAPS}
    textures = {"color": material.texture, **{name.removesuffix("_texture"): texture for name, texture in maps.items()}}
    return {name: texture for name, texture in textures.items() if texture is not None}


def _material(material: Material, numbers: dict[int, int]) -> dict[str, Any]:
    model = material if material.pbr is None else material.pbr
    fields = ("ka", "kd", "ks", "n") if material.pbr is None else ("metallic", "roughness")
    return {
        "name": material.name,
        "color": material.color.tolist(),
        **{name: np.asarray(getattr(model, name)).tolist() for name in fields},
        "opacity": material.opacity,
        "alpha": "blend" if material.blend else "opaque" if material.alpha_cutoff is None else "mask",
        "textures": {name: numbers[id(texture)] for name, texture in _textures(material).items()},
    }


def _mesh(mesh: Mesh, numbers: dict[int, int]) -> dict[str, Any]:
    return {
        "name": mesh.name,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.verts),
        "instances": len(mesh.instances),
        "instance_names": list(mesh.instance_names),
        "material": mesh.material.name,
        "material_number": numbers[id(mesh.material)],
        "scalars": [_scalars(mesh, name) for name in mesh.scalars],
    }


def _scalars(mesh: Mesh, name: str) -> dict[str, Any]:
    values = mesh.scalars[name]
    numbers = values[~np.isnan(values)]
    low, high = (float(numbers.min()), float(numbers.max())) if len(numbers) else (None, None)
    place = "vertices" if at_vertices(mesh, name) else "faces" if values.ndim == 1 else "corners"
    return {"name": name, "of": place, "least": low, "most": high, "nan": int(values.size - len(numbers))}


def format_contents(contents: dict[str, Any]) -> str:
    """Return the contents as lines for the terminal."""
    meshes = contents["meshes"]
    keys = ("name", "number", "triangles", "vertices", "instances", "material_number", "object")
    head = ("mesh", "number", "triangles", "vertices", "instances", "material", "object")
    lines = [*_general_lines(contents), *_table(head, [[mesh[key] for key in keys] for mesh in meshes])]
    lines += _material_lines(contents) + _light_lines(contents)
    animations = [(item["name"], number, item["seconds"]) for number, item in enumerate(contents["animations"])]
    lines += _table(("animation", "number", "seconds"), animations)
    instances = {
        number: (name, number, mesh["object"])
        for mesh in reversed(meshes)  # the first part of an object names it
        for number, name in enumerate(mesh["instance_names"], mesh["first_instance"])
        if name
    }
    lines += _table(("instance", "number", "object"), [instances[number] for number in sorted(instances)])
    scalars = [
        (s["name"], mesh["number"], s["of"], s["least"], s["most"], s["nan"])
        for mesh in meshes
        for s in mesh["scalars"]
    ]
    return "\n".join(lines + (_table(("scalars", "mesh", "of", "least", "most", "NaN"), scalars) or ["no scalars"]))


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[str]:
    """Return an empty line and the lines of a table, whose rows begin with a name; nothing without rows."""
    lines = as_lines(head, [(_shown(name), *map(_cell, cells)) for name, *cells in rows])
    return ["", *lines] if rows else []


def _cell(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or "-"
    return _vector(value) if isinstance(value, list) else f"{value:.6g}" if isinstance(value, float) else f"{value:,}"


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
    view = f"view angle {camera['view_angle']:.4g}" if "view_angle" in camera else f"height {camera['view_height']:.6g}"
    size = "x".join(map(str, camera["resolution"]))
    first = f", the first of {count}" if count > 1 else ""
    return [*lines, f"camera  {_vector(camera['position'])} to {_vector(camera['focal_point'])}, {view}, {size}{first}"]


def _material_lines(contents: dict[str, Any]) -> list[str]:
    """Return tables of the materials and their textures."""
    rows, textures = [], []
    uses: dict[int, dict[str, list[str]]] = {}
    for item in contents["materials"]:
        model = ", ".join(f"{key} {_vector(np.unique(item[key]))}" for key in _MODEL if key in item)
        alpha = item["alpha"] + (f" {item['opacity']:.4g}" if item["opacity"] != 1.0 else "")
        rows.append((item["name"], item["number"], item["color"], model, alpha))
        for name, number in item["textures"].items():
            uses.setdefault(number, {}).setdefault(name, []).append(f"{item['number']}")
    for item in contents["textures"]:
        use = "; ".join(f"{name} of {','.join(numbers)}" for name, numbers in uses[item["number"]].items())
        textures.append((item["name"], item["number"], "x".join(map(str, item["size"])), item["channels"], use))
    return [
        *_table(("material", "number", "color", "model", "alpha"), rows),
        *_table(("texture", "number", "size", "channels", "used as, by material"), textures),
    ]


def _light_lines(contents: dict[str, Any]) -> list[str]:
    """Return a line of each light, or one on those that are added."""
    if contents["added_lights"]:
        return ["", f"no lights: {contents['added_lights']} are added, or with shader pbr the studio"]
    lines = [f"light {k}: {item['kind']} {described(item)}" for k, item in enumerate(contents["each_light"])]
    if lines and contents["light_scale"] != 1.0:
        lines.append(f"intensities are the file's, in candela and lux, times {contents['light_scale']:.6g}")
    return ["", *lines] if lines else []


def _shown(name: str) -> str:
    return (name if name.isprintable() else ascii(name)) or "unnamed"


def _vector(values: Any) -> str:
    return " ".join(f"{value + 0.0:.6g}" for value in values)


@dataclass(frozen=True)
class SurfaceFacts:
    """Counts and area of all triangles in world space; every instance counts.

    vertices: those of the meshes; positions: different ones. shapes: sets of triangles that are connected by vertices
    at equal positions, of whichever mesh. boundary_edges: edges of one triangle; non_manifold_edges: of more than two;
    a closed surface has neither. Triangles with two equal corners, which have no area, count in none of the three.
    positions, shapes and edges are None for more than MAX_COUNTED_FACES triangles.
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
    vertices = sum(len(mesh.verts) * len(mesh.instances) for mesh in scene.meshes)
    triangles = scene.face_count
    area = sum((_area(verts, faces) for mesh in scene.meshes for verts, faces in _placed(mesh)), 0.0)
    if triangles > MAX_COUNTED_FACES:
        return SurfaceFacts(vertices, triangles, area)
    return SurfaceFacts(vertices, triangles, area, *_topology(scene))


def _placed(mesh: Mesh) -> Iterator[tuple[Array, Array]]:
    """Yield the vertices (K, 3) float64 in world space and the faces (F, 3) of some instances after the other; none for a
    mesh without faces."""
    placements = mesh.instances if len(mesh.faces) else np.zeros((0, 4, 4))
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
        for verts, corners in _placed(mesh):
            points.append(verts)
            faces.append(corners + count)
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
