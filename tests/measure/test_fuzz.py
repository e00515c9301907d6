"""The fuzzers: random scenes against the oracle, damaged files against the loaders; and that they find planted
faults."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from clshade import oracle
from clshade.errors import InputError
from clshade.measure.fuzz import file_mutations, fuzz
from clshade.measure.fuzz.random_scenes import BLOCK, KINDS, kind_of, scene_of
from clshade.measure.fuzz.seed_files import IMAGES, samples
from clshade.pipeline import programs, scene_buffers
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.formats import inert_pickle
from clshade.scene.lights import LIGHTS
from clshade.scene.model import DirectionalLight, Material, Mesh, PointLight, Scene, Settings, SpotLight, Texture

SCENES = 40  # of one block, with one program
MANY = 1000


def listed(failures):
    return "\n".join(map(str, failures))


# Scenes


@pytest.mark.long
def test_scenes(device):
    assert listed(fuzz.scene_failures(device, range(SCENES))) == ""


@pytest.mark.long
def test_many_scenes(opened):
    """All scenes of every third block of a thousand: building the blocks' programs takes most of the time. For more run
    `python -m clshade fuzz --scenes 20000`."""
    numbers = [BLOCK * block + k for block in range(0, MANY // BLOCK, 3) for k in range(BLOCK)]
    assert listed(fuzz.scene_failures(opened, numbers)) == ""


def test_faces_are_left_out_with_all_that_they_index():
    verts = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    corners = {"normals": np.eye(3), "uvs": verts[:3, :2], "tangents": np.ones((3, 4))}
    indices = {f"{name[:-1]}_faces": [[0, 1, 2], [2, 1, 0]] for name in corners}
    mesh = Mesh(verts, [[0, 1, 2], [0, 2, 3]], **corners, **indices)
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (4, 4))
    (other,) = fuzz._without(Scene((mesh,), camera), 0, slice(0, 1)).meshes
    assert other.faces.tolist() == [[0, 2, 3]]
    assert {tuple(getattr(other, name)[0].tolist()) for name in indices} == {(2, 1, 0)}


@pytest.mark.long
def test_scenes_on_other_devices(device, opened):
    """Four scenes of every other block of a thousand."""
    if device.index == opened.index:
        pytest.skip("the default device draws more of them")
    numbers = [BLOCK * block + k for block in range(1, MANY // BLOCK, 2) for k in (2, 7, 19, 31)]
    assert listed(fuzz.scene_failures(device, numbers)) == ""


def test_items_that_leave_a_loop_early(device):
    """Found by the fuzzer: with one pixel per work-item Intel's runtime dereferenced pointers of work-items that had
    left the loop, and the process crashed at the first of these scenes."""
    if "intel" not in device.platform.lower():
        pytest.skip("only Intel's compiler was wrong")
    assert listed(fuzz.scene_failures(device, range(4400, 4410))) == ""


@pytest.mark.long
def test_depths_closer_than_float32_tells(opened):
    """Found by the fuzzer: the visible piece of a face was 4.2 * 2^-24 of its depth behind another's."""
    assert listed(fuzz.scene_failures(opened, [1977])) == ""


@pytest.mark.long
def test_sums_of_alphas_over_samples(opened):
    """Found by the fuzzer: where one of 44 samples is transparent, the sum of their alphas rounds to its own size."""
    assert listed(fuzz.scene_failures(opened, [60719])) == ""


@pytest.mark.long
def test_alphas_of_0_at_edges(opened):
    """Found by the fuzzer: with all features forced on, a pixel with an alpha of -1e-19 failed a test that its material
    has not."""
    assert listed(fuzz.scene_failures(opened, [20491])) == ""


@pytest.mark.long
def test_corners_saturate_where_float32_cannot_hold_a_scalar(opened):
    """Found by the fuzzer: the oracle interpolated between 1e-77 and 1e239, the layer between what float32 can hold."""
    assert listed(fuzz.scene_failures(opened, [391])) == ""


def test_a_number_is_a_scene():
    """The same number and seed give the same scene, others another; kinds repeat after KINDS blocks."""
    one, again, other = scene_of(121), scene_of(121), scene_of(121, seed=1)
    assert [mesh.verts.tobytes() for mesh in one.scene.meshes] == [mesh.verts.tobytes() for mesh in again.scene.meshes]
    assert (one.kind, one.settings) == (again.kind, again.settings)
    assert one.scene.camera.eye.tolist() != other.scene.camera.eye.tolist()
    assert kind_of(0, 3) == kind_of(0, 3 + KINDS) != kind_of(0, 4)


@pytest.mark.long
def test_scenes_are_of_all_sorts():
    kinds = [kind_of(0, block) for block in range(KINDS)]
    for name in (
        "front",
        "two_sided",
        "alpha",
        "normal_faces",
        "uv_faces",
        "orthographic",
        "double",
        "specialize",
        "facets",
    ):
        assert {getattr(kind, name) for kind in kinds} == {False, True}, name
    for name in (
        "shader",
        "visibility",
        "lighting_at",
        "interpolation",
        "texture_at",
        "texture_filter",
        "ambient",
        "cull",
    ):
        assert len({getattr(kind.settings, name) for kind in kinds}) == (4 if name == "shader" else 2), name
    assert {kind.settings.precision for kind in kinds} == {"fast", "float32", "float64"}
    drawn = [scene_of(number) for number in range(0, 50 * BLOCK, 10)]
    scenes = [each.scene for each in drawn]
    assert {1, 2, 16} < {each.settings.samples for each in drawn}
    assert 16 < max(each.settings.samples for each in drawn) <= 64
    sizes = {scene.camera.resolution for scene in scenes}
    assert min(min(size) for size in sizes) == 1
    assert {len(scene.lights) for scene in scenes} >= {0, 1, 2, 3, 4, 5}
    reach = [np.abs(mesh.verts).max(initial=0.0) for scene in scenes for mesh in scene.meshes]
    assert max(reach) > 1e20
    assert 0.0 < min(r for r in reach if r) < 1e-15
    lights = [light for scene in scenes for light in scene.lights]
    assert {type(light) for light in lights} == set(LIGHTS)
    assert {getattr(light, "attenuation", "none") for light in lights} == {"none", "inverse-square"}
    assert {0.0, 1.0, 90.0} & {light.outer_cone for light in lights if isinstance(light, SpotLight)}
    assert any(getattr(light, "range", None) for light in lights)
    exponents = {mesh.material.n for scene in scenes for mesh in scene.meshes}
    assert {0.0, 1.0, 1e9} <= exponents


@pytest.mark.long
def test_even_numbers_are_stiffer():
    """Each extreme occurs, and none in scenes with odd numbers, which stay unchanged."""
    drawn = [scene_of(number) for number in range(0, 600, 2)]
    cameras = [each.scene.camera for each in drawn]
    meshes = [mesh for each in drawn for mesh in each.scene.meshes]
    aspects = [camera.plane[0] / camera.plane[1] for camera in cameras]
    assert min(aspects) < 1e-3 < 1e3 < max(aspects)
    assert min(min(camera.principal) for camera in cameras) < -2.0
    assert max(max(camera.principal) for camera in cameras) > 3.0
    assert max(max(camera.resolution) for camera in cameras if min(camera.resolution) == 1) > 100
    finite = [np.abs(mesh.uvs[np.isfinite(mesh.uvs)]) for mesh in meshes if mesh.uvs is not None]
    assert any(1e8 < uvs.max(initial=0.0) <= 1.0001e9 for uvs in finite)
    lengths = np.concatenate([np.abs(mesh.normals).max(axis=1) for mesh in meshes if mesh.normals is not None])
    assert lengths[lengths > 0].min() < 1e-25
    assert lengths.max() > 1e25
    ranks = [np.linalg.matrix_rank(m[:3, :3]) for mesh in meshes for m in np.asarray(mesh.instances)]
    assert set(ranks) == {0, 1, 2, 3}
    at_eye = [
        not isinstance(light, DirectionalLight) and (light.position == each.scene.camera.eye).all()
        for each in drawn
        for light in each.scene.lights
    ]
    assert sum(at_eye) > 10
    odd = [scene_of(number).scene.camera for number in range(1, 600, 2)]
    assert max(max(camera.principal) for camera in odd) < 1.31


@pytest.mark.long
def test_a_block_shares_its_program():
    """Or two: a rare scene may need fewer features, for example if all colors of a mesh are white."""
    masks, bright = 0, set()
    for block in range(24):
        drawn = [scene_of(BLOCK * block + k) for k in range(0, BLOCK, 5)]
        packed = [scene_buffers.pack(d.scene, d.settings, forced=() if d.kind.specialize else OPTIONAL) for d in drawn]
        masks += len({each.features.values for each in packed})
        bright |= {dict(each.features.values)["BRIGHT"] for each in packed}
    assert masks < 1.3 * 24
    assert bright == {0, 1}


def altered(frame: Frame, name: str) -> Frame:
    """Return the frame with one wrong pixel, the first covered one."""
    row, column = np.argwhere(frame["id"] > 0)[0]
    rgba, layers = frame.rgba.copy(), {layer: frame[layer].copy() for layer in ("Z", "id")}
    if name == "not a number":
        rgba[row, column, 1] = np.nan
    elif name == "color":
        rgba[row, column, 0] += 0.5 * np.abs(rgba[..., :3]).max() + 1.0
    elif name == "coverage":
        rgba[row, column, 3] = 0.0
    elif name == "depth":
        layers["Z"][row, column] *= np.float32(1 + 2.0**-19)
    else:
        layers["id"][row, column] += 1
    return Frame(rgba, layers, frame.scene, frame.settings, dict)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("not a number", "rgb: not finite"),
        ("color", "colors off"),
        ("coverage", "alpha differs"),
        ("depth", "depths off"),
        ("owner", "ids differ"),
    ],
)
def test_a_wrong_pixel_is_found(opened, monkeypatch, name, message):
    good = fuzz.draw
    monkeypatch.setattr(fuzz, "draw", lambda device, drawn: altered(good(device, drawn), name))
    monkeypatch.setattr(fuzz, "SHRINKING", 1.0)
    (failure,) = fuzz.scene_failures(opened, [13])  # drawn once
    assert message in failure.reason
    assert failure.shrunk.startswith("so do meshes of [1")
    assert str(failure).startswith("scene 13: ")


def test_an_exception_is_found(opened, monkeypatch):
    def fails(device, drawn):
        if len(drawn.scene.meshes[-1].faces) > 1:
            raise ZeroDivisionError("planted")
        return good(device, drawn)

    good = fuzz.draw
    monkeypatch.setattr(fuzz, "draw", fails)
    (failure,) = fuzz.scene_failures(opened, [13])  # drawn once
    assert "ZeroDivisionError: planted" in failure.reason
    assert "2]" in failure.shrunk  # faces of the last mesh: as few as still fail


def test_lanes_that_disagree_are_found(opened, monkeypatch):
    """One ulp in one pixel, which all bounds allow."""
    if not opened.is_cpu:
        pytest.skip("a GPU's work-items have one pixel each")
    good, tally = fuzz.draw, fuzz.Tally()

    def drawn_with(device, drawn, lanes=None):
        frame = good(device, drawn)
        if lanes is None:
            return frame
        assert lanes == drawn.kind.other_lanes != (drawn.kind.lanes or 16)
        rgba = frame.rgba.copy()
        rgba[-1, -1, 1] = np.nextafter(rgba[-1, -1, 1], np.float32(9))
        return Frame(rgba, {name: frame[name] for name in frame.layers}, frame.scene, frame.settings, dict)

    monkeypatch.setattr(fuzz, "draw", drawn_with)
    monkeypatch.setattr(fuzz, "SHRINKING", 0.0)
    again = [number for number in range(16) if scene_of(number).again]
    assert len(again) == 8
    failures = fuzz.scene_failures(opened, again, tally=tally)
    assert len(failures) == 8
    assert all("rgba has other bits, first at row, column" in failure.reason for failure in failures)
    assert (tally.scenes, tally.again, tally.pixels) == (8, 8, 0)


def test_bits_of_layers_are_compared(opened):
    frame = fuzz.draw(opened, scene_of(1))
    for name in frame.layers:
        value = frame[name].copy()
        value.reshape(-1).view(np.uint8)[-1] ^= 1
        other = Frame(
            frame.rgba, {**{n: frame[n] for n in frame.layers}, name: value}, frame.scene, frame.settings, dict
        )
        assert fuzz.different_bits(frame, other).startswith(f"{name} has other bits")
    assert fuzz.different_bits(frame, frame) == ""


@pytest.mark.long
def test_what_is_excepted_is_counted(opened):
    """Two coplanar squares, seen from the front: either may own a pixel."""
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    meshes = (Mesh(corners, [[0, 1, 2], [0, 2, 3]]), Mesh(corners, [[1, 2, 3], [1, 3, 0]]))
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (0.7, 0.7), (24, 24))
    drawn = replace(scene_of(1), scene=Scene(meshes, camera), settings=Settings(layers=("Z", "id")))
    frame, tally = fuzz.draw(opened, drawn), fuzz.Tally()
    expected = oracle.render(frame.scene, frame.settings)
    ids = frame["id"].copy()
    covering = oracle.depth_at(frame.scene, frame.settings, np.arange(4), np.full(4, 12), np.full(4, 12))
    ids[12, 12] = next(k + 1 for k in range(4) if np.isfinite(covering[k]) and k + 1 != frame["id"][12, 12])
    other = Frame(frame.rgba, {"Z": frame["Z"], "id": ids}, frame.scene, frame.settings, dict)
    assert fuzz.problem(other, expected, tally) == ""
    covered = int((frame["id"] > 0).sum())
    assert (tally.pixels, tally.covered, tally.gates, tally.ties, tally.alphas) == (576, covered, 0, 1, 0)
    assert f"1 ({1e6 / covered:.1f} per million) tied" in str(tally)
    twice = tally + tally
    assert (twice.pixels, twice.ties) == (1152, 2)


@pytest.mark.long
def test_a_wrong_kernel_is_found(opened, monkeypatch):
    """Pixels on a shared edge are drawn by both triangles, or by the wrong one."""
    flatten, rule = programs.flatten, "(((a) > 0) | (((a) == 0) & ((b) < 0)))"
    assert rule in flatten(("setup.cl",))
    monkeypatch.setattr(programs, "flatten", lambda names: flatten(names).replace(rule, "((a) == (a))"))
    monkeypatch.setattr(fuzz, "SHRINKING", 1.0)
    failures = fuzz.scene_failures(opened, range(BLOCK))
    assert any("ids differ" in failure.reason for failure in failures)


def test_normals_beyond_the_vertices():
    """Found by the fuzzer: the normals of the following meshes were shifted."""
    corners, up = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0.0, 0, 1]])
    first = Mesh(corners, [[0, 1, 2]], normals=np.repeat(up, 9, axis=0))
    second = Mesh(corners - [1.0, 1, 0], [[0, 1, 2]], normals=np.array([[0.0, 1, 1], [0, 0, 1], [1, 0, 1]]))
    camera, light = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (9, 7)), PointLight((0.0, 1, 2))
    scene = Scene((first, second), camera, (light,))
    packed = scene_buffers.pack(scene, Settings())
    assert packed.normals.shape == (6, 4)
    assert packed.normals[3:, :3] == pytest.approx(second.normals / np.linalg.norm(second.normals, axis=1)[:, None])


def test_alpha_at_its_cutoff_decides_either_way():
    image = np.full((1, 1, 4), 0.5, np.float32)
    corners = np.array([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]])
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (9, 7))
    for cutoff, either in ((0.5, True), (0.5 + 1e-6, True), (0.6, False), (None, False)):
        material = Material(texture=Texture(image), alpha_cutoff=cutoff)
        scene = Scene((Mesh(corners, [[0, 1, 2]], uvs=np.zeros((3, 2)), material=material),), camera)
        found = fuzz.decided_by_alpha(scene, Settings())
        covered = oracle.render(replace(scene, meshes=(replace(scene.meshes[0], uvs=None),)), Settings()).id > 0
        assert np.array_equal(found, covered & either)


def test_alpha_of_far_coordinates_decides_either_way():
    """Found by the fuzzer: at 2e11 a coordinate is only accurate to about a texel."""
    image = np.ones((1, 16, 4), np.float32)
    image[0, :, 3] = np.linspace(0.0, 1.0, 16)
    corners = np.array([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]])
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (9, 7))
    material = Material(texture=Texture(image, "mirror"), alpha_cutoff=0.5)
    for far, share in ((1.0, 0.0), (1e4, 0.0), (2e11, 0.8)):
        mesh = Mesh(corners, [[0, 1, 2]], uvs=far * np.array([[0.1, 0], [0.9, 0], [0.3, 0]]), material=material)
        found = fuzz.decided_by_alpha(Scene((mesh,), camera), Settings())
        assert found.mean() >= share
        assert found.mean() <= (share and 1.0)


# Files


def test_every_sample_is_valid(tmp_path):
    for index, sample in enumerate(samples()):
        folder = tmp_path / str(index)
        folder.mkdir()
        assert file_mutations.load_problem(folder, sample) == "", index
        if next(iter(sample.files)).endswith(IMAGES):
            continue
        options = {"texture": folder / sample.texture} if sample.texture else {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            scene = file_mutations.load(folder / next(iter(sample.files)), **sample.options, **options)
        assert scene.face_count > 0


@pytest.mark.long
def test_files():
    assert listed(fuzz.file_failures(range(200))) == ""


@pytest.mark.long
def test_many_files():
    """Files 0 to 999; for more run `python -m clshade fuzz --scenes 0 --files 20000`."""
    assert listed(fuzz.file_failures(range(MANY))) == ""


@pytest.mark.long
def test_damage_is_done_and_refused(monkeypatch):
    """Damaged files differ from the samples, and most but not all of them are refused."""
    every, refused = samples(), 0
    good = file_mutations.load

    def counted(path, **options):
        nonlocal refused
        try:
            return good(path, **options)
        except InputError:
            refused += 1
            raise

    monkeypatch.setattr(file_mutations, "load", counted)
    same = sum(file_mutations.mutated(k).files == every[k % len(every)].files for k in range(200))
    assert same < 10
    assert fuzz.file_failures(range(200)) == []
    assert 60 < refused < 185


@pytest.mark.parametrize(
    ("planted", "message"),
    [
        (lambda path: {}["key"], "KeyError: 'key'"),
        (lambda path: 1 / np.zeros(1)[0], "RuntimeWarning: "),
        (lambda path: None, "expected a Scene, found NoneType"),
        (lambda path: (_ for _ in ()).throw(InputError("no name")), "one line that names the file"),
        (lambda path: (_ for _ in ()).throw(InputError(f"{path}: two\nlines")), "one line that names the file"),
        (lambda path: warnings.warn("two\nlines", stacklevel=1) or scene_of(1).scene, "a warning of several lines"),
    ],
)
def test_wrong_answers_of_a_loader_are_found(monkeypatch, planted, message):
    monkeypatch.setattr(file_mutations, "load", lambda path, **options: planted(path))
    (failure,) = fuzz.file_failures([3])
    assert message in failure.reason
    assert str(failure).startswith("file 3: a.npy: ")


def test_what_is_slow_large_or_hangs_is_found(monkeypatch):
    scene = scene_of(1).scene
    monkeypatch.setattr(file_mutations, "load", lambda path, **options: scene)
    assert file_mutations.problem(3) == ""
    times, sizes = iter([0.0, 5.1]), iter([0, 2 << 30])
    with monkeypatch.context() as patch:
        patch.setattr(file_mutations.time, "process_time", lambda: next(times))
        assert "took 5.1 s" in file_mutations.problem(3)
    with monkeypatch.context() as patch:
        patch.setattr(file_mutations, "_peak", lambda: next(sizes))
        assert "took 2048 MiB" in file_mutations.problem(3)

    def hangs(path, **options):
        while True:
            pass

    monkeypatch.setattr(file_mutations, "load", hangs)
    monkeypatch.setattr(file_mutations, "HANGS", 0.05)
    assert "took more than 0.05 s" in file_mutations.problem(3)


@pytest.mark.long
def test_pickles_that_take_long_are_found(monkeypatch):
    """With an interpreter that hashes any key in the file, as Python's own does: 2^22 steps and more."""

    def careless(machine, items, at):
        machine.stack[-1].update(zip(items[::2], items[1::2], strict=True))
        return at

    def depth(number):
        data = next(iter(file_mutations.mutated(number).files.values()))
        return data.count(b"\x86r") if b"}K\x01r" in data else 0

    numbers = [number for number in range(3000) if 22 <= depth(number) <= 24]
    assert fuzz.file_failures(numbers) == []
    monkeypatch.setattr(inert_pickle, "_updated", careless)
    monkeypatch.setattr(file_mutations, "SECONDS", 0.02)
    found = fuzz.file_failures(numbers)
    assert found  # not all: one may be damaged in other ways, too
    assert {failure.number for failure in found} <= set(numbers)
    assert all(failure.reason.startswith("a.npy: took ") for failure in found)


def test_flaws_of_scenes_are_seen():
    scene = scene_of(1).scene
    mesh = scene.meshes[0]
    assert file_mutations.flaw(scene) == ""
    for name, value in (("verts", np.full((3, 3), np.nan)), ("faces", np.array([[0, 1, 3]]))):
        broken = replace(mesh)
        object.__setattr__(broken, name, value)
        assert name in file_mutations.flaw(replace(scene, meshes=(broken,)))


@pytest.mark.long
def test_alphas_that_jump_at_texels_edges(device):
    """Of faces that blend, of any opacity, and where texels have exactly the alpha of the cutoff, also at samples
    that are not the pixel's nearest."""
    assert fuzz.scene_failures(device, [20359, 24383, 32379, 132383, 17039]) == []
