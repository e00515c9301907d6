"""The node hierarchy of a glTF file: placements of meshes, cameras and lights in the world.

Lights (KHR_lights_punctual) are exposed for an image whose white is 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ...base.arrays import Array, Floats
from ..camera import MAX_RESOLUTION, Camera
from ..framing import RESOLUTION
from ..lights import Attenuation, DirectionalLight, PlacedLight, PointLight, SpotLight
from ..model import Light
from .gltf_data import Item

# By node: translation, rotation, scale, weights, those that are animated.
NodeValues: TypeAlias = dict[int, dict[str, Floats]]

MAX_NODES = 1 << 18
_MAX_FLOAT32 = float(np.finfo(np.float32).max)
_HALF_PI = 1.5707964  # the float32 next to it is larger
_ATTENUATION: Attenuation = "inverse-square"
_LEVEL = 1e-6  # radians: less is the rounding of rotations in float32, and moves no pixel


class Placement(NamedTuple):
    """A mesh in the world. node: its index, if it has a skin or weights. weights: of morph targets, where they are not the
    mesh's. name: of the node."""

    matrix: Array
    node: int | None = None
    skin: int | None = None
    weights: Floats | None = None
    name: str = ""


@dataclass
class Placed:
    """The contents of the scene's nodes, in depth-first order.

    meshes: placements by index. cameras, lights: pairs of index or object, and matrix. worlds: the matrix of each node in
    the world, by index.
    """

    meshes: dict[int, list[Placement]] = field(default_factory=dict)
    cameras: list[tuple[int, Array]] = field(default_factory=list)
    lights: list[tuple[Item, Array]] = field(default_factory=list)
    worlds: dict[int, Array] = field(default_factory=dict)


def place_nodes(document: Item, pose: NodeValues) -> Placed:
    """Return the contents of the file's scene: the one it names, else its first, else all nodes that have no parent.

    pose: properties of nodes in place of the file's. In a file without nodes each mesh is placed once. Raises InputError
    for more than MAX_NODES nodes, one that is reached twice, and broken fields.
    """
    count, content = document.count("nodes"), Placed()
    if count > MAX_NODES:
        raise document.error("nodes", f"at most {MAX_NODES}", str(count))
    if not count and document.count("meshes") <= MAX_NODES:
        content.meshes = {index: [Placement(np.eye(4))] for index in range(document.count("meshes"))}
    if document.count("scenes"):
        scene = document.entry("scenes", document.reference("scene", "scenes") or 0)
        roots = scene.references("nodes", "nodes")
    else:
        roots = _parentless(document)
    for index in _visited(document, roots, pose, content.worlds):
        _collect(document.entry("nodes", index), index, content, pose.get(index, {}))
    if any(placement.skin is not None for placements in content.meshes.values() for placement in placements):
        outside = [node for node in _parentless(document) if node not in content.worlds]
        list(_visited(document, outside, pose, content.worlds))  # joints may lie outside the scene
    return content


def _parentless(document: Item) -> list[int]:
    children = {child for node in document.items("nodes") for child in node.references("children", "nodes")}
    return [index for index in range(document.count("nodes")) if index not in children]


def _visited(document: Item, roots: list[int], pose: NodeValues, worlds: dict[int, Array]) -> Iterator[int]:
    """Yield nodes, depth first; their matrices are in `worlds` by then."""
    stack = [(index, np.eye(4)) for index in reversed(roots)]
    while stack:
        index, parent = stack.pop()
        if index in worlds:
            raise document.error(f"nodes[{index}]", "a tree of nodes", "a node that is reached twice")
        node, changed = document.entry("nodes", index), pose.get(index, {})
        matrix = parent
        if (node.value.keys() | changed.keys()) & {"matrix", "translation", "rotation", "scale"}:
            with np.errstate(over="ignore", invalid="ignore"):
                matrix = parent @ _matrix(node, changed)
            if not np.isfinite(matrix).all():
                raise node.error("matrix", "a finite placement in the world", "an overflow")
        worlds[index] = matrix
        yield index
        stack += [(child, matrix) for child in reversed(node.references("children", "nodes"))]


def _collect(node: Item, index: int, content: Placed, changed: Mapping[str, Floats]) -> None:
    matrix = content.worlds[index]
    mesh, camera = node.reference("mesh", "meshes"), node.reference("camera", "cameras")
    if mesh is not None:
        skin, weights = node.reference("skin", "skins"), changed.get("weights")
        count = target_count(node)
        if weights is None and count and "weights" in node.value:
            weights = node.numbers("weights", count)
        number = index if skin is not None or weights is not None else None
        content.meshes.setdefault(mesh, []).append(Placement(matrix, number, skin, weights, node.text("name")))
    if camera is not None:
        content.cameras.append((camera, matrix))
    light = node.extension("KHR_lights_punctual")
    if light is not None:
        extension = node.file.document.extension("KHR_lights_punctual")
        lights = [] if extension is None else list(extension.items("lights"))
        number = light.integer("light")
        if number >= len(lights):
            raise light.error("light", f"an index of the {len(lights)} lights", str(number))
        content.lights.append((lights[number], matrix))


def target_count(node: Item) -> int:
    """Return the number of morph targets of a node's mesh."""
    mesh = node.reference("mesh", "meshes")
    primitives = [] if mesh is None else list(node.entry("meshes", mesh).items("primitives"))
    return len(list(primitives[0].items("targets"))) if primitives else 0


def _matrix(node: Item, changed: Mapping[str, Floats]) -> Array:
    """Return the (4, 4) matrix of a node in its parent. changed: what an animation puts in place of its properties."""

    def numbers(name: str, *default: float) -> Floats:
        return changed[name] if name in changed else node.numbers(name, len(default), default)

    if "matrix" in node.value:
        matrix: Floats = node.numbers("matrix", 16).reshape(4, 4).T.copy()
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
            raise node.error("matrix", "a last row of 0 0 0 1", str(matrix[3].tolist()))
        matrix[3] = 0.0, 0.0, 0.0, 1.0
        return matrix
    matrix = np.eye(4)
    x, y, z, w = numbers("rotation", 0.0, 0.0, 0.0, 1.0).tolist()
    length = math.hypot(x, y, z, w)
    if not 0.0 < length < math.inf:
        raise node.error("rotation", "a quaternion other than 0", str([x, y, z, w]))
    x, y, z, w = x / length, y / length, z / length, w / length
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= numbers("scale", 1.0, 1.0, 1.0)
    matrix[:3, 3] = numbers("translation", 0.0, 0.0, 0.0)
    return matrix


def _unit(vector: Array) -> Array | None:
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(vector))
    return vector / length if 0.0 < length < math.inf else None


def camera_of(
    document: Item, content: Placed, sphere: tuple[Array, float], resolution: tuple[int, int] | None
) -> Camera | None:
    """Return the first camera of the scene, or None if there is none or its node has no direction.

    sphere: center and radius of the meshes; the camera looks at the point of its axis nearest the center.
    resolution: (N, M); default: 600 rows and the camera's aspect ratio, or framing.RESOLUTION. Pixels are square; an
    image with another aspect ratio shows the whole view, and more beside it or above and below.
    """
    if not content.cameras:
        return None
    index, matrix = content.cameras[0]
    item = document.entry("cameras", index)
    forward, up = _unit(-matrix[:3, 2]), _unit(matrix[:3, 1])
    if forward is None or up is None or np.linalg.norm(np.cross(forward, up)) < 1e-6:
        return None
    flat = item.text("type") == "orthographic"
    lens = item.item("orthographic" if flat else "perspective")
    if lens is None:
        raise item.error("type", "perspective or orthographic, and its parameters", repr(item.text("type")[:32]))
    if flat:
        height = 2.0 * abs(lens.number("ymag"))
        aspect = abs(lens.number("xmag")) / (height / 2.0) if height else 0.0
    else:
        fov = lens.number("yfov")
        if not 0.0 < fov < math.pi:
            raise lens.error("yfov", "radians between 0 and pi", str(fov))
        height, aspect = 2.0 * math.tan(fov / 2.0), lens.number("aspectRatio", 0.0, minimum=0.0)
    if height == 0.0:
        raise lens.error("ymag", "a number other than 0", "0")
    if resolution is None:
        columns = round(min(RESOLUTION[1] * aspect, MAX_RESOLUTION))
        resolution = (max(columns, 1), RESOLUTION[1]) if aspect else RESOLUTION
    center, radius = sphere
    height *= max(1.0, aspect * resolution[1] / resolution[0])
    eye = matrix[:3, 3]
    away = float((center - eye) @ forward)
    away = away if away > 1e-3 * radius else radius
    plane = (height, height * resolution[0] / resolution[1])
    # Unless the camera is rolled, upside down or sees it end on, its up is +y, which is up in glTF: the image is the same,
    # but an orbit around `up` is then one around the scene's axis.
    y = np.array([0.0, 1.0, 0.0])
    level = abs(np.cross(forward, up)[1]) <= _LEVEL * np.linalg.norm(np.cross(forward, y))
    upward = y if level and up[1] > 0.0 else up
    return Camera(eye, eye + forward * away, upward, 1.0, plane, resolution, orthographic=flat)


def lights_of(
    entries: list[tuple[Item, Array]], sphere: tuple[Array, float], scale: float | None = None
) -> tuple[tuple[Light, ...], float]:
    """Return the lights of the scene, and what their intensities, in candela and lux, were multiplied by.

    entries: each light and its matrix in the world. sphere: center and radius of the meshes. scale: what to multiply them
    by instead, as in another pose.

    A file says how bright lights are, not how a picture of them is exposed. So all intensities are multiplied by one
    factor, with which the strongest light has the illuminance 1 at the center (for lights nearer than the radius: at that
    distance), its cone and range aside. Ratios are the file's. Without a light that shines there are none.
    """
    center, radius = sphere
    lights = [light for item, matrix in entries if (light := _light(item, matrix)) is not None]
    if scale is None:
        strongest = 0.0
        for light in lights:
            illuminance = float(np.abs(light.intensity).max())
            if isinstance(light, PlacedLight):
                away = max(math.dist(light.position, center), radius)
                illuminance = illuminance / away / away
            strongest = max(strongest, illuminance)
        if not 0.0 < strongest < math.inf or not math.isfinite(1.0 / strongest):
            return (), 1.0
        scale = 1.0 / strongest
    with np.errstate(over="ignore"):
        intensities: list[Floats] = [np.clip(light.intensity * scale, -_MAX_FLOAT32, _MAX_FLOAT32) for light in lights]
    return tuple(replace(light, intensity=i) for light, i in zip(lights, intensities, strict=True)), scale


def _light(item: Item, matrix: Array) -> Light | None:
    """Return a light in the file's units; None for one that has no direction, or whose type is unknown."""
    kind = item.text("type")
    if kind not in ("directional", "point", "spot"):
        item.file.ignored.append("lights of an unknown type")
        return None
    color = item.numbers("color", 3, (1.0, 1.0, 1.0)) * item.number("intensity", 1.0, minimum=0.0)
    color = np.clip(color, -_MAX_FLOAT32, _MAX_FLOAT32)
    position, direction = matrix[:3, 3], -matrix[:3, 2]
    if kind != "point" and not direction.any():
        return None
    if kind == "directional":
        return DirectionalLight(direction, color)
    limit = item.number("range") if "range" in item.value else None
    if limit is not None and limit <= 0.0:
        raise item.error("range", "a number above 0", f"{limit:g}")
    if kind == "point":
        return PointLight(position, color, _ATTENUATION, limit)
    cone = item.part("spot")
    inner, outer = (
        cone.number("innerConeAngle", 0.0, minimum=0.0),
        cone.number("outerConeAngle", math.pi / 4, minimum=0.0),
    )
    if outer > _HALF_PI:
        raise cone.error("outerConeAngle", "radians from 0 to pi/2", f"{outer:g}")
    if inner > outer:
        raise cone.error("innerConeAngle", f"at most outerConeAngle, {outer:g}", f"{inner:g}")
    inner, outer = (min(math.degrees(min(angle, math.pi / 2)), 90.0) for angle in (inner, outer))
    return SpotLight(position, direction, color, inner, outer, _ATTENUATION, limit)
