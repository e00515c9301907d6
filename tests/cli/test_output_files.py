"""Options for output files: --formats, --depth-scale, --stereo, --save-cameras, --cryptomatte, --save-scene."""

import json
import os
import re

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, run
from scene_files import same

import clshade
from clshade.farm import read_cameras
from clshade.images import depth_png, exr, png
from clshade.scene.builtin.scenes import builtin

TURN = ("turntable", *SMALL[1:], "--count", "2")
ROOM = ("box_room", "--resolution", "40x30", "--samples", "2")
pytestmark = [needs_device, pytest.mark.usefixtures("folder")]


def test_formats_of_render(tmp_path, capsys):
    code, out, _ = run(capsys, *SMALL, "--formats", "png,npz,depth", "--depth-scale", "0.0005")
    assert (code, listing(tmp_path)) == (0, ["out.depth.png", "out.npz", "out.png"])
    assert all(name in out for name in listing(tmp_path))
    assert "out.exr" not in out
    arrays = np.load("out.npz", allow_pickle=False)
    depth, scale = depth_png.read("out.depth.png")
    seen = arrays["id"] > 0
    assert scale == 0.0005
    assert np.array_equal(np.isfinite(depth), seen)
    assert np.abs(depth[seen] - arrays["Z"][seen]).max() <= scale / 2 * (1 + 1e-9)
    camera = builtin("quads", resolution=(32, 24)).camera
    np.testing.assert_allclose(arrays["K"], camera.to_matrix()[0], rtol=0, atol=1e-12)


def test_endings_choose_formats_and_depth_its_layer(tmp_path, capsys):
    assert run(capsys, *SMALL, "-o", "a.npz", "--quiet")[0] == 0
    assert run(capsys, *SMALL, "-o", "b.npz", "--formats", "png", "--quiet")[0] == 0
    assert run(capsys, *TURN, "-o", "c.#.npz", "--quiet")[0] == 0
    assert listing(tmp_path) == ["a.npz", "b.png", "c.1.npz", "c.2.npz"]
    assert run(capsys, *SMALL[:-1], "id", "--formats", "exr,depth", "--quiet")[0] == 0
    assert {"Z", "id"} <= set(exr.read("out.exr")[0])


def test_a_turn_of_two_eyes_with_its_cameras(tmp_path, capsys):
    command = (*TURN, "--formats", "npz,depth", "--stereo", "0.5", "--convergence", "9", "-o", "a/f.##.exr")
    code, out, _ = run(capsys, *command, "--save-cameras", "a/c.json", "--json")
    eyes = ("left", "right")
    names = [f"a/f.{eye}.{k:02d}.{kind}" for eye in eyes for k in (1, 2) for kind in ("depth.png", "npz")]
    assert (code, listing(tmp_path)) == (0, sorted(["a", *(f"a/c.{eye}.json" for eye in eyes), *names]))
    summary = json.loads(out)
    assert [(summary[eye]["drawn"], summary[eye]["files"]) for eye in eyes] == [(2, ["npz", "depth"])] * 2
    _, out, _ = run(capsys, *command)
    assert out.count("2 there already") == 2
    assert f"a{os.sep}f.right.01.npz ... a{os.sep}f.right.02.npz, a depth PNG beside each" in out
    for eye in eyes:
        cameras = read_cameras(f"a/c.{eye}.json", builtin("icosphere").camera)
        assert run(capsys, "animate", *SMALL[1:], f"a/c.{eye}.json", "-o", f"b.{eye}.##.npz", "--quiet")[0] == 0
        for k in (1, 2):
            with np.load(f"a/f.{eye}.{k:02d}.npz") as first, np.load(f"b.{eye}.{k:02d}.npz") as second:
                np.testing.assert_allclose(first["K"], cameras[k - 1].to_matrix()[0], rtol=0, atol=1e-12)
                np.testing.assert_allclose(second["pose"], first["pose"], rtol=0, atol=1e-14)
                assert np.array_equal(second["id"], first["id"])
                np.testing.assert_allclose(second["Z"], first["Z"], rtol=1e-6)


@pytest.mark.parametrize("kind", ["exr", "png", "npz", "depth"])
def test_frames_of_another_size(tmp_path, capsys, kind):
    assert run(capsys, "turntable", *SMALL[1:], "--frames", "1", "--formats", kind, "-o", "f.#", "--quiet")[0] == 0
    (name,) = listing(tmp_path)
    before = (tmp_path / name).read_bytes()
    outcome = run(capsys, *TURN, "--formats", kind, "-o", "f.#", "--resolution", "16,12")
    assert_refused(outcome, f"{name}: expected 16x12 of the frames to draw, found 32x24 of an earlier run: --overwrite")
    assert listing(tmp_path) == [name]
    assert (tmp_path / name).read_bytes() == before


def test_a_stereo_pair_with_magnified_crops(tmp_path, capsys):
    code, out, _ = run(capsys, *SMALL, "--stereo", "0.5", "--crop-zoom", "2,3,8,6", "--json", "--formats", "png")
    assert code == 0
    assert [entry["resolution"] for entry in json.loads(out)["stereo"].values()] == [[32, 24]] * 2
    assert listing(tmp_path) == [
        f"out.{eye}{ending}.png" for eye in ("left", "right") for ending in ("", "_crop", "_marked")
    ]
    left, right = (png.read(f"out.{eye}.png") for eye in ("left", "right"))
    assert (left != right).any()


def test_masks_stand_in_each_image(folder, capsys):
    pytest.importorskip("mmh3")
    assert run(capsys, "render", *ROOM, "--cryptomatte", "object,material", "-o", "room")[0] == 0
    channels, _ = exr.read("room.exr")
    mattes = clshade.cryptomatte(clshade.render(clshade.builtin("box_room"), resolution=(40, 30), samples=2))
    for kind in ("object", "material"):
        for name, plane in mattes[kind].channels.items():
            assert np.array_equal(channels[name], plane), name
    assert not [name for name in channels if name.startswith("CryptoInstance")]
    image = pytest.importorskip("OpenImageIO").ImageInput.open("room.exr")
    assert image.seek_subimage(1, 0)
    facts = {attribute.name: attribute.value for attribute in image.spec().extra_attribs}
    manifest = next(facts[name] for name in facts if re.fullmatch("cryptomatte/.*/manifest", name))
    assert len(json.loads(manifest)) == len(clshade.builtin("box_room").meshes)


def test_turntable_writes_all_kinds_of_masks_into_each_frame(folder, capsys):
    pytest.importorskip("mmh3")
    command = ("turntable", *ROOM, "--count", "2", "--cryptomatte", "-o", "t.#.exr", "--formats", "exr")
    assert run(capsys, *command)[0] == 0
    first, second = (exr.read(f"t.{number}.exr")[0] for number in (1, 2))
    kinds = {f"Crypto{kind}" for kind in ("Object", "Material", "Instance")}
    assert {name[:-4] for name in first if name.startswith("Crypto")} == kinds
    assert (first["CryptoObject00.G"] != second["CryptoObject00.G"]).any()


def test_the_saved_scene_draws_the_same_picture(capsys, tmp_path):
    options = ("--lights", "1", "--light-intensity", "0.5", "--camera-azimuth-angle", "20", "--json")
    code, out, err = run(capsys, *SMALL, *options, "--save-scene", "scene.json", "-o", "a")
    assert code == 0, err
    assert err[-1].endswith("wrote scene.json")
    assert json.loads(out)["resolution"] == [32, 24]  # standard output stays JSON
    scene = clshade.load("scene.json")
    assert (scene.preset, scene.camera.resolution, len(scene.lights)) == ("course", (32, 24), 1)
    binary = json.loads((tmp_path / "scene.json").read_text())["arrays"]["file"]
    assert listing(tmp_path) == ["a.exr", "a.png", "scene.json", binary]
    assert run(capsys, "render", "scene.json", "--layers", "Z,id", "-o", "b")[0] == 0
    (first, _), (second, _) = (exr.read(tmp_path / f"{name}.exr") for name in "ab")
    assert same(first, second)


def test_a_scene_for_other_programs(capsys, tmp_path):
    assert run(capsys, *SMALL, "--resolution", "40,20", "--save-scene", "scene.GLB", "-o", "a")[0] == 0
    assert listing(tmp_path) == ["a.exr", "a.png", "scene.GLB"]
    scene = clshade.load("scene.GLB")
    columns, rows = scene.camera.resolution
    assert columns == 2 * rows
    assert scene.face_count == clshade.builtin("quads").face_count
