"""Scenes made of exact numbers: the same on every machine, whatever instructions NumPy uses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...scene.camera import Camera
from ...scene.lights import DirectionalLight, Light, PointLight, RectangleLight, SpotLight
from ...scene.material import MetallicRoughness
from ...scene.model import Material, Mesh, Scene, Settings, Texture
from ...scene.settings import Edges, Scalars
from ...scene.texture import Filter

RESOLUTION = (61, 47)
Choice = dict[str, Any]  # a level for each of the 31 choices, as golden.json holds them
# All that the pixel program is compiled for: with all optional features in it, these are the only ones.
PROGRAMS: dict[str, dict[str, Any]] = {
    "phong": {"shader": "phong", "precision": "float32", "samples": 1, "visibility": "depth"},
    "painter": {"shader": "phong", "precision": "float32", "samples": 5, "visibility": "painter"},
    "float64": {"shader": "phong", "precision": "float64", "samples": 3, "visibility": "depth"},
    "gouraud": {"shader": "gouraud", "precision": "float32", "samples": 1, "visibility": "painter"},
    "gouraud-samples": {"shader": "gouraud", "precision": "float64", "samples": 2, "visibility": "depth"},
    "nolight": {"shader": "nolight", "precision": "float32", "samples": 1, "visibility": "depth"},
    "pbr": {"shader": "pbr", "precision": "float32", "samples": 4, "visibility": "depth"},
}


class Draws:
    """Random numbers from PCG64's raw words, which no release of NumPy may change, by exact arithmetic alone."""

    def __init__(self, seed: int) -> None:
        self._words = np.random.PCG64(seed)

    def below(self, end: int, *shape: int) -> Array:
        """Return int64 from 0 to end - 1."""
        words = np.asarray(self._words.random_raw(int(np.prod(shape, dtype=int))), np.uint64)
        numbers: Array = ((words >> np.uint64(32)) * np.uint64(end) >> np.uint64(32)).astype(np.int64).reshape(shape)
        return numbers

    def parts(self, low: float, high: float, *shape: int, of: int = 4096) -> Array:
        """Return float64 from low to high, exact multiples of 1/of."""
        first, last = round(low * of), round(high * of)
        return (self.below(last - first + 1, *shape) + first) / float(of)


@dataclass(frozen=True)
class GoldenScene:
    """A scene, how it is drawn, and the choices that it is made of."""

    name: str
    choice: Choice
    scene: Scene
    settings: Settings

    @property
    def needs_float64(self) -> bool:
        return self.settings.precision == "float64" or self.settings.edges is not None

    def without_float64(self) -> GoldenScene:
        """Return the scene drawn in float32 and without edges, as a device without float64 can."""
        settings = replace(self.settings, precision="float32", edges=None)
        return replace(self, choice={**self.choice, "edges": None, "precision": "float32"}, settings=settings)


def golden_scene(number: int, row: Choice) -> GoldenScene:
    """Return a scene, which its number and its choices determine."""
    draws, name = Draws(1000 + number), f"{number:03d}-{row['program']}"
    material = _material(row, draws)
    plain = Material(ka=0.25, kd=(0.5, 0.75, 0.25), ks=0.5, n=8.0)
    meshes = [_mesh(row, draws, material, 24, own=True), _mesh(row, draws, plain, 16)]
    background = {"none": None, "black": (0.0, 0.0, 0.0), "color": (0.25, 0.5, 0.125)}[row["background"]]
    if row["edges"] == "only":
        background = (0.25, 0.5, 0.125)
    scene = Scene(tuple(meshes), _camera(row), _lights(row), (0.5, 0.25, 0.75), background, row["preset"], name)
    return GoldenScene(name, row, scene, _settings(row))


def _settings(row: Choice) -> Settings:
    edges = Edges("all" if row["edges"] == "only" else "feature", width=2.5, only=row["edges"] == "only")
    names = Settings.__dataclass_fields__.keys() - {"background"}  # which is the scene's
    fields: dict[str, Any] = {name: level for name, level in row.items() if name in names}
    fields["near"] = None if row["near"] == "far off" else 3.0
    fields["scalars"] = Scalars("data", ((0.0, 0.25, 0.5), (1.0, 0.5, 0.0)), (-1.0, 1.0)) if row["scalars"] else None
    fields["edges"] = edges if row["edges"] else None
    return Settings(**PROGRAMS[row["program"]], **fields, layers="all")


def _camera(row: Choice) -> Camera:
    plane = (3.0, 4.0) if row["orthographic"] else (0.75, 1.0)
    principal = (0.5, 0.5) if row["principal"] == "center" else (0.375, 0.6875)
    eye = (0.5, 0.25, 4.0)
    return Camera(eye, (0.125, 0.0, 0.0), (0.0, 1.0, 0.0), 1.25, plane, RESOLUTION, principal, row["orthographic"])


def _lights(row: Choice) -> tuple[Light, ...]:
    point = PointLight((2.0, 3.0, 4.0), (0.75, 0.5, 0.625))
    distant = DirectionalLight((-0.5, -1.0, -0.75), (0.5, 0.5, 0.25))
    spot = SpotLight((1.0, 2.0, 3.0), (-0.25, -0.5, -1.0), (6.0, 5.0, 4.0), 0.0, 60.0, "inverse-square")
    areas = (
        PointLight((-2.0, 2.0, 3.0), (0.5, 0.75, 0.5), radius=0.5),
        RectangleLight((2.0, 2.0, 3.0), (1.0, 0.0, 0.0), (0.0, 0.75, -0.5), (4.0, 4.0, 4.0)),
    )
    lights: dict[str, tuple[Light, ...]] = {"point": (point,), "distant": (distant,), "spot": (spot,), "areas": areas}
    lights |= {"many": (point, distant, spot, PointLight((0.0, -3.0, 2.0), (0.25, 0.0, 0.5))), "none": ()}
    return lights[row["lights"]]


def _image(draws: Draws, channels: int, height: int = 5, width: int = 7) -> Array:
    return draws.parts(0.0, 1.0, height, width, channels, of=256).astype(np.float32)


def _material(row: Choice, draws: Draws) -> Material:
    kind = row["texture"]
    texture = None
    if kind != "none":
        image = _image(draws, 4 if kind == "alpha" else 3)
        nearest: Filter = "nearest" if kind == "nearest" else "linear"
        texture = Texture(image, row["wrap"], "course" if kind == "course" else "standard", filter=nearest)
    some: dict[str, Any] = {"normal_texture": Texture(_image(draws, 3), row["wrap"]), "emission": (0.125, 0.25, 0.0)}
    fields: dict[str, Any] = {
        "occlusion_texture": Texture(_image(draws, 3, 3, 4)),
        "emission_texture": Texture(_image(draws, 3, 4, 3)),
        "metallic_roughness_texture": Texture(_image(draws, 3, 2, 3), filter="nearest"),
    }
    maps = {"none": {}, "some": some, "all": {**some, **fields}}[row["maps"]]
    return Material(
        ka=(0.25, 0.5, 0.125),
        kd=0.625,
        ks=(0.5, 0.25, 0.5),
        n=32.0,
        texture=texture,
        color=(0.75, 1.0, 0.5),
        sides="front" if row["sides"] == "front" else "both",
        two_sided=row["sides"] == "two_sided",
        alpha_cutoff=0.5 if row["alpha"] == "cutoff" else None,
        blend=row["alpha"] == "blend",
        opacity=0.625 if row["alpha"] == "blend" else 1.0,
        pbr=MetallicRoughness(0.5, 0.375, **maps),
    )


def _mesh(row: Choice, draws: Draws, material: Material, count: int, own: bool = False) -> Mesh:
    """Return random triangles in a cube. own: with all that the choices give the first mesh."""
    corners = count // 2 + 4
    verts = draws.parts(-1.5, 1.5, corners, 3) + (2.0**-40 if row["positions"] == "float64" else 0.0)
    faces = np.stack([draws.below(corners, count) + k for k in (0, 5, 9)], axis=1) % corners
    fields: dict[str, Any] = {}
    if row["scalars"]:
        fields["scalars"] = {"data": draws.parts(-1.5, 1.5, corners)}
    if not own:
        return Mesh(verts, faces, material=material, **fields)
    if row["uvs"] != "none":
        fields["uvs"] = draws.parts(-1.0, 2.0, corners, 2)
        if row["uvs"] == "faces":
            fields["uv_faces"] = draws.below(corners, count, 3)
    if row["normals"] != "none":
        fields["normals"] = draws.parts(0.25, 1.0, corners, 3)
        if row["normals"] == "faces":
            fields["normal_faces"] = draws.below(corners, count, 3)
    if row["colors"] != "white":
        fields["colors"] = draws.parts(0.125, 1.0, corners, 3) * (4.0 if row["colors"] == "bright" else 1.0)
    if row["alpha"] == "blend":
        fields["alphas"] = draws.parts(0.125, 1.0, corners)
    if row["instances"] > 1:
        places = np.tile(np.eye(4), (row["instances"], 1, 1))
        places[1:, :3, 3] = draws.parts(-1.0, 1.0, row["instances"] - 1, 3, of=64)
        places[1, 0, 0] = -0.5
        fields["instances"] = places
    return Mesh(verts, faces, material=material, **fields)
