"""The fuzzers: random scenes against the oracle, damaged files against the loaders; and that they find planted faults.

For more than these run `python tests/fuzz/run.py --scenes 0:20000 --files 0:20000 --seed 1`.
"""

import shutil
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import file_mutations
import numpy as np
import pytest
import scene_fuzzer
from file_mutations import file_failures
from random_kinds import BLOCK, FLAGS, KINDS, kind_of
from random_scenes import scene_of
from scene_fuzzer import scene_failures
from seed_files import samples

from clshade import oracle
from clshade.errors import InputError
from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.formats.load import load
from clshade.scene.lights import LIGHTS
from clshade.scene.model import Material, Mesh, Scene, Settings, SpotLight, Texture

CAMERA = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (9, 7))


@pytest.mark.long
def test_scenes(device, opened):
    """Half of the scenes of two blocks; on other devices eight scenes of each of four. Those of a block share programs."""
    is_first = device.index == opened.index
    blocks, some = ((0, 10), range(0, BLOCK, 2)) if is_first else (range(1, 20, 6), range(3, BLOCK, 6))
    failures = scene_failures(device, [BLOCK * block + k for block in blocks for k in some])
    assert failures == [], "\n\n".join(failures)


@pytest.mark.long
def test_scenes_are_of_all_sorts():
    kinds = [kind_of(0, block) for block in range(KINDS)]
    assert frozenset.union(*(kind.flags for kind in kinds)) == FLAGS
    assert frozenset.intersection(*(kind.flags for kind in kinds)) == set()
    for name in ("preset", "specialize", "lanes", "other_lanes", "scalars"):
        assert len({getattr(kind, name) for kind in kinds}) > 1, name
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
    even = [scene_of(number).scene for number in range(0, 600, 2)]
    meshes = [mesh for scene in even for mesh in scene.meshes]
    finite = [np.abs(mesh.uvs[np.isfinite(mesh.uvs)]) for mesh in meshes if mesh.uvs is not None]
    assert any(1e8 < uvs.max(initial=0.0) <= 1.0001e9 for uvs in finite)
    lengths = np.concatenate([np.abs(mesh.normals).max(axis=1) for mesh in meshes if mesh.normals is not None])
    assert lengths[lengths > 0].min() < 1e-25 < 1e25 < lengths.max()
    assert {np.linalg.matrix_rank(m[:3, :3]) for mesh in meshes for m in np.asarray(mesh.instances)} == {0, 1, 2, 3}


def test_a_failure_is_shrunk_and_saved_and_its_message_says_how_to_repeat_it(monkeypatch):
    def fails(device, drawn):
        if len(drawn.scene.meshes[-1].faces) > 1:
            raise ZeroDivisionError("planted")

    monkeypatch.setattr(scene_fuzzer, "draw", fails)
    monkeypatch.setattr(scene_fuzzer, "problem", lambda frame: "")
    (failure,) = scene_failures(SimpleNamespace(is_cpu=False, index="0:0"), [13])
    assert len(scene_of(13).scene.lights) > 1
    reason, shrunk, path, command = failure.splitlines()
    assert reason == "scene 13 of seed 0: ZeroDivisionError: planted"
    assert shrunk.startswith("so do meshes of [1, ")
    assert "2] faces with 1 lights, " in shrunk  # faces of the last mesh: as few as still fail
    assert len(load(path).meshes[-1].faces) == 2
    assert command == "again: python tests/fuzz/run.py --scenes 13:14 --seed 0 --device 0:0"
    shutil.rmtree(Path(path).parent)


@pytest.mark.long
def test_lanes_that_disagree_and_a_wrong_value_of_any_layer_are_found(opened, monkeypatch):
    """One ulp in one pixel, which all bounds allow, or one bit of any layer."""
    drawn = scene_of(1)
    frame = scene_fuzzer.draw(opened, drawn)
    at = tuple(np.argwhere(frame["id"] > 0)[0])
    assert drawn.again

    def message_of(name: str, change: Callable[[np.ndarray], object], *before: Frame) -> str:
        """Return what is said of a changed array of the frame, drawn after others."""
        arrays = {"rgba": frame.rgba.copy(), **{layer: frame[layer].copy() for layer in frame.layers}}
        change(arrays[name])
        changed = Frame(arrays.pop("rgba"), arrays, frame.scene, frame.settings, dict)
        frames = iter((*before, changed, changed))
        monkeypatch.setattr(scene_fuzzer, "draw", lambda *_: next(frames))
        return scene_fuzzer.scene_problem(opened, drawn)

    for name in ("rgba", *frame.layers) if opened.is_cpu else ():  # a GPU's work-items have one pixel each
        message = message_of(name, lambda a: np.bitwise_xor.at(a.reshape(-1).view(np.uint8), -a.itemsize, 1), frame)
        assert message.startswith(f"with {drawn.kind.other_lanes} lanes: {name} has other bits, first at row, column")
    for name in frame.layers:
        for value in (np.nan, 1e30) if frame[name].dtype.kind == "f" else (4000,):
            message = message_of(name, lambda a, value=value: a.__setitem__(at, value))
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


def test_every_sample_is_valid(tmp_path):
    for index, sample in enumerate(samples()):
        (tmp_path / str(index)).mkdir()
        assert file_mutations.load_problem(tmp_path / str(index), sample) == "", index


@pytest.mark.long
def test_files(monkeypatch):
    """Damaged files differ from the samples, and most but not all of them are refused."""
    every, loaded = samples(), []
    monkeypatch.setattr(
        file_mutations, "load", lambda path, **options: loaded.append(scene := load(path, **options)) or scene
    )
    assert sum(file_mutations.mutated(k).files == every[k % len(every)].files for k in range(200)) < 10
    assert file_failures(range(1000)) == []
    assert 80 < len(loaded) < 700


def broken(**fields):
    scene = scene_of(1).scene
    mesh = replace(scene.meshes[0])
    for name, value in fields.items():
        object.__setattr__(mesh, name, value)
    return replace(scene, meshes=(mesh,))


WRONG = [
    (lambda path: {}["key"], "KeyError: 'key'"),
    (lambda path: None, "expected a Scene, found NoneType"),
    (lambda path: (_ for _ in ()).throw(InputError("no name")), "one line that names the file"),
    (lambda path: (_ for _ in ()).throw(InputError(f"{path}: two\nlines")), "one line that names the file"),
    (lambda path: warnings.warn("two\nlines", stacklevel=1) or broken(), "a warning of several lines"),
    (lambda path: broken(verts=np.full((3, 3), np.nan)), "verts are not finite"),
    (lambda path: broken(faces=np.array([[0, 1, 3]])), "faces are out of range"),
]


@pytest.mark.parametrize(("planted", "message"), WRONG)
def test_wrong_answers_of_a_loader_are_found(monkeypatch, planted, message):
    monkeypatch.setattr(file_mutations, "load", lambda path, **options: planted(path))
    (failure,) = file_failures([3])
    assert message in failure
    assert failure.startswith("file 3 of seed 0: a.npy: ")
    assert failure.endswith("again: python tests/fuzz/run.py --files 3:4 --seed 0")


def test_what_is_slow_large_or_hangs_is_found(monkeypatch):
    monkeypatch.setattr(file_mutations, "load", lambda path, **options: broken())
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
