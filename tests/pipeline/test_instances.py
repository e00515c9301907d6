"""Instances drawn from one copy of their mesh: the same bits as copies, in less memory."""

from dataclasses import replace

import numpy as np
import pytest
from devices import needs_float64, rendered
from layer_scenes import crowd, matrices

import clshade
from clshade import Camera, Mesh, PointLight, Scene
from clshade.oracle.transform import unit
from clshade.pipeline import buffers, placements, scene_tables, triangle_source
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.renderer import Renderer
from clshade.scene.model import Settings

COUNTS = ("triangles", "vertices", "visible", "behind", "off_screen", "between_samples", "zero_area", "clipped")
LAYERS = Settings(layers="all").layers


def assert_alike(frames: list[Frame]) -> None:
    copies, *instanced_frames = frames
    for frame in instanced_frames:
        assert same_bits(copies, frame)
        assert {name: frame.stats[name] for name in COUNTS} == {name: copies.stats[name] for name in COUNTS}


def test_the_same_image_layers_and_counts_as_from_copies(device, monkeypatch):
    """Textures, colors, two-sided faces, mirrored placements, meshes with a single instance, clipped faces.

    Blocks of few vertices and room for few triangles at first; cameras that see much, nothing, little, and much again, one
    by one and all in a row; last with device memory that is copied, as on a GPU.
    """
    needs_float64(device)
    scene, eye = crowd(), np.array((0.3, 0.4, 3.0))
    away, narrow = (replace(scene.camera, eye=eye + (0, 0, back), lookat=eye + (0, 0, 99)) for back in (90, 0))
    cameras = [scene.camera, away, replace(narrow, focal=50.0), scene.camera]
    options = {"device": device, "layers": LAYERS}
    with Renderer(scene, **options) as renderer:
        expected = [renderer.render(camera) for camera in cameras]
    small = {"_LEAST_ROOM": 5, "_ROOM_A_PIXEL": 0, "_ROOM_A_PIXEL_OF_GPU": 0, "_BLOCK": 100, "_BLOCK_OF_GPU": 100}
    for name, value in {"LEAST_COPIES": 0, **small}.items():
        monkeypatch.setattr(triangle_source, name, value)
    for is_copied in (False, True):
        if is_copied:
            monkeypatch.setattr(buffers, "_coherent", lambda *_: False)
        with Renderer(scene, **options) as renderer:
            views = renderer.render_many(cameras)
            frames = [renderer.render(camera) for camera in cameras]
        assert views.stats["triangles"] == scene.face_count
        for k, (frame, reference) in enumerate(zip(frames, expected, strict=True)):
            assert_alike([reference, frame])
            assert np.array_equal(views.rgba[k], reference.rgba)
            assert all(np.array_equal(views[name][k], reference[name]) for name in LAYERS)
    stats = frames[0].stats
    assert "INSTANCES" in stats["features"]
    assert all(stats[name] > 0 for name in ("behind", "off_screen", "clipped", "between_samples"))
    assert stats["visible"] > 100
    assert frames[1].stats["visible"] == 0
    assert expected[0].stats["bytes"]["scene"] > 2 * stats["bytes"]["scene"]


def test_other_scenes_keep_copies():
    scene = crowd(300)

    def of(threshold: int, drawn_scene: Scene = scene, forced: tuple[str, ...] = (), **fields: object) -> bool:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(triangle_source, "LEAST_COPIES", threshold)
            return triangle_source.draws_from_one_copy(drawn_scene, Settings(**fields), forced)

    many = (300 - 1) * 14 + (20 - 1) * 3
    assert of(many)
    assert not of(many + 1)
    assert of(many, layers=LAYERS)
    assert not any(of(many, **options) for options in ({"shadows": True}, {"ambient_occlusion": 1}))
    assert not of(many, edges=clshade.Edges("all"))
    assert not of(many, forced=("SHADOWS",))
    assert not of(1, replace(scene, meshes=[replace(mesh, instances=None) for mesh in scene.meshes]))
    assert scene_tables.pack(scene, Settings(), has_fp64=False).instances is None


@pytest.mark.long
def test_a_hundred_thousand_instances_are_one_unrolled_mesh(device):
    """Of 20 triangles each; shown with their own colors."""
    needs_float64(device)
    (ball,) = clshade.builtin("icosphere", level=0).meshes
    rng = np.random.default_rng(6)
    placed = matrices(100_000, rng, reach=20.0, size=0.1)
    camera = Camera((0, 0, 60), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (64, 64))
    options = {"device": device, "shader": "nolight", "layers": ("Z", "id", "P")}
    colors = rng.uniform(size=ball.verts.shape)
    frame = rendered(Scene([replace(ball, colors=colors, instances=placed)], camera), **options)
    turned = np.stack([ball.faces, ball.faces[:, [0, 2, 1]]])[placements.mirroring(placed).astype(int)]
    faces = turned + len(ball.verts) * np.arange(len(placed))[:, None, None]
    verts = placements.placed_points(ball.verts, placed)
    unrolled = Mesh(verts, faces.reshape(-1, 3), colors=np.tile(colors, (len(placed), 1)), material=ball.material)
    expected = rendered(Scene([unrolled], camera), **options)
    assert_alike([expected, frame])
    assert "INSTANCES" in frame.stats["features"]
    assert frame.stats["bytes"]["scene"] < expected.stats["bytes"]["scene"] / 3


def test_normals_beyond_the_vertices():
    """The normals of the following meshes are not shifted."""
    corners, up = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0.0, 0, 1]])
    first = Mesh(corners, [[0, 1, 2]], normals=np.repeat(up, 9, axis=0))
    second = Mesh(corners - [1.0, 1, 0], [[0, 1, 2]], normals=np.array([[0.0, 1, 1], [0, 0, 1], [1, 0, 1]]))
    camera, light = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (9, 7)), PointLight((0.0, 1, 2))
    packed = scene_tables.pack(Scene((first, second), camera, light), Settings()).arrays["normals"]
    assert packed.shape == (6, 4)
    assert packed[3:, :3] == pytest.approx(unit(second.normals))
