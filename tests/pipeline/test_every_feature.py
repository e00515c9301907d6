"""Every feature of a frame, as one table of scenes. Of each row: its frame equals the oracle's; an error in it is noticed;
another number of lanes, all features forced on, earlier views, parts and a single copy of its instances change no bit.

What only one feature has, such as closed forms, is in a file of its own.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from devices import needs_float64, rendered, skip_unsupported
from layer_scenes import mixed
from mapped_scenes import mapped, mapped_scene, noise, normal_image, sheet
from scene_fuzzer import different_bits

from clshade.images import png
from clshade.measure.stability.cases.lit import blob
from clshade.measure.stability.cases.lit import scene_of as lit_scene
from clshade.pipeline import features, triangle_source
from clshade.pipeline.effective_settings import effective_settings
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera, part_of
from clshade.scene.environment import Environment
from clshade.scene.lights import DirectionalLight, Light, PointLight, RectangleLight, SpotLight
from clshade.scene.material import MAPS, MetallicRoughness
from clshade.scene.model import Material, Mesh, Scalars, Scene, Texture
from clshade.scene.settings import Edges

CAMERA = Camera((0.5, 1.1, 3.8), (0.0, -0.2, 0.0), (0.0, 1.0, 0.0), 1.2, (1.1, 1.43), (61, 47))
PLAIN = Material(ka=0.1, kd=0.6, ks=0.4, n=20.0)
Change = Callable[[Scene], Scene]


def texture(channels: int = 3, **fields: Any) -> Texture:
    return Texture(np.random.default_rng(5).random((13, 9, channels)), **fields)


def stage(material: Material = PLAIN, cells: int = 5, mesh: dict[str, Any] | None = None, **fields: Any) -> Scene:
    """Return triangles of all sizes and a bent sheet of a material over a ground. mesh: fields of the sheet."""
    corners = np.array([[-4.0, -1.2, -4.0], [-4.0, -1.2, 4.0], [4.0, -1.2, 4.0], [4.0, -1.2, -4.0]])
    ground = Mesh(corners, [[0, 1, 2], [0, 2, 3]], colors=np.full((4, 3), 0.8), material=PLAIN)
    crystals = replace(blob(30, material=PLAIN), verts=0.5 * blob(30).verts - [0.4, 0.0, 0.4])
    bent = sheet(cells, material=material, **(mesh or {}))
    return mapped_scene(ground, crystals, bent, **{"camera": CAMERA, **fields})


def surfaced(**fields: Any) -> Change:
    """Return what changes fields of the sheet's material."""

    def change(scene: Scene) -> Scene:
        *objects, bent = scene.meshes
        return replace(scene, meshes=(*objects, replace(bent, material=replace(bent.material, **fields))))

    return change


def relit(**fields: Any) -> Change:
    return lambda scene: replace(scene, lights=(replace(scene.lights[0], **fields), *scene.lights[1:]))


def changed(**fields: Any) -> Change:
    return lambda scene: replace(scene, **fields)


def lit_by(*lights: Light, **fields: Any) -> Scene:
    return stage(lights=(*lights, PointLight((2.0, 3.0, 3.0), 0.3 * np.ones(3))), **fields)


SUN = DirectionalLight((-1.0, -2.0, -1.5), (1.0, 0.9, 0.7))
RANGED = PointLight((0.3, 1.2, 1.5), (2.0, 1.5, 1.0), "inverse-square", 4.0)
SPOT = SpotLight((1.0, 3.0, 2.0), (-0.3, -1.0, -0.6), (5.0, 5.0, 5.0), 10.0, 35.0, "inverse-square")
SPHERE = PointLight((0.6, 1.6, 1.4), (1.0, 0.9, 0.7), radius=0.5)
PANEL = RectangleLight((0.3, 1.8, 1.5), (0.5, 0.1, 0.0), (0.1, 0.2, 0.4), (1.5, 1.4, 1.2), "inverse-square", 5.0)
SIZED, SHADOWS = {"light_samples": 3}, {"shadows": True}


def placed(*scale: float) -> np.ndarray:
    matrix = np.diag([*scale, 1.0])
    matrix[:3, 3] = 0.5, 0.4, 0.3
    return matrix


def cut_out(**fields: Any) -> Scene:
    """Return a stage with holes in its sheet, seen from both sides, which are lit."""
    holed = texture(4, wrap=("mirror", "repeat"))
    material = replace(PLAIN, texture=holed, color=(0.5, 1.0, 2.0), alpha_cutoff=0.45, two_sided=True)
    return stage(material, mesh={"instances": [np.eye(4), placed(-1.0, 1.0, -1.0)]}, **fields)


def glass(**fields: Any) -> Scene:
    """Return a stage whose sheet is transparent by material, vertices and texture, twice before itself."""
    alphas = np.random.default_rng(2).uniform(0.3, 1.0, 36)
    placements = np.tile(np.eye(4), (3, 1, 1))
    placements[1:, :3, 3] = (0.2, 0.3, 0.5), (-0.3, 0.1, 0.9)
    clear = replace(PLAIN, texture=texture(4), blend=True, opacity=0.8, two_sided=True)
    return stage(clear, mesh={"alphas": alphas, "instances": placements}, **fields)


def mirrored(**fields: Any) -> Scene:
    """Return a stage of whose sheet, and of its mirror images, only the front is drawn."""
    placements = [np.eye(4), placed(-1.0, 1.0, 1.0), placed(1.0, 1.0, -1.0) @ placed(0.7, 0.7, 0.7)]
    return stage(replace(PLAIN, sides="front"), mesh={"instances": placements}, **fields)


def far_uvs(**fields: Any) -> Scene:
    """Return a stage whose sheet has texture coordinates of 2^19, where a texel is 2^-22 of them."""
    uvs = np.random.default_rng(2).uniform(-(2.0**19), 2.0**19, (9, 2))
    return stage(replace(PLAIN, texture=texture(wrap=("repeat", "mirror"))), mesh={"uvs": uvs}, cells=2, **fields)


def measured(at: str = "vertices", **fields: Any) -> Scene:
    """Return a stage with scalars of the sheet's vertices, faces or corners, some of them NaN."""
    mesh = sheet(5)
    heights = mesh.verts[:, 2].copy()
    heights[7] = np.nan
    data = {"vertices": heights, "faces": heights[mesh.faces[:, 0]], "corners": heights[mesh.faces] + mesh.faces % 3}
    return stage(mesh={"scalars": {"data": data[at]}}, **fields)


def facets(**fields: Any) -> Material:
    return Material(color=(0.9, 0.6, 0.3), pbr=MetallicRoughness(**{"metallic": 0.6, "roughness": 0.3, **fields}))


def all_maps(**fields: Any) -> Scene:
    return stage(Material(ka=0.3, texture=texture(), pbr=mapped(**fields)))


def mixed_maps() -> Scene:
    """Return sheets with all maps, some of them or none, mirrored, stretched and turned round, without texture coordinates
    that they need, and behind the eye."""
    plain: dict[str, Any] = {"normal_texture": None, "occlusion_texture": None, "emission_texture": None}
    mirror, stretched = np.diag([-0.4, 0.4, 0.4, 1.0]), np.diag([0.8, 0.2, 0.6, 1.0])
    mirror[:3, 3], stretched[:3, 3] = (0.2, 0.3, 1.0), (-0.5, -0.7, 0.8)
    behind = np.diag([0.3, -0.3, -0.3, 1.0])
    behind[:3, 3] = -0.7, 0.7, 1.0
    second = Texture(normal_image(5, 5, 8), coordinates=1, wrap="mirror")

    def with_maps(shift: tuple[float, float, float], **changes: Any) -> Mesh:
        return sheet(shift=shift, material=Material(ka=0.3, pbr=mapped(**{**plain, **changes})))

    return mapped_scene(
        sheet(instances=[np.eye(4), mirror, stretched]),
        with_maps((0.7, -0.5, 0.4), normal_texture=second),
        sheet(material=Material(texture=texture(), pbr=mapped(), sides="both", two_sided=True), instances=[behind]),
        with_maps((-0.4, 0.5, 0.6), occlusion_texture=mapped().occlusion_texture),
        sheet(shift=(-0.9, -0.6, 0.5), more_uvs=(), material=Material(pbr=mapped(normal_texture=second))),
        sheet(shift=(0.9, 0.8, 0.5), uvs=None, more_uvs=()),
        sheet(2, shift=(0.2, -0.4, 3.9), material=Material(texture=texture(), pbr=mapped(normal_texture=second))),
    )


AROUND = Environment(np.random.default_rng(3).random((7, 12, 3)) ** 2, rotation=25, intensity=1.5, up=(0.1, 1, 0.3))


def surrounded(**fields: Any) -> Scene:
    return stage(facets(), environment=AROUND, **fields)


def glaring() -> Scene:
    """Return a stage whose sheet has corners of 1e6 beside others of 1."""
    colors = 10.0 ** np.random.default_rng(1).uniform(-3, 6, (9, 3)) * [1.0, -1.0, 1.0]
    return stage(mesh={"colors": colors}, cells=2)


def moved_crystals(scene: Scene) -> Scene:
    ground, crystals, *sheets = scene.meshes
    return replace(scene, meshes=(ground, replace(crystals, verts=crystals.verts + [0.0, 0.03, 0.0]), *sheets))


PARALLEL = replace(CAMERA, orthographic=True, plane=(2.6, 3.2), principal=(0.4, 0.55))
ALL_LAYERS = {"layers": "all"}
TRILINEAR, PERSPECTIVE = {"texture_filter": "trilinear"}, {"interpolation": "perspective"}
BACKDROP, WEIGHTED = {"background": "environment"}, {"resolve": "weighted"}
NARROW_RANGE = {"scalars": Scalars("data", "viridis", (0.0, 0.31))}
LINES = {"edges": Edges(("feature", "silhouette"), width=2.6, color=(1, 0.5, 0))}
OCCLUDED = {"ambient_occlusion": 4, "resolution": (35, 27), "layers": ("Z", "id", "P", "AO")}


class Row:
    """scene, options: what is drawn. wrong: changes of the scene, or settings, for each of which it is beyond the bounds."""

    def __init__(self, scene: Callable[[], Scene], options: dict[str, Any], *wrong: Change | dict[str, Any]) -> None:
        self.scene, self.options, self.wrong = scene, options, wrong


# Of few programs: those of shaders phong and pbr with and without rays to casters, and of several samples.
EVERY_DAY = {
    "points": Row(stage, {}, relit(position=(3.001, 4.0, 5.0)), moved_crystals),
    "a sun": Row(lambda: lit_by(SUN), {}, relit(direction=(-1.01, -2.0, -1.5))),
    "a ranged light": Row(lambda: lit_by(RANGED), {}, relit(range=4.04), relit(intensity=(2.002, 1.5, 1.0))),
    "a spot": Row(lambda: lit_by(SPOT), {}, relit(outer_cone=36.0), relit(inner_cone=11.0)),
    "a sphere": Row(lambda: lit_by(SPHERE), SIZED, relit(radius=0.505), {"light_samples": 4}),
    "a rectangle": Row(lambda: lit_by(PANEL), {"light_samples": 16}, relit(right=(0.505, 0.1, 0.0))),
    "trilinear": Row(lambda: stage(replace(PLAIN, texture=texture())), TRILINEAR, {"texture_filter": "bilinear"}),
    "nearest": Row(
        lambda: stage(replace(PLAIN, texture=texture(filter="nearest", wrap="mirror"))),
        {},
        surfaced(texture=texture(wrap="mirror")),
    ),
    "the course's lookup": Row(
        lambda: stage(replace(PLAIN, texture=texture(lookup="course"))), TRILINEAR, surfaced(texture=texture())
    ),
    "far coordinates": Row(far_uvs, {"layers": ("Z", "id", "uv", "albedo")}, surfaced(texture=texture())),
    "holes": Row(cut_out, {}, surfaced(alpha_cutoff=0.46)),
    "front sides": Row(mirrored, {}, surfaced(sides="both")),
    "two sides": Row(cut_out, {"near": 3.0}, surfaced(two_sided=False)),
    "indices of their own": Row(mixed, {**ALL_LAYERS, **TRILINEAR}, changed(meshes=mixed().meshes[:-1])),
    "glass": Row(glass, {}, surfaced(opacity=0.801)),
    "glass over nothing": Row(
        lambda: glass(background=None, camera=PARALLEL), {"layers": "all", "layer_alpha": 0.5}, {"layer_alpha": 0.0}
    ),
    "lines": Row(stage, LINES, {"edges": replace(LINES["edges"], width=2.8)}),
    "lines alone": Row(glass, {"edges": Edges("all", only=True)}, {"edges": Edges("all")}),
    "lined scalars": Row(measured, {"edges": "all", "scalars": "data", "layers": ("Z", "id", "scalar")}, NARROW_RANGE),
    "scalars": Row(measured, {"scalars": "data", "layers": "all"}, NARROW_RANGE),
    "scalars of corners": Row(lambda: measured("corners"), {"scalars": Scalars("data", "tab10", (-0.1, 0.2))}),
    "parallel": Row(lambda: cut_out(camera=PARALLEL), {}, changed(camera=replace(PARALLEL, principal=(0.401, 0.55)))),
    "nothing behind": Row(lambda: stage(background=None), {}, changed(background=(1e-3, 0.0, 0.0))),
    "an environment behind": Row(
        lambda: glass(environment=AROUND), BACKDROP, changed(environment=replace(AROUND, rotation=26))
    ),
    "affine": Row(cut_out, {"preset": "course", "shader": "phong", "visibility": "depth"}, PERSPECTIVE),
    "near": Row(mirrored, {"near": 3.3, "layers": "all"}, {"near": 3.4}),
    "glaring": Row(glaring, {}, relit(intensity=(1.001, 0.9, 0.7))),
    "shadows": Row(stage, SHADOWS, moved_crystals, relit(position=(3.02, 4.0, 5.0))),
    "shadows of a sun": Row(lambda: stage(lights=SUN), SHADOWS, relit(direction=(-1.02, -2.0, -1.5))),
    "shadows of a spot": Row(lambda: lit_by(SPOT, RANGED), SHADOWS, {"shadows": False}),
    "shadows of a sphere": Row(lambda: lit_by(SPHERE), {**SHADOWS, **SIZED}, relit(radius=0.52)),
    "shadows of a rectangle": Row(lambda: lit_by(PANEL), {**SHADOWS, **SIZED}, {"light_samples": 4}),
    "shadows of glass": Row(glass, SHADOWS, surfaced(opacity=0.801)),
    "shadows of holes": Row(lambda: cut_out(lights=SPHERE), {**SHADOWS, **SIZED}, surfaced(alpha_cutoff=0.5)),
    "ambient occlusion": Row(stage, {**OCCLUDED, "ao_distance": 0.8}, {"ambient_occlusion": 5}, {"ao_distance": 0.82}),
    "occlusion of all light": Row(stage, {**OCCLUDED, "ambient": "plain", **SHADOWS}, {"ambient": "tinted"}),
    "metal": Row(lambda: stage(facets()), {"shader": "pbr"}, surfaced(pbr=MetallicRoughness(0.601, 0.3))),
    "all maps": Row(all_maps, {"shader": "pbr", "layers": ("Z", "id", "N")}, surfaced(pbr=mapped(normal_scale=0.81))),
    "maps of the second coordinates": Row(
        lambda: all_maps(**{name: Texture(noise(6, 7, 5), coordinates=1) for name in list(MAPS)[:2]}), {"shader": "pbr"}
    ),
    "maps of the nearest texels": Row(
        lambda: all_maps(**{name: Texture(noise(9, 8, 6), filter="nearest") for name in list(MAPS)[:2]}),
        {"shader": "pbr", **TRILINEAR},
    ),
    "mixed maps": Row(mixed_maps, {"shader": "pbr", "layers": ("Z", "id", "N")}),
    "an environment": Row(surrounded, {"shader": "pbr"}, changed(environment=replace(AROUND, intensity=1.502))),
    "four samples": Row(stage, {"samples": 4}, {"samples": 5}),
    "four samples of glass": Row(glass, {"samples": 4}, surfaced(opacity=0.801)),
}
PBR = {"shader": "pbr", "shadows": True}
DOUBLE = {"precision": "float64"}
LONG = {
    "occlusion by glass and holes": Row(lambda: glass(lights=()), OCCLUDED, surfaced(opacity=0.9)),
    "gouraud": Row(lambda: lit_by(SPOT, RANGED, SPHERE, PANEL), {"shader": "gouraud", **SIZED}, relit(outer_cone=36.0)),
    "gouraud, glass": Row(glass, {"shader": "gouraud", **TRILINEAR}, surfaced(opacity=0.801)),
    "gouraud, scalars": Row(lambda: measured("faces"), {"shader": "gouraud", "scalars": "data", **ALL_LAYERS}),
    "gouraud, course": Row(cut_out, {"preset": "course", "shader": "gouraud"}, surfaced(alpha_cutoff=0.46)),
    "gouraud, shadows": Row(
        lambda: glass(lights=(SPHERE, SUN)), {"shader": "gouraud", **SHADOWS, **SIZED}, {"shadows": False}
    ),
    "unlit": Row(cut_out, {"shader": "nolight", **ALL_LAYERS}, surfaced(color=(0.5, 1.0, 2.001))),
    "unlit at vertices": Row(
        far_uvs, {"shader": "nolight", "texture_at": "vertex", "interpolation": "affine"}, PERSPECTIVE
    ),
    "unlit scalars": Row(lambda: measured("corners"), {"shader": "nolight", "scalars": "data"}),
    "painter": Row(glass, {"visibility": "painter", "interpolation": "affine"}, {"visibility": "depth"}),
    "painter, lines": Row(measured, {"visibility": "painter", "scalars": "data", "samples": 4, **LINES}),
    "course": Row(lambda: stage(lights=(SPHERE, SPOT)), {"preset": "course", **SHADOWS, **SIZED}, {"shadows": False}),
    "every sample": Row(
        lambda: lit_by(SPHERE, SPOT), {"samples": 3, "sample_shading": True, "light_samples": 16}, relit(radius=0.51)
    ),
    "weighted": Row(lambda: glass(background=None), {"samples": 7, **WEIGHTED}, {"resolve": "mean"}),
    "samples of lines": Row(
        lambda: glass(environment=AROUND), {"samples": 4, **WEIGHTED, **BACKDROP, **LINES}, {"edges": None}
    ),
    "samples of scalars": Row(lambda: measured("corners"), {"samples": 3, **WEIGHTED, "scalars": "data", **ALL_LAYERS}),
    "samples of shadows": Row(glass, {"samples": 3, "sample_shading": True, **SHADOWS}, {"shadows": False}),
    "samples of maps": Row(all_maps, {"shader": "pbr", "samples": 4, **TRILINEAR}),
    "pbr, shadows": Row(all_maps, PBR, {"shadows": False}),
    "pbr, veils": Row(lambda: glass(lights=(SPHERE, SUN)), {**PBR, **SIZED}, surfaced(opacity=0.81)),
    "pbr, occlusion": Row(surrounded, {**PBR, **OCCLUDED}, {"ambient_occlusion": 5}),
    "float64": Row(lambda: lit_by(SPOT, SPHERE, PANEL), {**DOUBLE, **SIZED}, relit(outer_cone=35.001)),
    "float64, holes": Row(cut_out, {**DOUBLE, **TRILINEAR, **ALL_LAYERS}, {"texture_filter": "bilinear"}),
    "float64, far coordinates": Row(far_uvs, DOUBLE),
    "float64, scalars and lines": Row(measured, {**DOUBLE, "scalars": "data", **LINES}, {"scalars": None}),
    "float64, weighted glass": Row(glass, {**DOUBLE, "samples": 3, **WEIGHTED}, surfaced(opacity=0.801)),
    "float64, course": Row(lambda: mixed(camera=PARALLEL), {**DOUBLE, "preset": "course", **ALL_LAYERS}),
    "float64, glaring": Row(glaring, DOUBLE),
    "float64, maps": Row(all_maps, {"shader": "pbr", **DOUBLE}, surfaced(pbr=mapped(normal_scale=0.8001))),
    "float64, shadows": Row(glass, {**DOUBLE, **SHADOWS}, surfaced(opacity=0.801)),
    "float64, occlusion": Row(stage, {**DOUBLE, **OCCLUDED}, {"ambient_occlusion": 5}),
}
ROWS = {**EVERY_DAY, **LONG}


def sheet_of(**fields: Any) -> Row:
    return Row(lambda: mapped_scene(sheet(**fields)), {"shader": "pbr", "layers": ("Z", "id", "N")})


def with_maps(**changes: Any) -> Row:
    return sheet_of(material=Material(ka=0.3, pbr=mapped(**changes)))


def around(environment: Environment) -> Row:
    """Return a row with a mirror and matt and glossy surfaces in an environment."""
    looks = [facets(metallic=1.0, roughness=0.0), facets(metallic=0.0, roughness=1.0), facets(roughness=0.1249999)]
    sheets = [sheet(shift=(0.7 * k - 0.7, 0.3 * k, 0.3 * k), material=look) for k, look in enumerate(looks)]
    return Row(lambda: mapped_scene(*sheets, environment=environment, ambient=0.0), {"shader": "pbr"})


def textured(image: np.ndarray, wrap: Any = "repeat", **options: Any) -> Row:
    """Return a row of triangles with between a texel and the whole texture per pixel."""
    rng = np.random.default_rng(5)
    uvs = rng.uniform(-1, 2, (250, 1, 2)) + np.exp2(rng.uniform(-6, 2, (250, 1, 1))) * rng.normal(size=(250, 3, 2))
    material = Material(texture=Texture(image, wrap), n=5.0)
    return Row(lambda: lit_scene(blob(uvs=uvs.reshape(-1, 2), material=material)), {**TRILINEAR, **options})


def square(uvs: Any, **fields: Any) -> Row:
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    material = Material(texture=texture(**fields))
    return Row(lambda: lit_scene(Mesh(corners, [[0, 1, 2], [0, 2, 3]], uvs=uvs, material=material)), TRILINEAR)


def sized(columns: int, rows: int, **options: Any) -> Row:
    return Row(lambda: stage(camera=replace(CAMERA, resolution=(columns, rows))), options)


IMAGE = AROUND.image
BRIGHT = np.zeros((32, 32, 3), np.float32)  # errors near a bright texel scale with it
BRIGHT[5::9, 7::11] = 1e4
# More owners per block than are handled one by one: their corners are gathered.
GLARE = 10.0 ** np.random.default_rng(1).uniform(-3, 6, (36 * 36, 3))
GLARING = sheet(35, colors=GLARE, uvs=None, more_uvs=(), material=PLAIN)
# Values at the limits, in programs of the rows above: against the oracle alone.
STIFF = {
    "no area of coordinates": sheet_of(uvs=np.zeros((36, 2)), more_uvs=()),
    "coordinates that are NaN": sheet_of(uvs=np.full((36, 2), np.nan), more_uvs=()),
    "tangents of 0": sheet_of(tangents=np.zeros((36, 4))),
    "normals of 0": sheet_of(normals=np.zeros((36, 3))),
    "tangents beyond float32": sheet_of(tangents=np.full((36, 4), 1e300)),
    "a normal map of zeros": with_maps(normal_texture=Texture(np.zeros((1, 1, 3)))),
    "a normal map without normals": with_maps(normal_texture=Texture(np.full((1, 1, 3), 0.5))),
    "a steep normal map": with_maps(normal_scale=1e6),
    "bright emission": with_maps(emission=1e30),
    "emission beyond float32": with_maps(emission=3e38, emission_texture=Texture(np.full((1, 1, 3), 3e38))),
    "the sun in an environment": around(Environment(np.where(np.arange(84).reshape(7, 12, 1) == 30, 1e6, IMAGE))),
    "an environment of one texel": around(Environment(np.full((1, 1, 3), 0.3))),
    "an environment of 1e60": around(Environment(np.full((1, 1, 3), 1e30), intensity=1e30)),
    "an environment of 1e-42": around(Environment(IMAGE * 1e-30, intensity=1e-12)),
    "a spot far away": Row(lambda: lit_by(replace(SPOT, position=(3e29, 1e30, 6e29), intensity=(3e38,) * 3)), {}),
    "a sphere far away": Row(lambda: lit_by(PointLight((1e19, 2e20, 3e20), radius=1e20)), SIZED),
    "a sharp highlight": Row(lambda: stage(replace(PLAIN, n=1e4)), {}),
    "glaring, gathered": Row(lambda: mapped_scene(GLARING), {}),
    "mipmaps of odd sizes": textured(noise(37, 53), "repeat"),
    "mipmaps of powers of 2": textured(noise(64, 64), "mirror"),
    "mipmaps of a column": textured(noise(9, 1), "clamp"),
    "mipmaps of a row": textured(noise(1, 7), ("repeat", "mirror")),
    "few mipmaps": textured(noise(3, 2), "clamp"),
    **{f"a coordinate of {far}": square([[0, 0], [1, 0], [far, 1], [0, 1]]) for far in (np.nan, -np.inf, 1e30, 1e300)},
    "equal huge coordinates": square(np.full((4, 2), 1e30)),
    "equal huge coordinates, mirrored": square(np.full((4, 2), 1e30), wrap="mirror"),
    "bright texels": textured(BRIGHT),
    "bright texels, bilinear": textured(BRIGHT, texture_filter="bilinear"),
    "a pixel": sized(1, 1, **LINES),
    "a column": sized(1, 37, samples=4),
    "a row": sized(333, 1),
    "lines at 60 samples": sized(23, 19, samples=60, **LINES),
    "lines cross the near plane": Row(lambda: measured(camera=replace(CAMERA, eye=(0.5, -0.9, 1.4))), LINES),
    "lines in a wide image": sized(333, 24, edges="all"),
    "wide lines": sized(17, 33, edges=Edges("all", width=40)),
    "thin lines": sized(17, 33, edges=Edges("all", width=0.1)),
}
OTHER_PROGRAM = {"shader", "samples", "shadows", "ambient_occlusion", "preset"}
IN_FIRST_PROGRAM = [name for name, line in EVERY_DAY.items() if not OTHER_PROGRAM & line.options.keys()]
OF_OTHER_PROGRAMS = (
    *("shadows of holes", "occlusion by glass and holes", "all maps", "four samples of glass", "gouraud, shadows"),
    *("painter, lines", "course", "samples of scalars", "float64, scalars and lines"),
)
INSTANCED = "front sides", "glass", "indices of their own", "mixed maps", "float64, weighted glass"


def marked(*values: Any, long: bool) -> Any:
    return pytest.param(*values, marks=[pytest.mark.long] * long)


every_row = pytest.mark.parametrize("name", [marked(name, long=name in LONG) for name in ROWS])


def draw(device: Device, name: str, **options: Any) -> Frame:
    line = ROWS.get(name) or STIFF[name]
    skip_unsupported(device, line.options)
    return rendered(line.scene(), device=device, **{"layers": ("Z", "id"), **line.options, **options})


@cache
def drawn(device: Device, name: str) -> Frame:
    return draw(device, name)


@pytest.mark.parametrize("name", STIFF)
def test_values_at_the_limits_equal_the_oracle(device, name):
    oracle_asserts.assert_all(draw(device, name))


@every_row
def test_it_equals_the_oracle(device, name):
    frame = drawn(device, name)
    assert frame.alpha.mean() > 0.15
    agreement = oracle_asserts.assert_all(frame)
    assert agreement.ties.mean() < 0.01
    assert agreement.bounds < (16.0 if frame.settings.precision == "float32" else np.inf), agreement.bounds


@pytest.mark.parametrize(
    ("name", "number"),
    [marked(name, k, long=name in LONG) for name, line in ROWS.items() for k in range(len(line.wrong))],
)
def test_an_error_is_noticed(device, name, number):
    frame, wrong = drawn(device, name), ROWS[name].wrong[number]
    scene, settings = frame.scene, frame.settings
    scene, settings = (scene, replace(settings, **wrong)) if isinstance(wrong, dict) else (wrong(scene), settings)
    claimed = Frame(frame.rgba, {layer: frame[layer] for layer in frame.layers}, scene, settings, dict)
    with pytest.raises(AssertionError, match=r"bounds|differ") as error:
        oracle_asserts.assert_all(claimed)
    folder = Path(str(error.value).rpartition(" in ")[2])
    pictures = [png.read(folder / f"{name}.png") for name in ("picture", "reference", "difference")]
    assert {picture.shape for picture in pictures} == {(*frame.rgba.shape[:2], 3)}
    assert pictures[2].max() == 255


@pytest.mark.parametrize("name", [*EVERY_DAY, *(marked(name, long=True) for name in LONG if name in OF_OTHER_PROGRAMS)])
def test_all_features_forced_change_no_bit(device, name):
    lean, full = drawn(device, name), draw(device, name, forced=OPTIONAL)
    assert not full.stats["left_out"]
    assert different_bits(lean, full) == ""


@pytest.mark.parametrize("name", [*IN_FIRST_PROGRAM, *(marked(name, long=True) for name in OF_OTHER_PROGRAMS)])
def test_another_number_of_lanes_changes_no_bit(device, name):
    lanes = 1 if name in EVERY_DAY else 8 if "samples" in ROWS[name].options else 4
    assert different_bits(drawn(device, name), draw(device, name, lanes=lanes)) == ""


@every_row
def test_views_in_a_row_and_parts_of_an_image_have_the_same_bits(device, name):
    """After views of another size; cut across tiles and blocks."""
    frame = drawn(device, name)
    camera = frame.scene.camera
    near, aside = (replace(camera, eye=camera.eye + shift) for shift in ((0.1, -0.2, -1.5), (-0.8, 0.3, 0.4)))
    left, top = 13, 7
    columns, rows = np.array(camera.resolution) - (17, 9)
    cut = np.s_[top : top + rows, left : left + columns]
    layers = {layer: frame[layer][cut] for layer in frame.layers}
    whole = Frame(frame.rgba[cut], layers, frame.scene, frame.settings, dict)
    with Renderer(frame.scene, settings=frame.settings, device=device) as renderer:
        renderer.render(aside.with_resolution((40, 23)))
        assert different_bits(renderer.render_many([near, camera, aside])[1], frame) == ""
        assert different_bits(renderer.render(part_of(camera, left, top, int(columns), int(rows))), whole) == ""


@pytest.mark.parametrize("name", [marked(name, long=k > 2) for k, name in enumerate(INSTANCED)])
def test_instances_from_one_copy_of_a_mesh_have_the_same_bits(device, monkeypatch, name):
    needs_float64(device)
    monkeypatch.setattr(triangle_source, "LEAST_COPIES", 0)
    frame = draw(device, name)
    assert "INSTANCES" in frame.stats["features"]
    assert different_bits(frame, drawn(device, name)) == ""


def test_every_feature_is_needed_by_a_row_and_left_out_of_another():
    needed, left_out = set(), set()
    for line in ROWS.values():
        scene, settings = effective_settings(line.scene(), **{"layers": ("Z", "id"), **line.options})
        feature_set = features.derive(scene, settings, double_positions=False)
        needed |= set(feature_set.used)
        left_out |= {name for name, reason in feature_set.left_out if reason}
    assert set(OPTIONAL) - needed - {"DOUBLE_POSITIONS"} == set()
    assert set(OPTIONAL) - left_out - {"OWNERS"} == set()
