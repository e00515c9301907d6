"""Counts of shadow rays, in scenes where all of them are known; counting changes no bit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from kernel_stages import Probe

from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.renderer import Renderer
from clshade.pipeline.shadow_counts import SKIPPED, CountingRenderer, ShadowCounts
from clshade.scene.camera import Camera
from clshade.scene.model import DirectionalLight, Light, Material, Mesh, PointLight, Scene, SpotLight

COLUMNS, ROWS = 20, 12  # pixels of 1 x 1; they fill no whole number of tiles
PIXELS = COLUMNS * ROWS
MATTE, TILTED = 5, 3  # columns on the left that reflect nothing, and on the right with tilted normals
CAMERA = Camera((0, 5, 0), (0, 0, 0), (0, 0, -1), 1.0, (ROWS, COLUMNS), (COLUMNS, ROWS), orthographic=True)
DOWN, UP = DirectionalLight((0, -1, 0)), DirectionalLight((0, 1, 0))
DARK = PointLight((0, 9, 0), (0, 0, 0))
ELSEWHERE = SpotLight((0, 9, 0), (0, 1, 0), (1, 1, 1), 10.0, 20.0)  # behind the tilted normals, which is found first
UNDER = DirectionalLight((-1, 0.05, 0))  # before the tilted normals, but behind their faces
GRAZING = DirectionalLight((0.5, -0.85, 0))  # before both, but N.L = 0.11 is less than what the normals are tilted by
COVERED = 7 * 0.5 / 0.85  # the triangle hides the last one from x below


def strip(left: float, right: float, normal: tuple[float, ...], **fields: Any) -> Mesh:
    """Return a strip of the plane y = 0, of two triangles."""
    corners = np.array([[left, 0, -9], [left, 0, 9], [right, 0, 9], [right, 0, -9]], float)
    normals = np.tile(np.array(normal) / np.linalg.norm(normal), (4, 1))
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], normals=normals, material=Material(ka=0.1, **fields))


def scene_of(*lights: Light) -> Scene:
    """Return a plane that fills the image, below a triangle behind the eye that covers x < 0."""
    over = Mesh(np.array([[0, 7, -900], [0, 7, 900], [-900, 7, 0]], float), [[0, 1, 2]], material=Material())
    edges = (-30.0, MATTE - COLUMNS / 2, COLUMNS / 2 - TILTED, 30.0)
    strips = (
        strip(edges[0], edges[1], (0, 1, 0), kd=0.0, ks=0.0),
        strip(edges[1], edges[2], (0, 1, 0), kd=0.5, ks=0.5),
        strip(edges[2], edges[3], (4, 3, 0), kd=0.5, ks=0.5),
    )
    return Scene((over, *strips), CAMERA, lights)


def counted(device, scene: Scene, **options: Any) -> tuple[Frame, ShadowCounts]:
    """Return a frame and its counts, and assert what holds for any."""
    options = {"shadows": True, "shader": "phong", **options}
    with Renderer(scene, device=device, **options) as renderer:
        plain = renderer.render()
    with CountingRenderer(scene, device=device, **options) as renderer:
        frame, counts = renderer.count()
        assert renderer.count()[1] == counts  # not the sum of both frames
    assert same_bits(frame, plain)
    if options["shadows"]:
        assert counts.possible == sum(counts.skipped.values()) + counts.traced
    assert counts.stats()["possible"] == counts.possible
    assert counts.hidden <= counts.traced
    assert counts.lit_packets + counts.dark_packets <= counts.packets <= counts.traced + counts.occlusion
    return frame, counts


FLAT = PIXELS - ROWS * (MATTE + TILTED)
OF_LIGHTS: dict[str, tuple[tuple[Light, ...], dict[str, int]]] = {
    "down": ((DOWN,), {"reflects_nothing": ROWS * MATTE, "traced": FLAT + ROWS * TILTED, "hidden": ROWS * 5}),
    "behind": ((UP,), {"facing_away": PIXELS}),
    "elsewhere": ((ELSEWHERE,), {"facing_away": ROWS * TILTED, "out_of_reach": PIXELS - ROWS * TILTED}),
    "under": ((UNDER,), {"facing_away": PIXELS - ROWS * TILTED, "behind_face": ROWS * TILTED}),
    "grazing": (
        (GRAZING,),
        {
            "reflects_nothing": ROWS * MATTE,
            "terminator": ROWS * TILTED,
            "traced": FLAT,
            "hidden": ROWS * sum(x + 0.5 < COVERED for x in range(MATTE - COLUMNS // 2, COLUMNS // 2 - TILTED)),
        },
    ),
    "dark": ((UP, DARK), {"facing_away": PIXELS, "dark_light": PIXELS}),
}


@pytest.mark.long
@pytest.mark.parametrize("name", OF_LIGHTS)
def test_every_ray_is_skipped_for_a_reason_or_traced(device, name):
    lights, expected = OF_LIGHTS[name]
    counts = counted(device, scene_of(*lights))[1]
    assert (counts.places, counts.lights, counts.points) == (PIXELS, len(lights), len(lights))
    assert {**counts.skipped, "traced": counts.traced, "hidden": counts.hidden} == {
        **dict.fromkeys((*SKIPPED, "traced", "hidden"), 0),
        **expected,
    }


def test_the_counts_of_lights_add_up(device):
    lights = tuple(dict.fromkeys(light for lights, _ in OF_LIGHTS.values() for light in lights))
    counts = counted(device, scene_of(*lights))[1]
    once = [expected for name, (_, expected) in OF_LIGHTS.items() if name != "dark"]
    assert counts.possible == 6 * PIXELS
    for name in SKIPPED:
        assert counts.skipped[name] == (PIXELS if name == "dark_light" else sum(each.get(name, 0) for each in once))
    assert counts.traced == sum(each.get("traced", 0) for each in once)
    assert counts.hidden == sum(each.get("hidden", 0) for each in once)


def test_packets_that_are_wholly_lit_or_dark(device):
    """Of blocks of 4 x 4 pixels: a column of them is matte, one hidden, one half hidden, two lit."""
    counts = counted(device, scene_of(DOWN))[1]
    blocks = ROWS // 4
    if device.lanes == 16:
        assert (counts.packets, counts.lit_packets, counts.dark_packets) == (4 * blocks, 2 * blocks, blocks)
    assert counts.filtered >= counts.packets - counts.lit_packets > 0
    assert counts.decided == 0  # no ray comes near the triangle's border
    edge = scene_of(DirectionalLight((0.5, -7.0, 0)))  # rays of pixels meet the triangle's side
    assert counted(device, edge)[1].decided > 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "places"),
    [
        ({"shader": "gouraud"}, 3 * 6),  # three corners of each triangle in view
        ({"preset": "pbr", "shader": "pbr"}, PIXELS),
        ({"samples": 4, "sample_shading": True}, 4 * PIXELS),
        ({"precision": "float64"}, PIXELS),
        ({"lanes": 1}, PIXELS),
        ({"lanes": 4}, PIXELS),
    ],
    ids=str,
)
def test_sums_with_other_kernels(device, options, places):
    counts = counted(device, scene_of(DOWN, UP, DARK, ELSEWHERE, UNDER, GRAZING), **options)[1]
    assert counts.places == places
    assert counts.skipped["facing_away"] > 0
    assert counts.traced > counts.hidden > 0


@pytest.mark.long
@pytest.mark.parametrize("shadows", [False, True])
def test_rays_of_ambient_occlusion(device, shadows):
    """A wide roof stops them all where they may be as long as it is high, none where they may not."""
    scene = scene_of(DOWN)
    roof = strip(-3000.0, 3000.0, (0, -1, 0))
    roof = replace(roof, verts=roof.verts * (1, 1, 1000) + (0, 6, 0))
    scene = replace(scene, meshes=(*scene.meshes, roof))
    for distance, least in ((5.0, 0), (1e6, 5 * PIXELS - 1)):  # one leads along the plane
        counts = counted(device, scene, shadows=shadows, ambient_occlusion=5, ao_distance=distance)[1]
        assert counts.occlusion == 5 * PIXELS
        assert least <= counts.occluded <= (least and 5 * PIXELS)
        assert counts.possible == (PIXELS if shadows else 0)


@pytest.mark.long
def test_points_of_lights_of_finite_size(device):
    scene = scene_of(PointLight((0, 90, 0), radius=2.0), PointLight((0, 9, 0), (0, 0, 0), radius=1.0), DOWN)
    counts = counted(device, scene, light_samples=5)[1]
    assert (counts.points, counts.possible) == (11, 11 * PIXELS)
    assert counts.skipped["dark_light"] == 5 * PIXELS
    assert counts.skipped["reflects_nothing"] == 6 * ROWS * MATTE
    assert counts.lit_packets + counts.dark_packets > 0


def test_counts_have_64_bits(device):
    text = """
    #define SHADOW_COUNTS
    #include "shadow_counts.clh"
    kernel void add(global const uint *amounts, global uint *count)
    {
        add_count(count, amounts[get_global_id(0)]);
    }
    """
    amounts = np.random.default_rng(1).integers(2**32, size=64, dtype=np.uint32)
    amounts[:3] = 0
    low, high = Probe(device, text, lanes=1)("add", amounts, dtype=np.uint32)[:2].tolist()
    assert low + (high << 32) == amounts.sum(dtype=np.uint64) > 2**35
