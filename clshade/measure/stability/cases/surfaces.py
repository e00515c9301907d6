"""Cases 20c, 23b and 25 to 27: degenerate normals, values at the limits of the number range; transparent surfaces, many and
faint; shader pbr with narrow lobes and extreme maps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .... import oracle
from ....base.arrays import Floats
from ....pipeline.frame import Frame
from ....scene.model import MIN_ROUGHNESS, Material, Mesh, MetallicRoughness, PointLight, Scalars, Scene, Texture
from ...check import oracle_bounds
from . import lit
from .bench import PRESETS, Bench, Case, Outcome, Outcomes, against_oracle, all_against_oracle, different_bits

_BITS = 22  # vertices are odd multiples of 2^-23: exact in float64 even at 1e9, nowhere in float32


def degenerate_normals(bench: Bench) -> Outcomes:
    """Normals that are 0, cancel between corners or faces, or have lengths of 1e-300 and 1e300."""
    mesh = lit.patch()
    count = len(mesh.verts)
    rng = np.random.default_rng(25)
    up = np.broadcast_to([0.0, 0.0, 1.0], (count, 3))
    sets = (
        np.zeros((count, 3)),
        up * np.where(np.arange(count) % 2, -1.0, 1.0)[:, None],
        up * 10.0 ** rng.uniform(-300, 300, (count, 1)),
        np.where(rng.random((count, 1)) < 0.3, 0.0, rng.normal(size=(count, 3))),
    )
    doubled = np.concatenate([mesh.faces, mesh.faces[:, [0, 2, 1]]])  # each face with its reverse: the normals sum to 0
    meshes = [replace(mesh, faces=doubled), *(replace(mesh, normals=normals) for normals in sets)]
    for preset in PRESETS:
        yield from all_against_oracle(bench, [lit.scene_of(mesh) for mesh in meshes], preset=preset)


def renormalized(bench: Bench) -> Outcomes:
    """Corner normals up to 150 degrees apart: interpolated normals are short, and renormalized per pixel."""
    rng = np.random.default_rng(26)
    mesh = lit.patch(cells=2)
    for degrees in (30.0, 90.0, 150.0):
        tilt = np.radians(degrees / 2) * np.where(np.arange(9) % 2, -1, 1)
        way = rng.uniform(0, 2 * np.pi, 9)
        normals = np.stack([np.sin(tilt) * np.cos(way), np.sin(tilt) * np.sin(way), np.cos(tilt)], axis=1)
        yield against_oracle(bench.draw(lit.scene_of(replace(mesh, normals=normals))))


def _lit_by(*intensities: float, **coefficients: Any) -> Scene:
    lights = [replace(lit.LIGHTS[i % 2], intensity=np.full(3, value)) for i, value in enumerate(intensities)]
    # Almost no ambient light, but not zero, which would need another program.
    material = replace(lit.MATERIAL, ka=1e-35, **coefficients)
    return lit.scene_of(lit.patch(material=material), lights=tuple(lights))


def intensities(bench: Bench) -> Outcomes:
    """Lights of 1e-30 to 1e30, also together: finite, within the bound of the light budget."""
    pairs = (1e-30, 1e-30), (1e-20, 1e-25), (1e-30, 1e30), (1e20, 1.0), (1e30, 1e30), (1e30, -1e30)
    return all_against_oracle(bench, [_lit_by(*pair) for pair in pairs])


def _saturated(bench: Bench, scene: Scene) -> Outcome:
    """Check that exactly the pixels beyond float32 hold the largest finite value, and that stats["saturated"] counts
    them."""
    frame = bench.draw(scene)
    expected = oracle.render(frame.scene, frame.settings)
    saturated = (np.abs(frame.rgb) >= oracle_bounds.FLOAT32_MAX).any(axis=-1)
    largest = np.abs(expected.rgb).max(axis=-1) / oracle_bounds.FLOAT32_MAX
    wrong = ((largest > 1.001) & ~saturated) | ((largest < 0.999) & saturated) | ~np.isfinite(frame.rgb).all(axis=-1)
    uncounted = abs(frame.stats["saturated"] - int(saturated.sum())) + int(not saturated.any())
    return Outcome(int(wrong.sum()) + uncounted, pictures=(frame.rgb, expected.rgb))


def overflow(bench: Bench) -> Outcomes:
    """Reflected light beyond float32, on surfaces of color 2 and on darker ones that bring some of it back into range."""
    for pair in ((3.4e38, 3.4e38), (-3.4e38, -3.4e38), (3.4e38, 1.0), (1e38, 1e38)):
        scene = _lit_by(*pair, kd=3.0, ks=2.0)
        bright = replace(scene.meshes[0], colors=np.full_like(scene.meshes[0].verts, 2.0))
        yield from (_saturated(bench, variant) for variant in (scene, replace(scene, meshes=(bright,))))


def centered() -> Scene:
    """Return the blob and its camera on the grid of 2^-22, as the lights are."""
    eye, lookat = (np.round(point * 2.0**_BITS) / 2.0**_BITS for point in (lit.CAMERA.eye, lit.CAMERA.lookat))
    return lit.scene_of(lit.on_a_grid(lit.blob(), _BITS), camera=replace(lit.CAMERA, eye=eye, lookat=lookat))


def _as_centered(frame: Frame, first: Frame) -> Outcomes:
    """Compare ids and colors of a frame with its oracle and with that of the centered scene."""
    yield against_oracle(frame)
    yield against_oracle(Frame(frame.rgba, {"id": frame["id"]}, first.scene, first.settings, dict))


def offsets(bench: Bench) -> Outcomes:
    """The scene moved to +1e6 and +1e9, where its vertices are still exact: the oracle's image of the same float64
    data, and the centered scene's."""
    for preset in PRESETS:
        first = bench.draw(centered(), preset=preset)
        for shift in (1e6, 1e9, np.array([1e9, -1e6, 3e8])):
            frame = bench.draw(lit.shifted(centered(), 1.0, shift), preset=preset)
            yield from _as_centered(frame, first)


def scales(bench: Bench) -> Outcomes:
    """The scene scaled by 1e-20 to 1e20: the same ids, colors within the bound; by a power of two: the same bits."""
    for preset in PRESETS:
        first = bench.draw(centered(), preset=preset)
        for scale in (1e-20, 1e-10, 1e10, 1e20):
            frame = bench.draw(lit.shifted(centered(), scale, 0.0), preset=preset)
            yield from _as_centered(frame, first)
        for power in (-70, -3, 90):
            frame = bench.draw(lit.shifted(centered(), 2.0**power, 0.0), preset=preset)
            layers = {"Z": np.ldexp(first["Z"], power).astype(np.float32), "id": first["id"]}
            yield different_bits(frame, Frame(first.rgba, layers, first.scene, first.settings, dict))


_DATA: tuple[tuple[float, float, tuple[float, float] | None], ...] = (
    (1.0, 1e30, None),
    (1.0, 1e30, (0.0, 1.0)),
    (1e9, 1.0, (1e9, 1e9 + 1e-3)),
    (0.0, 1.0, (0.5, 0.5)),
    (-1.7e308, 1.7e308, None),
    (5e-324, 1e-310, None),
    (1e-40, 1e-38, (0.0, 1e-45)),
    (1.0, np.nan, None),
)


def scalars(bench: Bench) -> Outcomes:
    """Data of a color map from denormals to the largest numbers, next to each other; maps of no width, and NaN."""
    mesh = lit.patch()
    rng = np.random.default_rng(27)
    for low, high, ends in _DATA:
        share = rng.random((len(mesh.faces), 3))
        values = np.where(share < 0.3, low, np.where(share < 0.6, high, low * (1.0 - share) + high * share))
        scene = lit.scene_of(replace(mesh, scalars={"data": values}))
        yield against_oracle(bench.draw(scene, scalars=Scalars("data", clim=ends)))


_LAYERS = 1000


def _squares(z: Floats, **fields: Any) -> Mesh:
    """Return squares at depths z (K,), cut along one diagonal or the other in turn, of random colors and alphas."""
    rng = np.random.default_rng(20)
    verts = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + z[:, None, None] * [0, 0, 1]
    cuts = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    faces = cuts[np.arange(len(z)) % 2] + 4 * np.arange(len(z))[:, None, None]
    colors, alphas = rng.uniform(0, 1, (4 * len(z), 3)), rng.uniform(0.5, 1, 4 * len(z))
    material = Material(two_sided=True, blend=True, **fields)
    return Mesh(verts.reshape(-1, 3), faces.reshape(-1, 3), colors, alphas=alphas, material=material)


def transparency(bench: Bench) -> Outcomes:
    """1000 layers behind each other and in one plane, alphas from 1e-7 to 1, triangles that intersect: within the bound, and
    twice the same bits."""
    apart, camera = np.linspace(-1.0, 1.0, _LAYERS), replace(lit.CAMERA, resolution=(20, 20))
    soup = lit.blob(150)
    alphas = np.random.default_rng(7).uniform(0, 1, len(soup.verts))
    wall = lit.patch(material=Material(two_sided=True))
    scenes = (
        ("1000 layers", (_squares(apart, opacity=1 / 256),)),
        ("alpha 1e-7", (_squares(apart[::10], opacity=1e-7),)),
        ("alpha to 1", (_squares(apart[::10], opacity=1.0),)),
        ("in one plane", (_squares(np.zeros(12), opacity=0.3),)),
        ("1000 in one plane", tuple(_squares(np.zeros(1), opacity=1 / 64) for _ in range(_LAYERS))),
        ("intersecting", (replace(soup, alphas=alphas, material=Material(blend=True)), wall)),
    )
    for name, meshes in scenes:
        frames = [bench.draw(lit.scene_of(*meshes, camera=camera)) for _ in range(2)]
        yield from [against_oracle(frames[0], name), different_bits(*frames)]


# Microfacets

ROUGHNESSES = (0.0, 1e-4, MIN_ROUGHNESS, 0.1, 1.0)
_MIRRORED = PointLight(lit.CAMERA.eye * [-1.0, -1.0, 1.0], np.array([1.0, 0.8, 0.6]))
_BEHIND = PointLight(np.array([-0.5, 0.3, -3.0]), np.array([0.5, 1.0, 0.8]))


def _sheet(metallic: float, roughness: float, emission: float) -> Mesh:
    """Return a sheet whose normals, along its middle row, point between the eye and the light that it mirrors."""
    pbr = MetallicRoughness(metallic, roughness, emission=(emission, 0.1, 0.0))
    return lit.patch(cells=10, bend=-0.5 / lit.CAMERA.eye[2], material=Material(ka=0.2, pbr=pbr))


def narrow_lobes(bench: Bench) -> Outcomes:
    """Roughness 0 to 1 in highlights as wide as the sheet, and where normals lean away from the eye; emission of 1e30."""
    sheets = [_sheet(k % 3 / 2.0, roughness, 0.1) for k, roughness in enumerate(ROUGHNESSES)]
    away = sheets[0].verts * [3.0, 2.0, 0.0] + [0.5, 0.0, -0.4]
    sheets += [replace(_sheet(0.5, roughness, 0.1), normals=away) for roughness in (0.0, 0.5)]
    sheets += [_sheet(0.5, roughness, 1e30) for roughness in (0.0, 1.0)]
    scenes = [lit.scene_of(sheet, lights=(_MIRRORED, _BEHIND, lit.LIGHTS[1])) for sheet in sheets]
    return all_against_oracle(bench, scenes, shader="pbr", forced=("DIFFUSE", "SPECULAR"))


# Maps

_UVS = np.array([1.1, -0.8])  # texture coordinates per scene unit


def _mapped(changes: dict[str, Any], **fields: Any) -> Mesh:
    """Return a bent sheet with all maps, some of whose parameters change."""
    image = np.random.default_rng(1).uniform(0.3, 1.0, (7, 9, 3)).astype(np.float32)
    textures = {
        f"{name}_texture": Texture(image ** (k + 1)) for k, name in enumerate(("normal", "occlusion", "emission"))
    }
    pbr = MetallicRoughness(**{"metallic": 0.2, "roughness": 0.5, "emission": 0.3, **textures, **changes})
    mesh = lit.patch(material=Material(ka=0.2, pbr=pbr))
    return replace(mesh, **{"uvs": mesh.verts[:, :2] * _UVS, **fields})


def maps(bench: Bench) -> Outcomes:
    """Tangents that cancel or are missing, maps without a normal, emission beyond float32, steep and mirrored maps."""
    count = len(lit.patch().verts)
    turned = np.ones((count, 4)) * (1.0 - 2.0 * (np.arange(count) % 2))[:, None]  # neighbors against each other
    turned[::5] = 0.0
    mirrored = np.diag([1.0, -1.0, 1.0, 1.0])
    mirrored[2, 3] = 0.4
    sheets = [
        _mapped({}, uvs=np.zeros((count, 2))),
        _mapped({}, uvs=np.full((count, 2), np.nan)),
        _mapped({}, tangents=np.zeros((count, 4))),
        _mapped({}, tangents=turned),
        _mapped({}, normals=np.zeros((count, 3))),
        _mapped({"normal_texture": Texture(np.zeros((1, 1, 3)))}),
        _mapped({"normal_texture": Texture(np.full((1, 1, 3), 0.5))}),
        _mapped({"normal_scale": 1e6}),
        _mapped({"emission": 1e30}),
        _mapped({"emission": 3e38, "emission_texture": Texture(np.full((1, 1, 3), 3e38))}),
        _mapped({}, uvs=np.abs(lit.patch().verts[:, :2]) * _UVS, instances=[np.eye(4), mirrored]),
    ]
    return all_against_oracle(bench, [lit.scene_of(sheet) for sheet in sheets], shader="pbr")


CASES = (
    Case("25", "degenerate-normals", "zero and canceling normals", "finite, 0 where 0", degenerate_normals),
    Case("26", "renormalized", "interpolated normals far below 1", "renormalized per pixel", renormalized),
    Case("26b", "intensities", "intensities 1e-30..1e30", "within the bound", intensities),
    Case("26c", "overflow", "light beyond float32, times colors", "saturates, counted", overflow),
    Case("27", "offsets", "everything at +1e6 and +1e9", "the centered scene's ids and colors", offsets),
    Case("27b", "scales", "everything times 1e-20..1e20", "same ids; powers of two same bits", scales, True),
    Case("27c", "scalars", "data of 1e-324..1e308, maps of no width", "the map's colors", scalars),
    Case("20c", "transparency", "1000 layers, alpha 1e-7 to 1, in one plane", "within the bound", transparency, True),
    Case("23b", "roughness", "shader pbr, roughness 0 and 1e-4, emission 1e30", "within the bound", narrow_lobes, True),
    Case("26e", "maps", "no tangents, no normal in a map, emission 1e30", "finite, within the bound", maps, True),
)
