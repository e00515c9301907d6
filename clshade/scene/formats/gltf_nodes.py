"""The node hierarchy of a glTF file: placements of meshes, cameras and lights in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ...base.arrays import Array, Floats
from ..camera import MAX_RESOLUTION, Camera
from ..framing import RESOLUTION
from .gltf_json import Item

MAX_NODES = 1 << 16
_LEVEL = 1e-6  # radians: less is the rounding of rotations in float32, and moves no pixel


@dataclass
class Placed:
    """The contents of the scene's nodes, in depth-first order.

    meshes: by index, with a (4, 4) matrix for each placement. cameras, lights: pairs of index or object, and matrix.
    """

    meshes: dict[int, list[Array]] = field(default_factory=dict)
    cameras: list[tuple[int, Array]] = field(default_factory=list)
    lights: list[tuple[Item, Array]] = field(default_factory=list)


def placed(document: Item, ignored: list[str]) -> Placed:
    """Return the contents of the file's scene: the one it names, else its first, else all nodes that have no parent.

    In a file without nodes each mesh is placed once. Raises InputError for more than MAX_NODES nodes, one that is
    reached twice, and broken fields.
    """
    if document.count("nodes") > MAX_NODES:
        raise document.error("nodes", f"at most {MAX_NODES}", str(document.count("nodes")))
    found, seen = Placed(), set()
    if not document.count("nodes") and document.count("meshes") <= MAX_NODES:
        found.meshes = {index: [np.eye(4)] for index in range(document.count("meshes"))}
    stack = [(index, np.eye(4)) for index in reversed(_roots(document))]
    while stack:
        index, parent = stack.pop()
        if index in seen:
            raise document.error(f"nodes[{index}]", "a tree of nodes", "a node that is reached twice")
        seen.add(index)
        node = document.entry("nodes", index)
        matrix = parent
        if node.value.keys() & {"matrix", "translation", "rotation", "scale"}:
            matrix = _product(node, parent, _matrix(node))
        _collect(node, matrix, found, ignored)
        stack += [(child, matrix) for child in reversed(node.references("children", "nodes"))]
    return found


def _product(node: Item, parent: Array, own: Array) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = parent @ own
    if not np.isfinite(matrix).all():
        raise node.error("matrix", "a finite placement in the world", "an overflow")
    return matrix


def _roots(document: Item) -> list[int]:
    scenes = document.count("scenes")
    if scenes:
        return document.entry("scenes", document.reference("scene", "scenes") or 0).references("nodes", "nodes")
    children = {child for node in document.items("nodes") for child in node.references("children", "nodes")}
    return [index for index in range(document.count("nodes")) if index not in children]


def _collect(node: Item, matrix: Array, found: Placed, ignored: list[str]) -> None:
    mesh, camera = node.reference("mesh", "meshes"), node.reference("camera", "cameras")
    if mesh is not None:
        found.meshes.setdefault(mesh, []).append(matrix)
    if camera is not None:
        found.cameras.append((camera, matrix))
    light = node.extension("KHR_lights_punctual")
    if light is not None:
        extensions = node.root.get("extensions")
        known = Item(node.root, "", node.root, node.owner).extension("KHR_lights_punctual") if extensions else None
        lights = [] if known is None else list(known.items("lights"))
        index = light.integer("light")
        if index >= len(lights):
            raise light.error("light", f"an index of the {len(lights)} lights", str(index))
        found.lights.append((lights[index], matrix))
    if "skin" in node.value:
        ignored.append("skins")


def _matrix(node: Item) -> Array:
    """Return the (4, 4) matrix of a node in its parent."""
    if "matrix" in node.value:
        matrix: Floats = node.numbers("matrix", 16).reshape(4, 4).T.copy()
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
            raise node.error("matrix", "a last row of 0 0 0 1", str(matrix[3].tolist()))
        matrix[3] = 0.0, 0.0, 0.0, 1.0
        return matrix
    matrix = np.eye(4)
    x, y, z, w = node.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0)).tolist()
    length = math.hypot(x, y, z, w)
    if not 0.0 < length < math.inf:
        raise node.error("rotation", "a quaternion other than 0", str([x, y, z, w]))
    x, y, z, w = x / length, y / length, z / length, w / length
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= node.numbers("scale", 3, (1.0, 1.0, 1.0))
    matrix[:3, 3] = node.numbers("translation", 3, (0.0, 0.0, 0.0))
    return matrix


def _unit(vector: Array) -> Array | None:
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(vector))
    return vector / length if 0.0 < length < math.inf else None


def camera_of(
    document: Item, found: Placed, sphere: tuple[Array, float], resolution: tuple[int, int] | None
) -> Camera | None:
    """Return the first camera of the scene, or None if there is none or its node has no direction.

    sphere: center and radius of the meshes; the camera looks at the point of its axis nearest the center.
    resolution: (N, M); default: 600 rows and the camera's aspect ratio, or framing.RESOLUTION. Pixels are square; an
    image with another aspect ratio shows the whole view, and more beside it or above and below.
    """
    if not found.cameras:
        return None
    index, matrix = found.cameras[0]
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
        height, aspect = 2.0 * math.tan(fov / 2.0), lens.number("aspectRatio", 0.0, least=0.0)
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
    return Camera(eye, eye + forward * away, _upward(forward, up), 1.0, plane, resolution, orthographic=flat)


def _upward(forward: Array, up: Array) -> Array:
    """Return what points up for a camera with these axes, unit each: +y, which is up in glTF, unless it is rolled or
    upside down or sees it end on. The image is the same, but what goes round `up` goes round the scene's own axis."""
    y = np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, up)
    level = abs(right[1]) <= _LEVEL * np.linalg.norm(np.cross(forward, y))
    return y if level and up[1] > 0.0 else up
