"""The fuzzers: random scenes against the oracle, damaged files against the loaders; and that they find planted faults.

For more than these run `python tests/fuzz/run.py --scenes 0:20000 --files 0:20000 --seed 1`.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from types import SimpleNamespace

import file_mutations
import numpy as np
import pytest
import scene_fuzzer
from file_mutations import file_failures
from random_kinds import BLOCK, KINDS, kind_of
from random_scenes import scene_of
from scene_fuzzer import scene_failures
from seed_files import samples

from clshade import oracle
from clshade.errors import InputError
from clshade.pipeline import scene_tables
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.lights import LIGHTS
from clshade.scene.model import Material, Mesh, Scene, Settings, SpotLight, Texture

CAMERA = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (9, 7))


# Scenes


@pytest.mark.long
def test_scenes(opened):
    """Half of the scenes of every fifth block: building the blocks' programs takes most of the time."""
    assert scene_failures(opened, [BLOCK * block + k for block in range(0, 20, 5) for k in range(0, BLOCK, 2)]) == []
    assert scene_failures(opened, range(1, BLOCK, 2)) == []


@pytest.mark.long
def test_scenes_on_other_devices(device, opened):
    """Four scenes of every other block of a thousand."""
    if device.index == opened.index:
        pytest.skip("the default device draws more of them")
    assert scene_failures(device, [BLOCK * block + k for block in range(1, 20, 2) for k in (2, 7, 19, 31)]) == []


@pytest.mark.long
def test_scenes_are_of_all_sorts():
    kinds = [kind_of(0, block) for block in range(KINDS)]
    for name in kinds[0].__dataclass_fields__:
        assert name == "settings" or len({getattr(kind, name) for kind in kinds}) > 1, name
    either = ("precision", "visibility", "lighting_at", "interpolation", "texture_at", "texture_filter", "cull")
    for name, expected in {"shader": 4, **dict.fromkeys(either, 2)}.items():
        assert len({getattr(kind.settings, name) for kind in kinds}) == expected, name
    drawn = [scene_of(number) for number in range(0, 50 * BLOCK, 10)]
    assert {1, 2, 16} < {case.settings.samples for case in drawn}
    assert 16 < max(case.settings.samples for case in drawn) <= 64
    assert min(min(case.scene.camera.resolution) for case in drawn) == 1
    lights = [light for case in drawn for light in case.scene.lights]
    assert {type(light) for light in lights} == set(LIGHTS)
    assert 90.0 in {light.outer_cone for light in lights if isinstance(light, SpotLight)}
    meshes = [mesh for case in drawn for mesh in case.scene.meshes]
    reach = [np.abs(mesh.verts).max(initial=0.0) for mesh in meshes]
    assert max(reach) > 1e20
    assert 0.0 < min(r for r in reach if r) < 1e-15
    assert {0.0, 1.0, 1e9} <= {mesh.material.n for mesh in meshes}


@pytest.mark.long
def test_even_numbers_are_stiffer():
    drawn = [scene_of(number).scene for number in range(0, 600, 2)]
    aspects = [scene.camera.plane[0] / scene.camera.plane[1] for scene in drawn]
    assert min(aspects) < 1e-3 < 1e3 < max(aspects)
    assert max(max(scene.camera.resolution) for scene in drawn if min(scene.camera.resolution) == 1) > 100
    meshes = [mesh for scene in drawn for mesh in scene.meshes]
    finite = [np.abs(mesh.uvs[np.isfinite(mesh.uvs)]) for mesh in meshes if mesh.uvs is not None]
    assert any(1e8 < uvs.max(initial=0.0) <= 1.0001e9 for uvs in finite)
    lengths = np.concatenate([np.abs(mesh.normals).max(axis=1) for mesh in meshes if mesh.normals is not None])
    assert lengths[lengths > 0].min() < 1e-25 < 1e25 < lengths.max()
    assert {np.linalg.matrix_rank(m[:3, :3]) for mesh in meshes for m in np.asarray(mesh.instances)} == {0, 1, 2, 3}
    places = np.array([scene.camera.principal for scene in drawn])
    assert places.min() < -2.0 < 3.0 < places.max()
    odd = [scene_of(number).scene.camera for number in range(1, 600, 2)]
    assert max(max(camera.principal) for camera in odd) < 1.31


@pytest.mark.long
def test_a_block_shares_its_program():
    """Or two: a rare scene may need fewer features, for example if all colors of a mesh are white."""
    masks = 0
    for block in range(24):
        drawn = [scene_of(BLOCK * block + k) for k in range(0, BLOCK, 5)]
        packed = [scene_tables.pack(d.scene, d.settings, forced=() if d.kind.specialize else OPTIONAL) for d in drawn]
        masks += len({tables.features.used for tables in packed})
    assert masks < 1.3 * 24


def test_an_exception_is_found_and_its_scene_shrunk(monkeypatch):
    def fails(device, drawn):
        if len(drawn.scene.meshes[-1].faces) > 1:
            raise ZeroDivisionError("planted")

    monkeypatch.setattr(scene_fuzzer, "draw", fails)
    monkeypatch.setattr(scene_fuzzer, "problem", lambda frame: "")
    (failure,) = scene_failures(SimpleNamespace(is_cpu=False), [13])
    assert len(scene_of(13).scene.lights) > 1
    assert failure.startswith("scene 13 of seed 0: ZeroDivisionError: planted [so do meshes of [1, ")
    assert "2] faces with 1 lights]" in failure  # faces of the last mesh: as few as still fail


def test_faces_are_left_out_with_all_that_they_index():
    verts = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    corners = {"normals": np.eye(3), "uvs": verts[:3, :2], "tangents": np.ones((3, 4))}
    indices = {f"{name[:-1]}_faces": [[0, 1, 2], [2, 1, 0]] for name in corners}
    (remainder,) = scene_fuzzer.without((Mesh(verts, [[0, 1, 2], [0, 2, 3]], **corners, **indices),), 0, slice(0, 1))
    assert remainder.faces.tolist() == [[0, 2, 3]]
    assert {tuple(getattr(remainder, name)[0].tolist()) for name in indices} == {(2, 1, 0)}


def copied(frame: Frame) -> tuple[Frame, dict[str, np.ndarray]]:
    """Return a copy of a frame, and its arrays by name."""
    rgba, layers = frame.rgba.copy(), {name: frame[name].copy() for name in frame.layers}
    return Frame(rgba, layers, frame.scene, frame.settings, dict), {"rgba": rgba, **layers}


def test_lanes_that_disagree_are_found(opened, monkeypatch):
    """One ulp in one pixel, which all bounds allow, or one bit of any layer."""
    if not opened.is_cpu:
        pytest.skip("a GPU's work-items have one pixel each")
    drawn = scene_of(1)
    frame = scene_fuzzer.draw(opened, drawn)
    assert drawn.again
    for name in ("rgba", *frame.layers):
        changed, arrays = copied(frame)
        arrays[name].reshape(-1).view(np.uint8)[-arrays[name].itemsize] ^= 1
        frames = iter((frame, changed))
        monkeypatch.setattr(scene_fuzzer, "draw", lambda *_, frames=frames: next(frames))
        message = scene_fuzzer.scene_problem(opened, drawn)
        assert message.startswith(f"with {drawn.kind.other_lanes} lanes: {name} has other bits, first at row, column")


def test_a_wrong_value_of_any_layer_is_found(opened, monkeypatch):
    drawn = scene_of(1)
    frame = scene_fuzzer.draw(opened, drawn)
    at = tuple(np.argwhere(frame["id"] > 0)[0])
    for name in frame.layers:
        for value in (np.nan, 1e30) if frame[name].dtype.kind == "f" else (4000,):
            changed, arrays = copied(frame)
            arrays[name][at] = value
            monkeypatch.setattr(scene_fuzzer, "draw", lambda *_, changed=changed: changed)
            message = scene_fuzzer.scene_problem(opened, drawn)
            named = "depths" if name == "Z" else name
            assert message.startswith(f"{named} ") or (name == "scalar" and np.isnan(frame[name][at]))


@pytest.mark.parametrize(
    ("cutoff", "far", "minimum", "maximum"),
    [(0.5, 0.0, 1.0, 1.0), (0.5 + 1e-6, 0.0, 1.0, 1.0), (0.6, 0.0, 0.0, 0.0), (None, 0.0, 0.0, 0.0)]
    + [(0.5, 1.0, 0.0, 0.0), (0.5, 1e4, 0.0, 0.0), (0.5, 2e11, 0.8, 1.0)],
)
def test_alphas_at_their_cutoff_or_of_far_coordinates_decide_either_way(cutoff, far, minimum, maximum):
    """At 2e11 a coordinate is only accurate to about a texel. far: 0 for a texture of one texel."""
    image = np.ones((1, 16, 4), np.float32)
    image[0, :, 3] = np.linspace(0.0, 1.0, 16) if far else 0.5
    material = Material(texture=Texture(image, "mirror"), alpha_cutoff=cutoff)
    corners, uvs = [[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]], far * np.array([[0.1, 0], [0.9, 0], [0.3, 0]])
    scene = Scene((Mesh(corners, [[0, 1, 2]], uvs=uvs, material=material),), CAMERA)
    covered = oracle.render(replace(scene, meshes=(replace(scene.meshes[0], uvs=None),)), Settings()).id > 0
    share = scene_fuzzer.decided_by_alpha(scene, Settings())[covered].mean()
    assert minimum <= share <= maximum


# Files


def test_every_sample_is_valid(tmp_path):
    for index, sample in enumerate(samples()):
        (tmp_path / str(index)).mkdir()
        assert file_mutations.load_problem(tmp_path / str(index), sample) == "", index


@pytest.mark.long
def test_files(monkeypatch):
    """Damaged files differ from the samples, and most but not all of them are refused."""
    every, refused = samples(), []
    good = file_mutations.load

    def counted(path, **options):
        try:
            return good(path, **options)
        except InputError:
            refused.append(path)
            raise

    monkeypatch.setattr(file_mutations, "load", counted)
    assert sum(file_mutations.mutated(k).files == every[k % len(every)].files for k in range(200)) < 10
    assert file_failures(range(1000)) == []
    assert 300 < len(refused) < 920


@pytest.mark.parametrize(
    ("planted", "message"),
    [
        (lambda path: {}["key"], "KeyError: 'key'"),
        (lambda path: 1 / np.zeros(1)[0], "RuntimeWarning: "),
        (lambda path: None, "expected a Scene, found NoneType"),
        (lambda path: (_ for _ in ()).throw(InputError("no name")), "one line that names the file"),
        (lambda path: (_ for _ in ()).throw(InputError(f"{path}: two\nlines")), "one line that names the file"),
        (lambda path: warnings.warn("two\nlines", stacklevel=1) or scene_of(1).scene, "a warning of several lines"),
        (lambda path: broken(verts=np.full((3, 3), np.nan)), "verts are not finite"),
        (lambda path: broken(faces=np.array([[0, 1, 3]])), "faces are out of range"),
    ],
)
def test_wrong_answers_of_a_loader_are_found(monkeypatch, planted, message):
    monkeypatch.setattr(file_mutations, "load", lambda path, **options: planted(path))
    (failure,) = file_failures([3])
    assert message in failure
    assert failure.startswith("file 3 of seed 0: a.npy: ")


def broken(**fields):
    mesh = replace(scene_of(1).scene.meshes[0])
    for name, value in fields.items():
        object.__setattr__(mesh, name, value)
    return replace(scene_of(1).scene, meshes=(mesh,))


def test_what_is_slow_large_or_hangs_is_found(monkeypatch):
    scene = scene_of(1).scene
    monkeypatch.setattr(file_mutations, "load", lambda path, **options: scene)
    assert file_failures([3]) == []
    for where, name, values, message in (
        (file_mutations.time, "process_time", [0.0, 5.1], "took 5.1 s"),
        (file_mutations, "_peak", [0, 2 << 30], "took 2048 MiB"),
    ):
        readings = iter(values)
        with monkeypatch.context() as patch:
            patch.setattr(where, name, lambda readings=readings: next(readings))
            assert message in file_failures([3])[0]

    def hangs(path, **options):
        while True:
            pass

    monkeypatch.setattr(file_mutations, "load", hangs)
    monkeypatch.setattr(file_mutations, "HANGS", 0.05)
    assert "took more than 0.05 s" in file_failures([3])[0]
