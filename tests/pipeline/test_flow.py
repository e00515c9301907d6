"""Optical flow: closed forms, what is hidden, and the float64 oracle."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from layer_scenes import at, mixed, square
from random_scenes import scene_of

import clshade
from clshade.cli.main import main
from clshade.errors import InputError
from clshade.farm import read_cameras
from clshade.measure.check.flow_bounds import flow_errors
from clshade.pipeline.frame import Frame
from clshade.pipeline.frame_results import Flow
from clshade.scene.camera import Camera
from clshade.scene.geometry import in_image, pixel_rays
from clshade.scene.model import Material, Mesh, Scene

HALF_ULP = 2.0**-24  # of float32, relative
CAMERA = Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (0.75, 1.0), (64, 48))
PARALLEL = replace(CAMERA, plane=(3.0, 4.0), orthographic=True)
PLAIN = {"shader": "nolight", "layers": "id"}


def centers(frame: Frame) -> np.ndarray:
    """Return the pixels' centers (M, N, 2), to the right and down."""
    rows, columns = frame.alpha.shape
    return np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1)


def draw(device, *meshes: Mesh, camera: Camera = CAMERA, **options) -> Frame:
    return clshade.render(Scene(meshes, camera), device=device, **{**PLAIN, **options})


def assert_oracles(frame: Frame, flow: Flow) -> None:
    where = np.divmod(np.arange(frame.alpha.size), frame.alpha.shape[1])
    errors, wrong = flow_errors(flow, frame.scene, frame.settings, frame["id"][where], where)
    assert errors.max() <= 1.0
    assert not wrong.any()


# Closed forms


def test_a_camera_that_moves_along_a_plane(opened):
    """Distance 4, 64 px for a width of 1 at distance 1: 16 px for each unit to the side, the other way; y is down."""
    for camera in (CAMERA, PARALLEL):
        frame = draw(opened, square(), camera=camera)
        moved = replace(camera, eye=camera.eye + (0.25, 0.125, 0), lookat=camera.lookat + (0.25, 0.125, 0))
        flow = clshade.flow(frame, moved, device=opened)
        shown = frame["id"] > 0
        assert flow.vectors.dtype == np.float32
        assert np.abs(flow.vectors[shown] - [-4.0, 2.0]).max() <= 4.0 * HALF_ULP
        assert np.isnan(flow.vectors[~shown]).all()
        assert np.array_equal(flow.occluded, ~shown)
        assert_oracles(frame, flow)


def test_a_moved_instance(opened):
    """One of two placements moves to the side and away from the camera, the other not at all."""
    placed, gone = np.stack([at(-0.8, 0, 0), at(0.8, 0, 0)]), np.stack([at(-0.8, 0, 0), at(1.6, 0, -4.0)])
    mesh = square(0.5, instances=placed)
    frame = draw(opened, mesh, layers=("id", "instance_id"))
    flow = clshade.flow(frame, replace(frame.scene, meshes=(replace(mesh, instances=gone),)), device=opened)
    still, moving = frame["instance_id"] == 1, frame["instance_id"] == 2
    assert (still.sum(), moving.sum()) == (256, 256)
    assert (flow.vectors[still] == 0.0).all()
    points = (centers(frame)[moving] - (32, 24)) / 16  # in the plane of the square, y down
    expected = 8.0 * (points + (0.8, 0.0)) - 16.0 * points  # twice as far away: 8 px for each unit
    assert np.abs(flow.vectors[moving] - expected).max() <= 16.0 * HALF_ULP
    assert not flow.occluded[still | moving].any()
    assert_oracles(frame, flow)


def test_nothing_moves(opened):
    """Exactly 0, at slivers and clipped faces too, and with several samples."""
    frame = clshade.render(mixed(), device=opened, samples=3, **PLAIN)
    shown = frame["id"] > 0
    flow = clshade.flow(frame, frame, device=opened)
    assert (flow.vectors[shown] == 0.0).all()
    # Snapping moves edges by up to 1/131072 px: here none crosses a sample, which would see what is hidden from it.
    assert not flow.occluded[shown].any()
    assert_oracles(frame, flow)


# What is hidden


def test_what_a_square_hides(opened):
    """A square behind another, which the camera's way to the side moves by twice as much: a strip is hidden, as wide."""
    frame = draw(opened, square(3.0, -4.0), square(0.5, 2.0), layers=("id", "object_id"))
    flow = clshade.flow(frame, replace(CAMERA, eye=(0.25, 0, 4.0), lookat=(0.25, 0, 0)), device=opened)
    front, behind = frame["object_id"] == 2, frame["object_id"] == 1
    assert np.abs(flow.vectors[front] - [-8.0, 0.0]).max() <= 8.0 * HALF_ULP
    assert np.abs(flow.vectors[behind] - [-2.0, 0.0]).max() <= 8.0 * HALF_ULP
    x, y = np.moveaxis(centers(frame), -1, 0)
    # In the other image the square before it has x from 8 to 40, y from 8 to 40; what is behind it moves by 2.
    hidden = behind & (x - 2 > 8) & (x - 2 < 40) & (y > 8) & (y < 40)
    assert np.array_equal(flow.occluded, hidden | ~(front | behind))
    assert hidden.any()
    assert_oracles(frame, flow)


def test_a_side_that_is_not_drawn_is_occluded(opened):
    """From behind, a square of which only the front is drawn; one of both sides is seen."""
    behind = replace(CAMERA, eye=(0, 0, -4.0))
    for sides in ("both", "front"):
        frame = draw(opened, square(material=Material(sides=sides)))
        flow = clshade.flow(frame, behind, device=opened)
        shown = frame["id"] > 0
        assert flow.occluded[shown].all() == (sides == "front")
        assert np.abs(flow.vectors - (2 * ((32, 24) - centers(frame)) * (1, 0)))[shown].max() <= 64 * HALF_ULP
        assert_oracles(frame, flow)


@pytest.mark.long
def test_a_square_that_is_not_drawn_hides_nothing(opened):
    """One whose back is culled, one through which layers look, and one nearer than the near plane."""
    far, turned = square(2.0, -4.0), np.diag([-1.0, 1.0, -1.0, 1.0]) @ at(0, 0, -4.0)
    away = draw(opened, far, square(0.5, 9.0))
    for near, options in (
        (square(0.5, 2.0, instances=[turned], material=Material(sides="front")), {}),
        (square(0.5, 2.0, material=Material(blend=True, opacity=0.25)), {}),
        (square(0.5, 3.5), {"near": 1.0}),
    ):
        moved = draw(opened, far, near, **options)
        assert set(np.unique(moved["id"])) <= {0, 1, 2}
        flow = clshade.flow(away, moved, device=opened)
        assert not flow.occluded[away["id"] > 0].any()
        assert_oracles(away, flow)


def test_what_is_behind_the_other_camera_has_no_vector(opened):
    frame = draw(opened, square(0.5), square(0.5, -6.0, instances=[at(2, 0, 0)]), layers=("id", "object_id"))
    flow = clshade.flow(frame, replace(CAMERA, eye=(0, 0, -1.0), lookat=(0, 0, -5.0)), device=opened)
    front = frame["object_id"] == 1
    assert np.isnan(flow.vectors[front]).all()
    assert flow.occluded[front].all()
    assert np.isfinite(flow.vectors[frame["object_id"] == 2]).all()
    assert_oracles(frame, flow)


@pytest.mark.long
def test_random_scenes_are_the_oracles(opened):
    """Of all sizes and places, with clipped faces and mirrored placements; the camera moves, and in half of them the
    meshes."""
    rng = np.random.default_rng(1)
    shown = hidden = 0
    for number in range(20):
        scene = scene_of(number).scene
        meshes = [
            Mesh(m.verts, m.faces, material=Material(sides=m.material.sides), instances=m.instances)
            for m in scene.meshes
        ]
        start = replace(scene.camera, resolution=(32, 24))
        frame = draw(opened, *meshes, camera=start, samples=(1, 4)[number % 2])
        reach = np.linalg.norm(start.lookat - start.eye)
        eye = start.eye + 0.1 * reach * rng.normal(size=3)
        end = replace(start, eye=eye, lookat=start.lookat + 0.05 * reach * rng.normal(size=3), resolution=(36, 28))
        if number % 4 < 2:
            moves = [at(*0.05 * reach * rng.normal(size=3)) for _ in meshes]
            meshes = [replace(mesh, instances=move @ mesh.instances) for mesh, move in zip(meshes, moves, strict=True)]
        flow = clshade.flow(frame, replace(frame.scene, meshes=tuple(meshes), camera=end), device=opened)
        assert_oracles(frame, flow)
        shown += (~flow.occluded).sum()
        hidden += flow.occluded[frame["id"] > 0].sum()
    assert min(shown, hidden) > 500


# Checks, files and refusals


@pytest.fixture(scope="module")
def frames(opened) -> tuple[Frame, Frame]:
    """Return frames of squares over a floor, of which one moves, as does the camera."""
    floor = Mesh([(-5, -1, -9), (5, -1, -9), (5, -1, 9), (-5, -1, 9)], [[0, 2, 1], [0, 3, 2]])
    block = square(0.7, instances=np.stack([at(-1, 0, 0), at(0.6, 0, 1)]))
    moved = replace(block, instances=np.stack([at(-1, 0, 0), at(0.1, 0.2, 0.8)]))
    first = replace(CAMERA, eye=(0.3, 0.8, 4.0))
    second = replace(CAMERA, eye=(-0.6, 1.0, 3.6), resolution=(60, 52))
    layers = {"layers": ("id", "instance_id")}
    return draw(opened, floor, block, camera=first, **layers), draw(opened, floor, moved, camera=second, **layers)


def test_check_looks_at_flows_and_instances(opened, frames):
    a, b = frames
    flow = clshade.flow(a, b, device=opened)
    vectors = flow.vectors + np.float32(1e-3)
    for claimed in (flow, replace(flow, vectors=vectors), replace(flow, occluded=~flow.occluded)):
        a.flows = {"flow": claimed}
        report = clshade.check(a, 500)
        assert report.passed == (0.0 < report.flow <= 1.0) == (claimed is flow)
        assert any("flow: " in line for line in report.lines())
    a.flows = {}
    assert clshade.check(a, "all").passed
    assert set(np.unique(a["instance_id"])) == {0, 1, 2, 3}
    row, column = np.argwhere(a["instance_id"] == 2)[5]
    a["instance_id"][row, column] = 3
    report = clshade.check(a, "all")
    assert (report.passed, report.wrong) == (False, 1)
    a["instance_id"][row, column] = 2


def test_files(opened, frames, tmp_path):
    """The EXR has both flows and their masks; a .flo file as its benchmark's readers expect."""
    a, b = frames
    there, back = clshade.flow(a, b, device=opened), clshade.flow(a, replace(CAMERA, eye=(1, 1, 4)), device=opened)
    a.flows = {"flow": there, "flow_back": back}
    a.save(tmp_path / "a", half=True)
    channels, _ = clshade.exr.read(tmp_path / "a.exr")
    for name, flow in a.flows.items():
        assert channels[f"{name}.X"].dtype == np.float32
        np.testing.assert_array_equal(np.stack([channels[f"{name}.X"], channels[f"{name}.Y"]], axis=-1), flow.vectors)
        assert np.array_equal(channels[f"{name}_occluded"], flow.occluded.astype(np.uint32))
    there.save(tmp_path / "a.flo")
    data = (tmp_path / "a.flo").read_bytes()
    assert data[:4] == b"PIEH"
    assert struct.unpack("<ii", data[4:12]) == (64, 48)
    values = np.frombuffer(data, "<f4", offset=12).reshape(48, 64, 2)
    has_vector = np.isfinite(there.vectors)
    assert np.array_equal(values[has_vector], there.vectors[has_vector])
    assert (values[~has_vector] > 1e9).all()
    with pytest.raises(InputError, match=r"Flow.save: path: expected a file name ending in \.flo, found"):
        there.save(tmp_path / "a.png")
    a.flows["motion"] = there
    with pytest.raises(InputError, match="Frame: flows: expected one of flow, flow_back, found 'motion'"):
        a.save(tmp_path / "b")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.flo", "a.png"]


@pytest.mark.long
def test_the_command_line_writes_flow(opened, tmp_path, capsys):
    camera = {"eye": [0.5, 0, 4], "lookat": [0.5, 0, 0]}
    (tmp_path / "c.json").write_text(json.dumps([camera, {**camera, "fov": 20}]))
    (tmp_path / "many.json").write_text(json.dumps([camera] * 3))
    command = ("render", "icosphere", "--resolution", "40,30", "--device", opened.index, "--shader", "nolight")
    assert main([*command, "--flow-to", str(tmp_path / "c.json"), "-o", str(tmp_path / "a")]) == 0
    channels, _ = clshade.exr.read(tmp_path / "a.exr")
    frame = clshade.render(clshade.builtin("icosphere"), device=opened, resolution=(40, 30), samples=4, **PLAIN)
    for name, target in zip(("flow", "flow_back"), read_cameras(tmp_path / "c.json", frame.scene.camera), strict=True):
        expected = clshade.flow(frame, target, device=opened)
        np.testing.assert_array_equal(channels[f"{name}.X"], expected.vectors[..., 0])
        np.testing.assert_array_equal(channels[f"{name}_occluded"] != 0, expected.occluded)
    capsys.readouterr()
    assert main([*command, "--flow-to", str(tmp_path / "many.json"), "-o", str(tmp_path / "b")]) == 2
    assert "--flow-to: expected one camera or two in" in capsys.readouterr().err
    assert not (tmp_path / "b.exr").exists()


AS_IN_FRAME = "as in the frame's scene"
TURNED = replace(square(), faces=[[1, 2, 0], [0, 2, 3]])


@pytest.mark.parametrize(
    ("meshes", "line"),
    [
        ((), f"flow: to: expected 1 meshes, {AS_IN_FRAME}, found 0"),
        (
            (square(instances=[np.eye(4)] * 2),),
            rf"flow: to: expected 2 faces and 1 instances of mesh 1, {AS_IN_FRAME}, found \(2, 2\)",
        ),
        ((TURNED,), f"flow: to: expected the faces of mesh 1 {AS_IN_FRAME}, which may move"),
    ],
)
def test_scenes_of_which_no_flow_is_known(opened, meshes, line):
    frame = draw(opened, square())
    with pytest.raises(InputError, match=line):
        clshade.flow(frame, replace(frame.scene, meshes=meshes), device=opened)
    with pytest.raises(InputError, match="flow: frame: expected a frame with the layer id"):
        clshade.flow(draw(opened, square(), layers="Z"), CAMERA, device=opened)


def test_flow_takes_any_number_of_pixels_and_none(opened):
    assert clshade.flow(draw(opened), CAMERA, device=opened).occluded.all()
    rays, _ = pixel_rays(CAMERA)
    places, depths = in_image(CAMERA, rays.reshape(-1, 3))
    assert np.allclose(places.reshape(48, 64, 2), np.stack(np.meshgrid(np.arange(64), np.arange(48)), -1) + 0.5)
    assert np.allclose(depths, 1.0)
