"""Cards of cells after Khronos' glTF sample models, as .glb files written by code: of one feature each, and of surfaces.

Cells are unit squares that face +z: column c, row r has its center at (c, -r, 0). Cells of tests that pass or fail are
green all over where a renderer is right, and partly red where it is wrong; `wrong` writes a file whose settings are.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mesh_writers import Gltf, png

GREEN, RED, WHITE = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 1.0)
REPEAT, CLAMP, MIRROR = 10497, 33071, 33648
NEAREST, LINEAR = 9728, 9729
HALF = 0.45  # of the side of a tile
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)
_UNIT_UVS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # v = 0 at the top
_FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)


class Card(Gltf):
    """A document of cells. columns, rows: how many."""

    def __init__(self, columns: int, rows: int) -> None:
        super().__init__()
        self.columns, self.rows = columns, rows

    def material(self, color: Sequence[float] = WHITE, *, unlit: bool = True, **fields: Any) -> int:
        """Add a material. fields: others of the material; `reflection`: of pbrMetallicRoughness, beside the color."""
        rgba = [*color, 1.0] if len(color) == 3 else list(color)
        reflection = {"baseColorFactor": rgba, **fields.pop("reflection", {})}
        extensions = {**({"KHR_materials_unlit": {}} if unlit else {}), **fields.pop("extensions", {})}
        self.use(*extensions)
        return self.add("materials", {"pbrMetallicRoughness": reflection, "extensions": extensions, **fields})

    def use(self, *extensions: str) -> None:
        used = self.json.setdefault("extensionsUsed", [])
        used += [name for name in extensions if name not in used]

    def texture(self, pixels: np.ndarray, **sampler: int) -> int:
        """Add an image and its sampler, nearest and clamped unless told otherwise."""
        sampler_fields = {"magFilter": NEAREST, "minFilter": NEAREST, "wrapS": CLAMP, "wrapT": CLAMP, **sampler}
        image = self.add("images", {"bufferView": self.view(png(pixels)), "mimeType": "image/png"})
        return self.add("textures", {"source": image, "sampler": self.add("samplers", sampler_fields)})

    def shape(self, positions: np.ndarray, faces: np.ndarray, material: int, **attributes: Any) -> int:
        """Add a mesh. Positions have their bounds, which glTF asks for."""
        low, high = positions.min(axis=0).tolist(), positions.max(axis=0).tolist()
        index = self.accessor(positions.astype(np.float32), min=low, max=high)
        return self.mesh({"POSITION": index, **attributes}, faces, material=material)

    def tile(self, material: int, half: float = HALF, **attributes: Any) -> int:
        """Add a square mesh that faces +z."""
        corners = np.concatenate([_CORNERS * half, np.zeros((4, 1))], axis=1).astype(np.float32)
        return self.shape(corners, _FACES, material, **attributes)

    def place(self, mesh: int, column: int, row: int, z: float = 0.0, **node: Any) -> None:
        """Add a node for a mesh in a cell."""
        self.add("nodes", {"mesh": mesh, "translation": [column, -row, z], **node})

    def behind(self, color: Sequence[float], columns: Sequence[int], row: int) -> None:
        """Put tiles of a color behind cells."""
        mesh = self.tile(self.material(color))
        for column in columns:
            self.place(mesh, column, row, -0.1)


def stripes(*colors: Sequence[int], down: bool = False) -> np.ndarray:
    """Return an image of one row of texels, or one column."""
    row = np.array([colors], np.uint8)
    return row.transpose(1, 0, 2) if down else row


def spanned(low: float, high: float, axis: int, constant: float = 0.5) -> np.ndarray:
    """Return texture coordinates of a tile that go from low to high along u (axis 0) or v (1)."""
    uvs = np.full((4, 2), constant, np.float32)
    uvs[:, axis] = low + (high - low) * _UNIT_UVS[:, axis]
    return uvs


def texture_settings(path: Path, wrong: bool = False) -> str:
    """After TextureSettingsTest. Rows: wrap modes along u, along v, then filters and sides."""
    card = Card(4, 3)
    card.behind(RED, range(4), 0)
    card.behind(RED, range(4), 1)
    red, green = (255, 0, 0), (0, 255, 0)
    cells = [  # texels, first and last coordinate, mode, one that shows red
        ((green, red), (1.0, 1.5), REPEAT, CLAMP),
        ((green, red), (-1.0, -0.5), REPEAT, MIRROR),
        ((green, red), (1.5, 2.5), MIRROR, REPEAT),
        ((red, green), (1.0, 2.0), CLAMP, REPEAT),
    ]
    for row, name in enumerate(("wrapS", "wrapT")):
        counterpart = "wrapT" if row == 0 else "wrapS"
        for column, (texels, (low, high), right, false) in enumerate(cells):
            mode, elsewhere = (false, right) if wrong else (right, false)
            texture = card.texture(stripes(*texels, down=row == 1), **{name: mode, counterpart: elsewhere})
            material = card.material(reflection={"baseColorTexture": {"index": texture}})
            card.place(card.tile(material, TEXCOORD_0=spanned(low, high, row)), column, row)
    _filters(card, wrong)
    _sides(card, wrong)
    return card.glb(path)


def _filters(card: Card, wrong: bool) -> None:
    """Nearest texels show no red beside their edge. A linear alpha from 0.1 on passes a cutoff of 0.05 all over, where the
    nearest is 0 on the left half."""
    card.behind(RED, [0, 1], 2)
    texture = card.texture(stripes((0, 255, 0), (255, 0, 0)), magFilter=LINEAR if wrong else NEAREST)
    nearest = card.material(reflection={"baseColorTexture": {"index": texture}})
    card.place(card.tile(nearest, TEXCOORD_0=spanned(0.1, 0.499, 0)), 0, 2)
    texture = card.texture(stripes((0, 255, 0, 0), (0, 255, 0, 255)), magFilter=NEAREST if wrong else LINEAR)
    linear = card.material(reflection={"baseColorTexture": {"index": texture}}, alphaMode="MASK", alphaCutoff=0.05)
    card.place(card.tile(linear, TEXCOORD_0=spanned(0.3, 0.7, 0)), 1, 2)


def _sides(card: Card, wrong: bool) -> None:
    """A tile turned away shows where it is double-sided, and only there."""
    card.behind(RED, [2], 2)
    card.behind(GREEN, [3], 2)
    away = [0.0, 1.0, 0.0, 0.0]
    card.place(card.tile(card.material(GREEN, doubleSided=not wrong)), 2, 2, rotation=away)
    card.place(card.tile(card.material(RED, doubleSided=wrong)), 3, 2, rotation=away)


JUST_BELOW_HALF = float(np.nextafter(np.float32(0.5), np.float32(0.0)))
CODE = 128 / 255


def _masks(wrong: bool) -> list[tuple[bool, dict[str, Any], dict[str, Any]]]:
    """Return whether each tile shows, its material's fields, and where its alpha comes from: factor, texture, vertices."""
    cutoff = {"alphaMode": "MASK", "alphaCutoff": CODE}
    cells: list[tuple[bool, dict[str, Any], dict[str, Any]]] = [
        (True, {"alphaMode": "OPAQUE"}, {"factor": 0.0}),
        (True, {"alphaMode": "MASK"}, {"factor": 0.5}),
        (False, {"alphaMode": "MASK"}, {"factor": JUST_BELOW_HALF}),
        (True, {"alphaMode": "MASK", "alphaCutoff": 0.0}, {"factor": 0.0}),
        (False, {"alphaMode": "MASK", "alphaCutoff": 1.01}, {"factor": 1.0}),
        (True, {"alphaMode": "BLEND"}, {"factor": 1.0}),
        (True, cutoff, {"texture": 128}),
        (False, cutoff, {"texture": 127}),
        (True, cutoff, {"vertices": 128}),
        (False, cutoff, {"vertices": 127}),
        (True, {"alphaMode": "MASK", "alphaCutoff": 0.25}, {"factor": 0.5, "texture": 255, "vertices": 128}),
        (False, {"alphaMode": "BLEND"}, {"factor": 0.0}),
    ]
    return [(shows != wrong, fields, alpha) for shows, fields, alpha in cells]


def alpha_modes(path: Path, wrong: bool = False) -> str:
    """After AlphaBlendModeTest: cutoffs at exactly the value of alpha and one step above it. A last row blends green over
    red by a quarter, a half and three quarters."""
    card = Card(6, 3)
    for number, (shows, fields, alpha) in enumerate(_masks(wrong)):
        row, column = divmod(number, 6)
        card.behind(RED if shows else GREEN, [column], row)
        color = [*(GREEN if shows else RED), alpha.get("factor", 1.0)]
        reflection, attributes = {}, {}
        if "texture" in alpha:
            texture = card.texture(np.full((1, 1, 4), [255, 255, 255, alpha["texture"]], np.uint8))
            reflection = {"baseColorTexture": {"index": texture}}
            attributes["TEXCOORD_0"] = _UNIT_UVS
        if "vertices" in alpha:
            rgba = np.full((4, 4), [255, 255, 255, alpha["vertices"]], np.uint8)
            attributes["COLOR_0"] = card.accessor(rgba, normalized=True)
        card.place(card.tile(card.material(color, reflection=reflection, **fields), **attributes), column, row)
    card.behind(RED, range(3), 2)
    for column, share in enumerate((0.25, 0.5, 0.75)):
        card.place(card.tile(card.material([*GREEN, share], alphaMode="BLEND")), column, 2)
    return card.glb(path)


VERTEX_COLOR = (51 / 255, 128 / 255, 204 / 255)


def vertex_colors(path: Path) -> str:
    """After VertexColorTest: linear colors of each type at the vertices, above the same color as a factor; last, both and a
    texture."""
    card = Card(4, 2)
    bytes_ = np.full((4, 4), [51, 128, 204, 0], np.uint8)
    cells: list[tuple[np.ndarray, Sequence[float]]] = [
        (np.full((4, 3), VERTEX_COLOR, np.float32), WHITE),
        (bytes_, WHITE),
        (bytes_.astype(np.uint16) * np.uint16(257), WHITE),
        (bytes_, (0.5, 0.25, 1.0)),
    ]
    plain = card.texture(np.full((1, 1, 3), 188, np.uint8))  # sRGB
    for column, (colors, factor) in enumerate(cells):
        index = card.accessor(colors, **({} if colors.dtype == np.float32 else {"normalized": True}))
        textured = {"reflection": {"baseColorTexture": {"index": plain}}} if column == 3 else {}
        attributes = {"COLOR_0": index, "TEXCOORD_0": _UNIT_UVS}
        card.place(card.tile(card.material(factor, **textured), **attributes), column, 0)
        product = [a * b for a, b in zip(VERTEX_COLOR, factor, strict=True)]
        card.place(card.tile(card.material(product, **textured), TEXCOORD_0=_UNIT_UVS), column, 1)
    return card.glb(path)


OCCLUSION = 102 / 255


def multi_uv(path: Path, wrong: bool = False) -> str:
    """After MultiUVTest: base color, emission, and occlusion of 1, 0.4 and 0 from the second set of coordinates; the first
    set leads elsewhere in the image."""
    card = Card(5, 1)
    card.behind(RED, range(2), 0)
    second = {"texCoord": 0 if wrong else 1}
    sets = {"TEXCOORD_0": spanned(0.75, 0.75, 0), "TEXCOORD_1": spanned(0.25, 0.25, 0)}
    texture = card.texture(stripes((0, 255, 0), (255, 0, 0)))
    base = card.material(reflection={"baseColorTexture": {"index": texture, **second}})
    emission = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": texture, **second}}
    for column, material in enumerate((base, card.material((0, 0, 0), unlit=False, **emission, **_matt()))):
        card.place(card.tile(material, **sets), column, 0)
    for column, codes in enumerate(((255, 0), (102, 255), (0, 255)), start=2):
        texture = card.texture(stripes(*((code, 0, 0) for code in codes)))
        material = card.material(unlit=False, occlusionTexture={"index": texture, **second}, **_matt())
        card.place(card.tile(material, **sets), column, 0)
    return card.glb(path)


def _matt() -> dict[str, Any]:
    return {
        "reflection": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
        "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}},
    }


STRENGTHS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
EMISSION = (0.125, 0.0625, 0.03125)


def emissive_strength(path: Path) -> str:
    """After EmissiveStrengthTest: one color, each cell twice as strong as the one before."""
    card = Card(len(STRENGTHS), 1)
    for column, strength in enumerate(STRENGTHS):
        fields = _matt()
        fields["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
        material = card.material((0, 0, 0), unlit=False, emissiveFactor=list(EMISSION), **fields)
        card.place(card.tile(material), column, 0)
    return card.glb(path)


# Curved and mapped surfaces


ROUGHNESS = tuple(51 * k / 255 for k in range(1, 6))
METAL = (0.9, 0.6, 0.3)
_RADIUS = 0.45


def metal_rough_spheres(path: Path) -> str:
    """After MetalRoughSpheres: rougher to the right; metals, dielectrics, and metals whose numbers come from textures. The
    poles face +z."""
    card = Card(len(ROUGHNESS), 3)
    across, up = 33, 17
    phi, theta = (a.ravel() for a in np.meshgrid(np.linspace(0, 2 * np.pi, across), np.linspace(0, np.pi, up)))
    normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    first = (np.arange(up - 1)[:, None] * across + np.arange(across - 1)).ravel()
    triangles = [(first, first + across, first + 1), (first + 1, first + across, first + across + 1)]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in triangles]).astype(np.uint16).ravel()
    normal = card.accessor(normals.astype(np.float32))
    uvs = card.accessor(np.full((len(normals), 2), 0.5, np.float32))
    for row, column in np.ndindex(3, len(ROUGHNESS)):
        reflection: dict[str, Any] = {"metallicFactor": float(row != 1), "roughnessFactor": ROUGHNESS[column]}
        if row == 2:
            texel = np.array([[[0, 51 * (column + 1), 255]]], np.uint8)
            reflection = {"metallicRoughnessTexture": {"index": card.texture(texel)}}
        material = card.material(METAL, unlit=False, reflection=reflection)
        card.place(card.shape(_RADIUS * normals, faces, material, NORMAL=normal, TEXCOORD_0=uvs), column, row)
    return card.glb(path)


GRID = 32  # texels of a cell, and vertices of a dome, which lie at their centers
_SLOPE, _RIM = 2.5, 0.38  # of the dome: what its slope grows by, and where it ends
_CENTERS = (np.arange(GRID) + 0.5) / GRID - 0.5


def _dome(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return height and normals of a dome over a unit square."""
    inside = x * x + y * y < _RIM * _RIM
    height = np.where(inside, 0.5 * _SLOPE * (_RIM * _RIM - x * x - y * y), 0.0)
    normals = np.stack([_SLOPE * x * inside, _SLOPE * y * inside, np.ones_like(x)], axis=-1)
    return height, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _dome_mesh(card: Card, material: int) -> int:
    x, y = (a.ravel() for a in np.meshgrid(_CENTERS, _CENTERS))
    height, normals = _dome(x, y)
    first = (np.arange(GRID - 1)[:, None] * GRID + np.arange(GRID - 1)).ravel()
    triangles = [(first, first + 1, first + GRID + 1), (first, first + GRID + 1, first + GRID)]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in triangles]).astype(np.uint16).ravel()
    return card.shape(np.stack([x, y, height], axis=1), faces, material, NORMAL=normals.astype(np.float32))


def _mapped(card: Card, material: int, axes: np.ndarray, tangents: bool, half: int = 0) -> int:
    """Add a square whose texture coordinates are axes (2, 2) @ (x, y) + 0.5. half: 1 or -1 for that side of x alone."""
    low, high = (0.0, 0.5) if half == 1 else (-0.5, 0.0) if half == -1 else (-0.5, 0.5)
    corners = np.array([[low, -0.5], [high, -0.5], [high, 0.5], [low, 0.5]])
    attributes: dict[str, Any] = {
        "NORMAL": np.tile(np.float32([0, 0, 1]), (4, 1)),
        "TEXCOORD_0": (corners @ axes.T + 0.5).astype(np.float32),
    }
    if tangents:
        back = np.linalg.inv(axes)  # columns: where u and v grow
        side = 1.0 if np.cross([*back[:, 0], 0], [*-back[:, 1], 0])[2] > 0.0 else -1.0
        attributes["TANGENT"] = np.tile(np.float32([*back[:, 0], 0.0, side]), (4, 1))
    positions = np.concatenate([corners, np.zeros((4, 1))], axis=1)
    return card.shape(positions, _FACES, material, **attributes)


def _turned(quarters: int, mirrored: bool = False) -> np.ndarray:
    """Return texture coordinates' axes, turned by so many quarters and mirrored along u."""
    angle = quarters * math.pi / 2
    turn = np.round([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.diag([-1.0 if mirrored else 1.0, 1.0]) @ np.diag([1.0, -1.0]) @ turn


def normal_tangent(path: Path, tangents: bool = False) -> str:
    """After NormalTangentTest, and with `tangents` NormalTangentMirrorTest: a dome of geometry at the top, below it squares
    with its normal map: coordinates turned by quarters, mirrored and turned, and halves that mirror each other."""
    card = Card(4, 4)
    # The dome's normal map: u to the right, v down, green up. It serves any rotation and mirroring of its coordinates, for
    # the dome looks the same from all sides.
    codes = np.round((_dome(*np.meshgrid(_CENTERS, -_CENTERS))[1] * 0.5 + 0.5) * 255.0).astype(np.uint8)
    normals = {"index": card.texture(codes, magFilter=LINEAR, minFilter=LINEAR)}
    look: dict[str, Any] = {"unlit": False, "reflection": {"metallicFactor": 0.0, "roughnessFactor": 0.5}}
    dome, mapped = _dome_mesh(card, card.material(METAL, **look)), card.material(METAL, **look, normalTexture=normals)
    for column in range(4):
        card.place(dome, column, 0)
        for row, mirrored in ((1, False), (2, True)):
            card.place(_mapped(card, mapped, _turned(column, mirrored), tangents), column, row)
        halves = [_turned(2 * (column % 2), mirrored) for mirrored in (column >= 2, column < 2)]
        for half, axes in zip((1, -1), halves, strict=True):
            card.place(_mapped(card, mapped, axes, tangents, half), column, 3)
    return card.glb(path)
