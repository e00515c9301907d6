"""Parts of an image: the bits of that part of the whole, however it is cut, also where no whole image can be drawn."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from devices import needs_float64, rendered

import clshade
from clshade import Camera, Mesh, Renderer, Scene
from clshade.errors import InputError
from clshade.pipeline.frame import Frame, same_bits
from clshade.scene.camera import MAX_WHOLE, part_of, raster_of, whole_camera
from clshade.scene.geometry import camera_axes

OPTIONS = {"shader": "nolight", "layers": ("Z", "id")}


def differing(part: Frame, image: Frame, left: int, top: int) -> list[str]:
    """Return the arrays of a part that differ in a bit from those of the whole."""
    columns, rows = part.scene.camera.resolution
    cut = np.s_[top : top + rows, left : left + columns]
    pairs = {"rgba": (part.rgba, image.rgba), **{name: (part[name], image[name]) for name in image.layers}}
    return [name for name, (a, b) in pairs.items() if a.tobytes() != np.ascontiguousarray(b[cut]).tobytes()]


def test_clipped_triangles_have_the_same_pieces_in_all_parts(device):
    """Of corners that lie up to 3,000 images away in all directions."""
    rng = np.random.default_rng(5)
    verts = rng.uniform(-3000.0, 3000.0, (120, 3))
    verts[:, 2] = rng.uniform(-1.0, 3.0, 120)
    camera = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (64, 48))
    scene = Scene((Mesh(verts, np.arange(120).reshape(-1, 3)),), camera)
    with Renderer(scene, device=device, **OPTIONS) as renderer:
        image = renderer.render()
        assert image.stats["clipped"] > 20
        for left, top in product(range(0, 64, 20), range(0, 48, 20)):
            part = part_of(camera, left, top, min(20, 64 - left), min(20, 48 - top))
            assert not differing(renderer.render(part), image, left, top), (left, top)


@pytest.mark.long
def test_devices_without_float64_project_alike(device):
    scene = clshade.builtin("icosphere", level=2, resolution=(50, 40))
    scene = replace(scene, camera=part_of(scene.camera, 13, 9, 20, 17))
    one, single = (rendered(scene, device=d, **OPTIONS) for d in (device, replace(device, has_fp64=False)))
    assert same_bits(single, one)


WHOLE = (100_000, 60_000)  # far more than can be drawn at once


def seen_at(place: tuple[float, float], camera: Camera) -> np.ndarray:
    """Return the point at a depth of 1 that a place in the image, pixels from its top left, shows."""
    columns, rows = camera.resolution
    x = (place[0] / columns - camera.principal[0]) * camera.plane[1] / camera.focal
    y = ((rows - place[1]) / rows - camera.principal[1]) * camera.plane[0] / camera.focal
    return camera.eye + np.array([x, y, 1.0]) @ camera_axes(camera)


@pytest.fixture(scope="module")
def speckled() -> Scene:
    """Small triangles about the corner where four regions of 16384 pixels meet, and one over all of the image."""
    base = Camera.from_fov((0.0, 0.0, 0.0), (0.3, 0.1, -1.0), (0.0, 1.0, 0.0), 50.0)
    full_camera = whole_camera(base, WHOLE)
    rng = np.random.default_rng(1)
    verts = [
        seen_at((2 * 16384 + x, 16384 + y), full_camera) * depth
        for x, y, depth in np.stack([*rng.uniform(-60, 60, (2, 300)), rng.uniform(0.9, 1.1, 300)], axis=1)
    ]
    verts += [20.0 * seen_at(at, full_camera) for at in ((-4e5, 9e4), (5e5, 9e4), (5e4, -9e5))]
    return Scene((Mesh(np.array(verts), np.arange(len(verts)).reshape(-1, 3)),), full_camera.with_resolution((100, 60)))


def part_near_the_corner(scene: Scene, left: int, top: int, columns: int, rows: int) -> Camera:
    return part_of(whole_camera(scene.camera, WHOLE), 2 * 16384 + left, 16384 + top, columns, rows)


def test_parts_of_larger_images_are_the_oracles_however_they_are_cut(device, speckled):
    """Each by a camera of its own lens, which rounds positions otherwise by 1e-11 px: none of these rounds to another
    1/65536 px. Across the seam a triangle has the same ids as if both sides had been drawn at once."""
    quadrants = (-60, -60), (0, -60), (-60, 0), (0, 0)
    with Renderer(speckled, device=device, **OPTIONS) as renderer:
        first = part_near_the_corner(speckled, -60, -60, 60, 60)
        plane = 2 * first.plane[0], 2 * first.plane[1]
        principal = tuple((p * 60 + shift) / 120 for p, shift in zip(first.principal, (0, 60), strict=True))
        lens = Camera(first.eye, first.lookat, first.up, first.focal, plane, (120, 120), principal)
        both = renderer.render(lens)
        for left, top in quadrants:
            image = renderer.render(part_near_the_corner(speckled, left, top, 60, 60))
            assert len(np.unique(image["id"])) > 15
            assert np.array_equal(image["id"], both["id"][top + 60 : top + 120, left + 60 : left + 120])
            assert clshade.check(image, pixels="all").passed
            for dx, dy, columns, rows in ((5, 7, 30, 41), (44, 0, 16, 60), (59, 59, 1, 1)):
                part = renderer.render(part_near_the_corner(speckled, left + dx, top + dy, columns, rows))
                assert not differing(part, image, dx, dy)


def test_a_part_has_the_lens_of_a_part():
    part = part_of(clshade.builtin("icosphere").camera, 10, 20, 30, 40)
    assert raster_of(replace(part, eye=(5, 5, 5))) == raster_of(part)
    with pytest.raises(InputError, match="PartCamera: plane, principal: expected those of `part_of`"):
        replace(part, principal=(0.5, 0.5))
    with pytest.raises(InputError, match="part_of: whole: expected the camera of a whole image"):
        part_of(part, 0, 0, 5, 5)


def test_sizes_of_parts_and_of_the_whole_are_checked():
    camera = clshade.builtin("icosphere").camera
    whole = whole_camera(camera, (20_000, 3_000))
    for field, part in (("left", (-1, 0, 5, 5)), ("top", (0, 2995, 5, 6)), ("left", (16_380, 0, 5, 5))):
        with pytest.raises(InputError, match=f"part_of: {field}: expected a part that ends within"):
            part_of(whole, *part)
    for resolution in ((0, 5), (MAX_WHOLE + 1, 5), "large"):
        with pytest.raises(InputError, match="whole_camera: resolution"):
            whole_camera(camera, resolution)


def test_lines_are_hidden_by_what_is_clipped_beside_a_part(device):
    """A wall of two triangles, whose seam lies just outside the part and one corner 40,000 pixels away, hides an edge
    near enough to the part to be drawn in it."""
    needs_float64(device)
    camera = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (48 / 64, 1.0), (64, 48))

    def at(column: float, row: float, depth: float) -> tuple[float, float, float]:
        return ((column / 64 - 0.5) * depth, (row / 48 - 0.5) * 48 / 64 * depth, 4 - depth)

    wall = Mesh([at(31.7, -40, 3), at(31.7, 90, 3), at(-40_000, 20, 3), at(90, 20, 3)], [(0, 1, 2), (0, 3, 1)])
    behind = Mesh([at(31, 5, 5), at(31, 40, 5), at(10, 20, 5)], [(0, 1, 2)])
    edges = clshade.Edges(kinds=("silhouette",), width=4.0)
    with Renderer(Scene((wall, behind), camera), device=device, shader="nolight", edges=edges, layers="id") as renderer:
        image = renderer.render()
        for left in (30, 31, 32):
            assert not differing(renderer.render(part_of(camera, left, 0, 64 - left, 48)), image, left, 0), left
