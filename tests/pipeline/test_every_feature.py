"""Every feature of a frame, as one table of scenes. Of each row: its frame equals the oracle's; an error in it is noticed;
another number of lanes, all features forced on, earlier views, parts and a single copy of its instances change no bit.

What only one feature has, such as closed forms, is in a file of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

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


def stage(
    material: Material = PLAIN, *more: Mesh, cells: int = 5, mesh: dict[str, Any] | None = None, **fields: Any
) -> Scene:
    """Return triangles of all sizes and a bent sheet of a material over a ground. mesh: fields of the sheet."""
    corners = np.array([[-4.0, -1.2, -4.0], [-4.0, -1.2, 4.0], [4.0, -1.2, 4.0], [4.0, -1.2, -4.0]])
    ground = Mesh(corners, [[0, 1, 2], [0, 2, 3]], colors=np.full((4, 3), 0.8), material=PLAIN)
    crystals = replace(blob(30, material=PLAIN), verts=0.5 * blob(30).verts - [0.4, 0.0, 0.4])
    bent = sheet(cells, material=material, **(mesh or {}))
    return mapped_scene(ground, crystals, bent, *more, **{"camera": CAMERA, **fields})


def sheet_with(scene: Scene, **fields: Any) -> Scene:
    """Return the scene with other fields of the sheet's material."""
    *objects, bent = scene.meshes
    return replace(scene, meshes=(*objects, replace(bent, material=replace(bent.material, **fields))))


def changed_sheet(**fields: Any) -> Change:
    return lambda scene: sheet_with(scene, **fields)


def changed_light(**fields: Any) -> Change:
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
SIZED = {"light_samples": 3}


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
    mirror, stretched = np.diag([-1.0, 1.0, 1.0, 1.0]), np.diag([2.0, 0.4, 1.5, 1.0])
    mirror[:3, 3], stretched[:3, 3] = (0.5, 0.6, -0.7), (-0.5, -0.9, -0.3)
    behind = np.diag([1.0, -1.0, -1.0, 1.0])
    behind[:3, 3] = -1.1, 0.8, -0.5
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
TRILINEAR = {"texture_filter": "trilinear"}
NARROW_RANGE = {"scalars": Scalars("data", "viridis", (0.0, 0.31))}
LINES = {"edges": Edges(("feature", "silhouette"), width=2.6, color=(1, 0.5, 0))}
OCCLUDED = {"ambient_occlusion": 4, "resolution": (35, 27), "layers": ("Z", "id", "P", "AO")}


class Row(NamedTuple):
    """scene, options: what is drawn. wrong: changes of the scene, or settings, for each of which it is beyond the bounds."""

    scene: Callable[[], Scene]
    options: dict[str, Any]
    wrong: tuple[Change | dict[str, Any], ...]


def row(scene: Callable[[], Scene], options: dict[str, Any] | None = None, *wrong: Change | dict[str, Any]) -> Row:
    return Row(scene, options or {}, wrong)


# Of few programs: those of shaders phong and pbr with and without rays to casters, and of several samples.
EVERY_DAY = {
    "points": row(stage, {}, changed_light(position=(3.001, 4.0, 5.0)), moved_crystals),
    "a sun": row(lambda: lit_by(SUN), {}, changed_light(direction=(-1.01, -2.0, -1.5))),
    "a ranged light": row(
        lambda: lit_by(RANGED), {}, changed_light(range=4.04), changed_light(intensity=(2.002, 1.5, 1.0))
    ),
    "a spot": row(lambda: lit_by(SPOT), {}, changed_light(outer_cone=36.0), changed_light(inner_cone=11.0)),
    "a sphere": row(lambda: lit_by(SPHERE), SIZED, changed_light(radius=0.505), {"light_samples": 4}),
    "a rectangle": row(lambda: lit_by(PANEL), {"light_samples": 16}, changed_light(right=(0.505, 0.1, 0.0))),
    "trilinear": row(lambda: stage(replace(PLAIN, texture=texture())), TRILINEAR, {"texture_filter": "bilinear"}),
    "nearest": row(
        lambda: stage(replace(PLAIN, texture=texture(filter="nearest", wrap="mirror"))),
        {},
        changed_sheet(texture=texture(wrap="mirror")),
    ),
    "the course's lookup": row(
        lambda: stage(replace(PLAIN, texture=texture(lookup="course"))), TRILINEAR, changed_sheet(texture=texture())
    ),
    "far coordinates": row(far_uvs, {"layers": ("Z", "id", "uv", "albedo")}, changed_sheet(texture=texture())),
    "holes": row(cut_out, {}, changed_sheet(alpha_cutoff=0.46)),
    "front sides": row(mirrored, {}, changed_sheet(sides="both")),
    "two sides": row(cut_out, {"near": 3.0}, changed_sheet(two_sided=False)),
    "indices of their own": row(mixed, {**ALL_LAYERS, **TRILINEAR}, changed(meshes=mixed().meshes[:-1])),
    "glass": row(glass, {}, changed_sheet(opacity=0.801)),
    "glass over nothing": row(
        lambda: glass(background=None, camera=PARALLEL), {"layers": "all", "layer_alpha": 0.5}, {"layer_alpha": 0.0}
    ),
    "lines": row(stage, LINES, {"edges": replace(LINES["edges"], width=2.8)}),
    "lines alone": row(glass, {"edges": Edges("all", only=True)}, {"edges": Edges("all")}),
    "lines over scalars": row(
        measured, {"edges": "all", "scalars": "data", "layers": ("Z", "id", "scalar")}, NARROW_RANGE
    ),
    "scalars": row(measured, {"scalars": "data", "layers": "all"}, NARROW_RANGE),
    "scalars of corners": row(lambda: measured("corners"), {"scalars": Scalars("data", "tab10", (-0.1, 0.2))}),
    "a parallel camera": row(
        lambda: cut_out(camera=PARALLEL), {}, changed(camera=replace(PARALLEL, principal=(0.401, 0.55)))
    ),
    "nothing behind": row(lambda: stage(background=None), {}, changed(background=(1e-3, 0.0, 0.0))),
    "an environment behind": row(
        lambda: glass(environment=AROUND),
        {"background": "environment"},
        changed(environment=replace(AROUND, rotation=26)),
    ),
    "affine": row(
        cut_out, {"preset": "course", "shader": "phong", "visibility": "depth"}, {"interpolation": "perspective"}
    ),
    "near": row(mirrored, {"near": 3.3, "layers": "all"}, {"near": 3.4}),
    "glaring": row(glaring, {}, changed_light(intensity=(1.001, 0.9, 0.7))),
    "shadows": row(stage, {"shadows": True}, moved_crystals, changed_light(position=(3.02, 4.0, 5.0))),
    "shadows of a sun": row(lambda: stage(lights=SUN), {"shadows": True}, changed_light(direction=(-1.02, -2.0, -1.5))),
    "shadows of a spot": row(lambda: lit_by(SPOT, RANGED), {"shadows": True}, {"shadows": False}),
    "shadows of a sphere": row(lambda: lit_by(SPHERE), {"shadows": True, **SIZED}, changed_light(radius=0.52)),
    "shadows of a rectangle": row(lambda: lit_by(PANEL), {"shadows": True, **SIZED}, {"light_samples": 4}),
    "shadows of glass": row(glass, {"shadows": True}, changed_sheet(opacity=0.801)),
    "shadows of holes": row(
        lambda: cut_out(lights=SPHERE), {"shadows": True, **SIZED}, changed_sheet(alpha_cutoff=0.5)
    ),
    "ambient occlusion": row(stage, {**OCCLUDED, "ao_distance": 0.8}, {"ambient_occlusion": 5}, {"ao_distance": 0.82}),
    "occlusion of all light": row(stage, {**OCCLUDED, "ambient": "plain", "shadows": True}, {"ambient": "tinted"}),
    "metal": row(lambda: stage(facets()), {"shader": "pbr"}, changed_sheet(pbr=MetallicRoughness(0.601, 0.3))),
    "all maps": row(
        all_maps, {"shader": "pbr", "layers": ("Z", "id", "N")}, changed_sheet(pbr=mapped(normal_scale=0.81))
    ),
    "maps of the second coordinates": row(
        lambda: all_maps(**{name: Texture(noise(6, 7, 5), coordinates=1) for name in list(MAPS)[:2]}), {"shader": "pbr"}
    ),
    "maps of the nearest texels": row(
        lambda: all_maps(**{name: Texture(noise(9, 8, 6), filter="nearest") for name in list(MAPS)[:2]}),
        {"shader": "pbr", **TRILINEAR},
    ),
    "mixed maps": row(mixed_maps, {"shader": "pbr", "layers": ("Z", "id", "N")}),
    "an environment": row(surrounded, {"shader": "pbr"}, changed(environment=replace(AROUND, intensity=1.502))),
    "four samples": row(stage, {"samples": 4}, {"samples": 5}),
    "four samples of glass": row(glass, {"samples": 4}, changed_sheet(opacity=0.801)),
}
PBR = {"shader": "pbr", "shadows": True}
DOUBLE = {"precision": "float64"}
LONG = {
    "occlusion by glass and holes": row(lambda: glass(lights=()), OCCLUDED, changed_sheet(opacity=0.9)),
    "gouraud": row(
        lambda: lit_by(SPOT, RANGED, SPHERE, PANEL), {"shader": "gouraud", **SIZED}, changed_light(outer_cone=36.0)
    ),
    "gouraud, glass": row(glass, {"shader": "gouraud", **TRILINEAR}, changed_sheet(opacity=0.801)),
    "gouraud, scalars": row(lambda: measured("faces"), {"shader": "gouraud", "scalars": "data", **ALL_LAYERS}),
    "gouraud, course": row(cut_out, {"preset": "course", "shader": "gouraud"}, changed_sheet(alpha_cutoff=0.46)),
    "gouraud, shadows": row(
        lambda: glass(lights=(SPHERE, SUN)), {"shader": "gouraud", "shadows": True, **SIZED}, {"shadows": False}
    ),
    "unlit": row(cut_out, {"shader": "nolight", **ALL_LAYERS}, changed_sheet(color=(0.5, 1.0, 2.001))),
    "unlit at vertices": row(
        far_uvs,
        {"shader": "nolight", "texture_at": "vertex", "interpolation": "affine"},
        {"interpolation": "perspective"},
    ),
    "unlit scalars": row(lambda: measured("corners"), {"shader": "nolight", "scalars": "data"}),
    "painter": row(glass, {"visibility": "painter", "interpolation": "affine"}, {"visibility": "depth"}),
    "painter, lines": row(measured, {"visibility": "painter", "scalars": "data", "samples": 4, **LINES}),
    "course": row(
        lambda: stage(lights=(SPHERE, SPOT)), {"preset": "course", "shadows": True, **SIZED}, {"shadows": False}
    ),
    "every sample": row(
        lambda: lit_by(SPHERE, SPOT),
        {"samples": 3, "sample_shading": True, "light_samples": 16},
        changed_light(radius=0.51),
    ),
    "weighted": row(lambda: glass(background=None), {"samples": 7, "resolve": "weighted"}, {"resolve": "mean"}),
    "samples of lines": row(
        lambda: glass(environment=AROUND),
        {"samples": 4, "resolve": "weighted", "background": "environment", **LINES},
        {"edges": None},
    ),
    "samples of scalars": row(
        lambda: measured("corners"), {"samples": 3, "resolve": "weighted", "scalars": "data", **ALL_LAYERS}
    ),
    "samples of shadows": row(glass, {"samples": 3, "sample_shading": True, "shadows": True}, {"shadows": False}),
    "samples of maps": row(all_maps, {"shader": "pbr", "samples": 4, **TRILINEAR}),
    "pbr, shadows": row(all_maps, PBR, {"shadows": False}),
    "pbr, veils": row(lambda: glass(lights=(SPHERE, SUN)), {**PBR, **SIZED}, changed_sheet(opacity=0.81)),
    "pbr, occlusion": row(surrounded, {**PBR, **OCCLUDED}, {"ambient_occlusion": 5}),
    "float64": row(lambda: lit_by(SPOT, SPHERE, PANEL), {**DOUBLE, **SIZED}, changed_light(outer_cone=35.001)),
    "float64, holes": row(cut_out, {**DOUBLE, **TRILINEAR, **ALL_LAYERS}, {"texture_filter": "bilinear"}),
    "float64, far coordinates": row(far_uvs, DOUBLE),
    "float64, scalars and lines": row(measured, {**DOUBLE, "scalars": "data", **LINES}, {"scalars": None}),
    "float64, weighted glass": row(
        glass, {**DOUBLE, "samples": 3, "resolve": "weighted"}, changed_sheet(opacity=0.801)
    ),
    "float64, course": row(lambda: mixed(camera=PARALLEL), {**DOUBLE, "preset": "course", **ALL_LAYERS}),
    "float64, glaring": row(glaring, DOUBLE),
    "float64, maps": row(all_maps, {"shader": "pbr", **DOUBLE}, changed_sheet(pbr=mapped(normal_scale=0.8001))),
    "float64, shadows": row(glass, {**DOUBLE, "shadows": True}, changed_sheet(opacity=0.801)),
    "float64, occlusion": row(stage, {**DOUBLE, **OCCLUDED}, {"ambient_occlusion": 5}),
}
ROWS = {**EVERY_DAY, **LONG}


def sheet_of(shader: str = "pbr", **fields: Any) -> Row:
    return row(lambda: mapped_scene(sheet(**fields)), {"shader": shader, "layers": ("Z", "id", "N")})


def with_maps(**changes: Any) -> Row:
    return sheet_of(material=Material(ka=0.3, pbr=mapped(**changes)))


def around(environment: Environment) -> Row:
    """Return a row with a mirror and matt and glossy surfaces in an environment."""
    looks = [facets(metallic=1.0, roughness=0.0), facets(metallic=0.0, roughness=1.0), facets(roughness=0.1249999)]
    sheets = [sheet(shift=(0.7 * k - 0.7, 0.3 * k, 0.3 * k), material=look) for k, look in enumerate(looks)]
    return row(lambda: mapped_scene(*sheets, environment=environment, ambient=0.0), {"shader": "pbr"})


def textured(image: np.ndarray, wrap: Any = "repeat", **options: Any) -> Row:
    """Return a row of triangles with between a texel and the whole texture per pixel."""
    rng = np.random.default_rng(5)
    uvs = rng.uniform(-1, 2, (250, 1, 2)) + np.exp2(rng.uniform(-6, 2, (250, 1, 1))) * rng.normal(size=(250, 3, 2))
    material = Material(texture=Texture(image, wrap), n=5.0)
    return row(lambda: lit_scene(blob(uvs=uvs.reshape(-1, 2), material=material)), {**TRILINEAR, **options})


def square(uvs: Any, **fields: Any) -> Row:
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    material = Material(texture=texture(**fields))
    return row(lambda: lit_scene(Mesh(corners, [[0, 1, 2], [0, 2, 3]], uvs=uvs, material=material)), TRILINEAR)


def corner_at(value: float) -> Row:
    """Return a row with a texture coordinate beyond all texels: undefined it counts as 0."""
    return square([[0, 0], [1, 0], [value, 1], [0, 1]])


def bright_texels(**options: Any) -> Row:
    """Return a row of texels of 1e4 among black ones, near which errors scale with the bright ones."""
    image = np.zeros((32, 32, 3), np.float32)
    image[5::9, 7::11] = 1e4
    return textured(image, **options)


def sized(columns: int, rows: int, **options: Any) -> Row:
    return row(lambda: stage(camera=replace(CAMERA, resolution=(columns, rows))), options)


def glaring_crystals() -> Scene:
    """Return more owners per block than are handled one by one: their corners are gathered."""
    colors = 10.0 ** np.random.default_rng(1).uniform(-3, 6, (36 * 36, 3))
    return mapped_scene(sheet(35, colors=colors, uvs=None, more_uvs=(), material=PLAIN))


IMAGE = AROUND.image
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
    "a spot far away": row(lambda: lit_by(replace(SPOT, position=(3e29, 1e30, 6e29), intensity=(3e38,) * 3)), {}),
    "a sphere far away": row(lambda: lit_by(PointLight((1e19, 2e20, 3e20), radius=1e20)), SIZED),
    "a sharp highlight": row(lambda: stage(replace(PLAIN, n=1e4)), {}),
    "glaring, gathered": row(glaring_crystals, {}),
    "mipmaps of odd sizes": textured(noise(37, 53), "repeat"),
    "mipmaps of powers of 2": textured(noise(64, 64), "mirror"),
    "mipmaps of a column": textured(noise(9, 1), "clamp"),
    "mipmaps of a row": textured(noise(1, 7), ("repeat", "mirror")),
    "few mipmaps": textured(noise(3, 2), "clamp"),
    "a coordinate of NaN": corner_at(np.nan),
    "a coordinate of -inf": corner_at(-np.inf),
    "a coordinate of 1e30": corner_at(1e30),
    "a coordinate of 1e300": corner_at(1e300),
    "equal huge coordinates": square(np.full((4, 2), 1e30)),
    "equal huge coordinates, mirrored": square(np.full((4, 2), 1e30), wrap="mirror"),
    "bright texels": bright_texels(),
    "bright texels, bilinear": bright_texels(texture_filter="bilinear"),
    "a pixel": sized(1, 1, **LINES),
    "a column": sized(1, 37, samples=4),
    "a row": sized(333, 1),
    "lines at 60 samples": row(stage, {"samples": 60, **LINES}),
    "lines cross the near plane": row(lambda: measured(camera=replace(CAMERA, eye=(0.5, -0.9, 1.4))), LINES),
    "lines in a wide image": sized(333, 24, edges="all"),
    "wide lines": sized(17, 33, edges=Edges("all", width=40)),
    "thin lines": sized(17, 33, edges=Edges("all", width=0.1)),
}
OTHER_PROGRAM = {"shader", "samples", "shadows", "ambient_occlusion", "preset"}
IN_FIRST_PROGRAM = [name for name, line in EVERY_DAY.items() if not OTHER_PROGRAM & line.options.keys()]
OF_OTHER_PROGRAMS = (
    *("shadows of holes", "occlusion by glass and holes", "all maps", "four samples of glass"),
    *("gouraud, glass", "gouraud, shadows", "unlit at vertices", "painter, lines", "course", "samples of maps"),
    *("samples of scalars", "samples of shadows", "pbr, veils", "float64, scalars and lines"),
)
INSTANCED = (
    "front sides",
    "glass",
    "indices of their own",
    "mixed maps",
    "unlit",
    "painter",
    "float64, weighted glass",
)


every_row = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in ROWS]
)


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
    [
        pytest.param(name, number, marks=[pytest.mark.long] * (name in LONG))
        for name, line in ROWS.items()
        for number in range(len(line.wrong))
    ],
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


@every_row
def test_all_features_forced_change_no_bit(device, name):
    lean, full = drawn(device, name), draw(device, name, forced=OPTIONAL)
    assert not full.stats["left_out"]
    assert different_bits(lean, full) == ""


@pytest.mark.parametrize(
    "name", [*IN_FIRST_PROGRAM, *(pytest.param(name, marks=pytest.mark.long) for name in OF_OTHER_PROGRAMS)]
)
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
    whole = Frame(
        frame.rgba[cut], {layer: frame[layer][cut] for layer in frame.layers}, frame.scene, frame.settings, dict
    )
    with Renderer(frame.scene, settings=frame.settings, device=device) as renderer:
        renderer.render(aside.with_resolution((40, 23)))
        assert different_bits(renderer.render_many([near, camera, aside])[1], frame) == ""
        assert different_bits(renderer.render(part_of(camera, left, top, int(columns), int(rows))), whole) == ""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (k > 2)) for k, name in enumerate(INSTANCED)]
)
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
