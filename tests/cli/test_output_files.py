"""Options for output files: --formats, --depth-scale, --stereo, --save-cameras, --cryptomatte, --save-scene."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, run

import clshade
from clshade.farm import read_cameras
from clshade.images import depth_png, exr, png
from clshade.scene.builtin.scenes import builtin

TURN = ("turntable", *SMALL[1:], "--count", "2")
ROOM = ("box_room", "--resolution", "40x30", "--samples", "2")
pytestmark = [needs_device, pytest.mark.usefixtures("folder")]


def test_formats_of_render(tmp_path, capsys):
    code, out, _ = run(capsys, *SMALL, "--formats", "png,npz,depth", "--depth-scale", "0.0005", "--deterministic")
    assert (code, listing(tmp_path)) == (0, ["out.depth.png", "out.npz", "out.png"])
    assert all(name in out for name in listing(tmp_path))
    assert "out.exr" not in out
    with np.load("out.npz", allow_pickle=False) as arrays:
        saved_arrays = dict(arrays)
    depth, scale = depth_png.read("out.depth.png")
    seen = saved_arrays["id"] > 0
    assert scale == 0.0005
    assert np.array_equal(np.isfinite(depth), seen)
    assert np.abs(depth[seen] - saved_arrays["Z"][seen]).max() <= scale / 2 * (1 + 1e-9)
    camera = builtin("quads", resolution=(32, 24)).camera
    np.testing.assert_allclose(saved_arrays["K"], camera.to_matrix()[0], rtol=0, atol=1e-12)
    before = {name: (tmp_path / name).read_bytes() for name in listing(tmp_path)}
    assert run(capsys, *SMALL, "--formats", "depth,npz,png", "--depth-scale", "0.0005", "--deterministic")[0] == 0
    assert {name: (tmp_path / name).read_bytes() for name in listing(tmp_path)} == before


def test_a_name_that_ends_in_npz(tmp_path, capsys):
    assert run(capsys, *SMALL, "-o", "a.npz", "--quiet")[0] == 0
    assert run(capsys, *SMALL, "-o", "b.npz", "--formats", "png", "--quiet")[0] == 0
    assert run(capsys, *TURN, "-o", "c.#.npz", "--quiet")[0] == 0
    assert listing(tmp_path) == ["a.npz", "b.png", "c.1.npz", "c.2.npz"]


def test_depth_adds_its_layer(tmp_path, capsys):
    command = ("render", "quads", "--resolution", "32,24", "--preset", "course", "--layers", "id", "--quiet")
    assert run(capsys, *command, "--formats", "exr,depth")[0] == 0
    assert {"Z", "id"} <= set(exr.read("out.exr")[0])


def test_a_turn_of_two_eyes_with_its_cameras(tmp_path, capsys):
    """What is there is skipped; the cameras that were saved draw the same frames."""
    command = (*TURN, "--formats", "npz,depth", "--stereo", "0.5", "--convergence", "9", "-o", "a/f.##.exr")
    code, out, _ = run(capsys, *command, "--save-cameras", "a/c.json", "--json")
    eyes = ("left", "right")
    kinds = ("depth.png", "npz")
    names = [f"a/f.{eye}.{k:02d}.{kind}" for eye in eyes for k in (1, 2) for kind in kinds]
    assert (code, listing(tmp_path)) == (0, sorted(["a", *(f"a/c.{eye}.json" for eye in eyes), *names]))
    summary = json.loads(out)
    assert [(summary[eye]["drawn"], summary[eye]["files"]) for eye in eyes] == [(2, ["npz", "depth"])] * 2
    _, out, _ = run(capsys, *command)
    assert out.count("2 there already") == 2
    assert f"a{os.sep}f.right.01.npz ... a{os.sep}f.right.02.npz, a depth PNG beside each" in out
    for eye in eyes:
        cameras = read_cameras(f"a/c.{eye}.json", builtin("icosphere").camera)
        draw = ("animate", *SMALL[1:], f"a/c.{eye}.json", "-o", f"b.{eye}.##.npz", "--quiet")
        assert run(capsys, *draw)[0] == 0
        for k in (1, 2):
            with np.load(f"a/f.{eye}.{k:02d}.npz") as first, np.load(f"b.{eye}.{k:02d}.npz") as second:
                np.testing.assert_allclose(first["K"], cameras[k - 1].to_matrix()[0], rtol=0, atol=1e-12)
                np.testing.assert_allclose(second["pose"], first["pose"], rtol=0, atol=1e-14)
                assert np.array_equal(second["id"], first["id"])
                np.testing.assert_allclose(second["Z"], first["Z"], rtol=1e-6)


@pytest.mark.parametrize("kind", ["exr", "png", "npz", "depth"])
def test_frames_of_another_size(tmp_path, capsys, kind):
    """Each kind alone: refused in a line, nothing is drawn or changed."""
    command = (*TURN, "--formats", kind, "-o", "f.#")
    assert run(capsys, *command, "--frames", "1", "--quiet")[0] == 2  # --count and --frames
    first = ("turntable", *SMALL[1:], "--frames", "1", "--formats", kind, "-o", "f.#", "--quiet")
    assert run(capsys, *first)[0] == 0
    (name,) = listing(tmp_path)
    before = (tmp_path / name).read_bytes()
    outcome = run(capsys, *command, "--resolution", "16,12")
    assert_refused(outcome, f"{name}: expected 16x12 of the frames to draw, found 32x24 of an earlier run: --overwrite")
    assert listing(tmp_path) == [name]
    assert (tmp_path / name).read_bytes() == before


def test_a_stereo_pair_with_magnified_crops(tmp_path, capsys):
    command = (*SMALL, "--stereo", "0.5", "--crop-zoom", "2,3,8,6", "--json", "--formats", "png")
    code, out, _ = run(capsys, *command)
    assert code == 0
    assert [entry["resolution"] for entry in json.loads(out)["stereo"].values()] == [[32, 24]] * 2
    assert listing(tmp_path) == [
        f"out.{eye}{ending}.png" for eye in ("left", "right") for ending in ("", "_crop", "_marked")
    ]
    left, right = (png.read(f"out.{eye}.png") for eye in ("left", "right"))
    assert (left != right).any()


# Masks


def test_render_writes_the_masks(folder, capsys):
    pytest.importorskip("mmh3")
    code, _, err = run(capsys, "render", *ROOM, "--cryptomatte", "object,material", "-o", "room")
    assert code == 0, err
    channels, _ = exr.read("room.exr")
    mattes = clshade.cryptomatte(clshade.render(clshade.builtin("box_room"), resolution=(40, 30), samples=2))
    for kind in ("object", "material"):
        for name, plane in mattes[kind].channels.items():
            assert np.array_equal(channels[name], plane), name
    assert not [name for name in channels if name.startswith("CryptoInstance")]


def test_turntable_writes_all_kinds_into_each_frame(folder, capsys):
    pytest.importorskip("mmh3")
    code, _, err = run(capsys, "turntable", *ROOM, "--count", "2", "--cryptomatte", "-o", "t.#.exr", "--formats", "exr")
    assert code == 0, err
    assert listing(folder) == ["t.1.exr", "t.2.exr"]
    first, second = (exr.read(f"t.{number}.exr")[0] for number in (1, 2))
    assert {name[:-4] for name in first if name.startswith("Crypto")} == {
        "CryptoObject",
        "CryptoMaterial",
        "CryptoInstance",
    }
    assert (first["CryptoObject00.G"] != second["CryptoObject00.G"]).any()


def test_others_find_the_parts(folder, capsys):
    pytest.importorskip("mmh3")
    oiio = pytest.importorskip("OpenImageIO")
    assert run(capsys, "render", *ROOM, "--cryptomatte", "object", "-o", "room", "--quiet")[0] == 0
    image = oiio.ImageInput.open("room.exr")
    assert image.seek_subimage(1, 0)
    names = [attribute for attribute in image.spec().extra_attribs if attribute.name.startswith("cryptomatte/")]
    manifest = next(json.loads(name.value) for name in names if name.name.endswith("/manifest"))
    assert len(manifest) == len(clshade.builtin("box_room").meshes)


# Saved scenes


@pytest.mark.long
def test_the_scene_draws_the_same_picture(capsys, tmp_path):
    saved = tmp_path / "scene.json"
    options = ("--lights", "1", "--light-intensity", "0.5", "--camera-azimuth-angle", "20")
    code, out, err = run(capsys, *SMALL, *options, "--save-scene", saved, "-o", tmp_path / "a")
    assert code == 0, err
    assert err[-1].endswith(f"wrote {saved}")
    assert "wrote" in out
    scene = clshade.load(saved)
    assert (scene.preset, scene.camera.resolution, len(scene.lights)) == ("course", (32, 24), 1)
    binary = json.loads(saved.read_text())["arrays"]["file"]
    assert listing(tmp_path) == ["a.exr", "a.png", "scene.json", binary]
    code, _, err = run(capsys, "render", saved, "--layers", "Z,id", "-o", tmp_path / "b")
    assert code == 0, err
    (first, _), (second, _) = (exr.read(tmp_path / f"{name}.exr") for name in "ab")
    assert set(first) == set(second)
    for name, channel in first.items():
        assert np.array_equal(channel.view(np.uint32), second[name].view(np.uint32)), name


@pytest.mark.long
def test_a_scene_for_other_programs(capsys, tmp_path):
    saved = tmp_path / "scene.GLB"
    code, _, err = run(capsys, "render", "teapot", "--resolution", "40,20", "--save-scene", saved, "-o", tmp_path / "a")
    assert code == 0, err
    assert listing(tmp_path) == ["a.exr", "a.png", "scene.GLB"]
    scene = clshade.load(saved)
    columns, rows = scene.camera.resolution
    assert columns == 2 * rows
    assert scene.face_count == clshade.builtin("teapot").face_count


def test_standard_output_stays_json(capsys, tmp_path):
    code, out, _ = run(capsys, *SMALL, "--json", "--save-scene", tmp_path / "s.json", "-o", tmp_path / "a")
    assert code == 0
    assert json.loads(out)["resolution"] == [32, 24]
