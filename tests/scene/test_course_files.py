"""Course .npy files: layouts, options, and writing them back. What is refused: test_refused_files.py."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scene_files import course_dict, refusal, same, save_npy, transposed

from clshade.errors import InputError
from clshade.scene.formats.course_npy import save_course
from clshade.scene.formats.load import load
from clshade.scene.model import Camera, Material, Mesh, PointLight, Scene, Texture

POSITIONS, INTENSITIES = [[0, 0, 5], [1, 2, 3]], [[1, 1, 1], [1, 0.5, 0.25]]


def test_every_field_arrives(tmp_path):
    content = course_dict()
    mesh = Mesh(
        *(content["verts"].T, [[0, 1, 2], [1, 3, 2]], content["vertex_colors"].T),
        uvs=content["uvs"].T,
        uv_faces=[[0, 1, 2], [1, 2, 0]],
        material=Material(0.1, 0.8, 0.5, 7),
        name="cat",
    )
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 2.0, (3.0, 4.0), (64, 48))
    lights = tuple(map(PointLight, POSITIONS, INTENSITIES))
    scene = load(save_npy(tmp_path / "cat.npy", content))
    assert scene.meshes[0].verts.dtype == np.float32
    assert same(scene, Scene((mesh,), camera, lights, [0.2, 0.3, 0.4], [1.0, 0.9, 0.8], "course", "cat"))


@pytest.mark.parametrize(
    "content",
    [
        transposed(course_dict()),
        course_dict(
            verts=course_dict()["verts"].astype(">f4"),
            face_indices=course_dict()["face_indices"].astype(">u2"),
            vertex_colors=np.asfortranarray(course_dict()["vertex_colors"]),
        ),
        course_dict(kd=np.array(0.8), M=np.array(48)),
        course_dict(light_positions=np.array(POSITIONS), light_intensities=np.array(INTENSITIES)),
        course_dict(light_positions=POSITIONS, light_intensities=[tuple(row) for row in INTENSITIES]),
        course_dict(
            light_positions=[np.array([[0, 0, 5.0]]), np.array([[1, 2, 3.0]])],
            light_intensities=[np.ones((3, 1)), np.array([[1], [0.5], [0.25]])],
        ),
    ],
)
def test_other_forms_of_the_same_scene(tmp_path, content):
    """Nx3 or 3xN, any type and order of bytes and numbers, lights as rows or a list."""
    assert same(load(save_npy(tmp_path / "a.npy", content)), load(save_npy(tmp_path / "a.npy", course_dict())))


def test_square_arrays_follow_the_others(tmp_path):
    square = np.arange(9, dtype=np.float64).reshape(3, 3)
    plain = {"verts": square, "vertex_colors": square, "uvs": None, "face_uv_indices": None}
    for faces in ([[0, 1], [1, 2], [2, 0]], [[0, 1, 2]], [[0, 1, 2], [1, 2, 0], [2, 2, 1]]):
        columns = len(faces) == 3
        mesh = load(save_npy(tmp_path / "a.npy", course_dict(**plain, face_indices=np.array(faces)))).meshes[0]
        assert np.array_equal(mesh.verts, square.T if columns else square)
        assert mesh.faces.tolist() == (np.transpose(faces) if columns else np.array(faces)).tolist()


def test_three_lights_are_still_rows_and_none_are_none(tmp_path):
    positions = np.arange(9.0).reshape(3, 3)
    scene = load(save_npy(tmp_path / "a.npy", course_dict(light_positions=positions, light_intensities=positions)))
    assert [light.position.tolist() for light in scene.lights] == positions.tolist()
    for none in ([], np.zeros((0, 3)), np.zeros(0)):
        content = course_dict(light_positions=none, light_intensities=[])
        assert load(save_npy(tmp_path / "a.npy", content)).lights == ()


def test_options(tmp_path):
    path = save_npy(tmp_path / "a.npy", course_dict(focal=None))
    assert load(path, focal=70).camera.focal == 70.0
    path = save_npy(tmp_path / "b.npy", course_dict())
    scene = load(path, focal=7.5, resolution=(100, 50), lights=[1])
    assert (scene.camera.focal, scene.camera.plane, scene.camera.resolution) == (7.5, (3.0, 6.0), (100, 50))
    assert [light.position.tolist() for light in scene.lights] == [[1, 2, 3]]
    refusal(path, "load: focal: ", focal=-1)


def test_texture(tmp_path):
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    Image.fromarray(pixels).save(tmp_path / "image.png")
    path = save_npy(tmp_path / "a.npy", course_dict())
    texture = load(path, texture=tmp_path / "image.png").meshes[0].material.texture
    assert (texture.lookup, texture.name) == ("course", "image.png")
    assert np.array_equal(texture.image, (pixels / 255).astype(np.float32))
    assert np.array_equal(load(path, texture=pixels).meshes[0].material.texture.image, texture.image)
    refusal(path, "a.npy: Texture: image: ", texture=pixels[:, :, 0])
    refusal(path, "none.png: file: ", "no such file", texture=tmp_path / "none.png")


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_saving_and_loading_keeps_every_bit(tmp_path, dtype):
    rng = np.random.default_rng(5)
    content = course_dict(verts=rng.standard_normal((3, 4)).astype(dtype), ka=rng.random(3), n=0.3, focal=1 / 3)
    scene = load(save_npy(tmp_path / "a.npy", content))
    path = tmp_path / "a.npy"
    save_course(scene, path)
    assert same(load(path), scene)
    plain = np.load(path, allow_pickle=True).item()  # as the course reads it
    assert plain["verts"].shape == (3, 4)
    assert plain["face_indices"].dtype == np.int64
    assert all(item.flags.c_contiguous for item in plain.values() if isinstance(item, np.ndarray))
    save_course(load(path), tmp_path / "c.npy")
    assert (tmp_path / "c.npy").read_bytes() == path.read_bytes()


def test_saving_a_square_scene_and_one_without_lights_or_colors(tmp_path):
    scene = load(save_npy(tmp_path / "a.npy", course_dict()))
    triangle = Mesh(np.arange(9.0).reshape(3, 3), [[0, 1, 2], [2, 1, 0], [0, 0, 1]], material=scene.meshes[0].material)
    save_course(replace(scene, meshes=(triangle,), lights=()), tmp_path / "b.npy")
    again = load(tmp_path / "b.npy")
    assert np.array_equal(again.meshes[0].verts, triangle.verts)
    assert np.array_equal(again.meshes[0].faces, triangle.faces)
    assert (again.meshes[0].colors == 1).all()
    assert again.lights == ()


def test_saving_refuses_what_the_file_cannot_hold(tmp_path):
    scene = load(save_npy(tmp_path / "a.npy", course_dict()))
    mesh = scene.meshes[0]
    textured = replace(mesh.material, texture=Texture(np.zeros((1, 1, 3))))
    for name, variant in {
        "preset": replace(scene, preset="standard"),
        "scene.meshes": replace(scene, meshes=(mesh, mesh)),
        "background": replace(scene, background=None),
        "instances": replace(scene, meshes=(replace(mesh, instances=np.stack([np.eye(4)] * 2)),)),
        "normals": replace(scene, meshes=(replace(mesh, normals=np.ones((4, 3))),)),
        "texture": replace(scene, meshes=(replace(mesh, material=textured),)),
    }.items():
        with pytest.raises(InputError, match=f"save_course: .*{name}.*expected"):
            save_course(variant, tmp_path / "no.npy")
    with pytest.raises(InputError, match=r"ending in \.npy"):
        save_course(scene, tmp_path / "no.txt")
    assert os.listdir(tmp_path) == ["a.npy"]
