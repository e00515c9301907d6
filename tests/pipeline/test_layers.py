"""The layers of a frame: in closed form and against each other; layers that are not requested cost nothing."""

from dataclasses import replace

import numpy as np
import oracle_asserts
import pytest
from devices import needs_float64, rendered
from layer_scenes import CAMERA, CHECKERS, dome, mixed, wedge

import clshade
from clshade import oracle
from clshade.images.layers import LAYER_TABLE
from clshade.measure.check import layer_bounds
from clshade.pipeline.frame import Frame
from clshade.pipeline.layers import material_numbers
from clshade.scene.contents import first_instances
from clshade.scene.model import Material, Mesh, Scene, Settings

LAYERS = Settings(layers="all").layers  # of a scene without scalars and ambient occlusion


def draw(device, scene: Scene, preset: str = "standard", **options) -> Frame:
    return rendered(scene, device=device, preset=preset, **{"layers": "all", **options})


def test_corners_and_weights_give_the_other_layers(device):
    """As a user would do: interpolate attributes of the mesh's own corners, also under a mirroring placement."""
    mesh = dome()
    frame = draw(device, Scene((mesh,), CAMERA))
    shown = np.nonzero(frame["id"])
    placement, face = np.divmod(frame["id"][shown].astype(int) - 1, len(mesh.faces))
    weights = frame["barycentrics"][shown].astype(np.float64)
    assert set(placement) == {0, 1, 2}
    assert np.abs(weights.sum(axis=1) - 1).max() <= 2.0**-22
    uv = np.einsum("kc,kcd->kd", weights, mesh.uvs[mesh.uv_faces[face]])
    assert np.abs(uv - frame["uv"][shown]).max() <= 2.0**-18  # coordinates up to 10.5
    matrices = np.asarray(mesh.instances)[placement]
    corners = np.einsum("kde,kce->kcd", matrices[:, :3, :3], mesh.verts[mesh.faces[face]]) + matrices[:, None, :3, 3]
    assert np.abs(np.einsum("kc,kcd->kd", weights, corners) - frame["P"][shown]).max() <= 2.0**-20


def test_albedo_is_the_image_without_light(device):
    frame, unlit = draw(device, mixed()), draw(device, mixed(), shader="nolight", layers=())
    assert np.array_equal(frame["albedo"].view("u4"), unlit.rgb.copy().view("u4"))


@pytest.mark.long
def test_positions_far_from_the_origin(device):
    """Float64: a scene moved by 2^30 has the same image; float32 values are 64 apart there."""
    needs_float64(device)
    there = np.array([2.0**30, -(2.0**31), 2.0**30])
    verts = wedge().verts.astype(np.float64) + there
    camera = replace(CAMERA, eye=CAMERA.eye * 16 // 1 / 16, lookat=CAMERA.lookat * 16 // 1 / 16)
    away = replace(camera, eye=camera.eye + there, lookat=camera.lookat + there)
    near, far = (
        draw(device, Scene(replace(wedge(), verts=verts - by), view), layers=("P", "id"))
        for by, view in ((there, camera), (0.0, away))
    )
    assert np.array_equal(near["id"], far["id"])
    shown = far["id"] > 0
    assert shown.any()
    # float64 has steps of 2^-22 there.
    assert np.abs(far["P"][shown] - there - near["P"][shown]).max() <= 2.0**-21


def test_layers_that_are_not_asked_for_change_nothing_and_are_not_computed(device):
    scene = Scene((dome(), wedge()), CAMERA, background=None)
    together = draw(device, scene)
    assert "surface_layers" in together.stats["times_ms"]
    for names in (*((name,) for name in LAYERS), ("Z", "id"), ()):
        frame = draw(device, scene, layers=names)
        assert frame.layers == names
        assert np.array_equal(frame.rgba.view("u4"), together.rgba.view("u4"))
        assert all(frame[name].tobytes() == together[name].tobytes() for name in names)
    assert not {"surface_layers", "layer_object_id"} & set(frame.stats["times_ms"])


# Object and material numbers


def test_instances_are_counted_through_the_meshes():
    scene = mixed()
    assert first_instances(scene) == [1, 2, 3, 6, 7]
    numbers = oracle.layers.instance_numbers(scene)
    assert numbers.tolist() == [1] * 2 + [3] * 14 + [4] * 14 + [5] * 14 + [6] * 3 + [7]
    assert first_instances(replace(scene, meshes=())) == []


def test_instances_that_a_uint32_cannot_count_are_refused():
    many = Mesh(np.zeros((1, 3)), np.zeros((0, 3), int), instances=np.tile(np.eye(4), (1 << 14, 1, 1)))
    scene = Scene((*[many] * ((1 << 18) - 1), wedge()), CAMERA)
    assert first_instances(scene)[-1] == (1 << 32) - (1 << 14) + 1
    message = "render: scene: expected at most 4294967295 instances with the layer instance_id, found 4294967297"
    with pytest.raises(clshade.errors.InputError, match=message):
        first_instances(replace(scene, meshes=(*[many] * (1 << 18), wedge())))


def test_equal_materials_share_a_number():
    red, checkered = Material(color=(1, 0, 0)), Material(color=(1, 0, 0), texture=CHECKERS)
    copy = replace(CHECKERS, image=np.array(CHECKERS.image))
    materials = [red, Material(color=(1, 0, 0)), checkered, replace(checkered, texture=copy)]
    materials += [replace(checkered, kd=0.7), replace(red, name="r"), red]
    scene = Scene([replace(wedge(), material=material) for material in materials], CAMERA)
    assert material_numbers(scene) == (1, 1, 2, 2, 3, 4, 1)
    assert tuple(oracle.layers.material_numbers(scene)) == material_numbers(scene)
    assert material_numbers(replace(scene, meshes=())) == ()


def test_all_is_every_layer():
    assert Settings(layers="all").layers == Settings(layers=("uv", "all")).layers == LAYERS
    assert Settings(layers=("uv", "N", "Z")).layers == ("Z", "N", "uv")


@pytest.mark.parametrize("name", [name for name in LAYERS if name not in ("Z", "id")])
def test_an_error_of_a_layer_is_noticed(opened, name):
    """One pixel off by ten times the bound, or by one number."""
    frame = draw(opened, mixed())
    expected = oracle.render_layers(frame.scene, frame.settings)
    oracle_asserts.assert_layers(frame, expected, frame.scene, frame.settings)
    row, column = np.argwhere(frame["object_id"] == 3)[7]
    value = frame[name][row, column]
    if LAYER_TABLE[name].kind == "uint32":
        frame[name][row, column] += 1
    else:
        bound = {**layer_bounds.layer_bounds(expected, frame.scene, frame.settings), "albedo": np.full((48, 64), 4e-6)}
        assert bound[name][row, column] < 1e-3
        frame[name][row, column] = value + np.float32(10 * bound[name][row, column])
    with pytest.raises(AssertionError, match=f"{name} differs: 1 of"):
        oracle_asserts.assert_layers(frame, expected, frame.scene, frame.settings)
