"""Options for output files: --formats, --depth-scale, --stereo, --save-cameras, and what is refused before drawing."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, run

from clshade.farm import read_cameras
from clshade.images import depth_png, exr, png
from clshade.scene.builtin.scenes import builtin

TURN = ("turntable", *SMALL[1:], "--count", "2")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Make the test's folder the current one."""
    monkeypatch.chdir(tmp_path)


@needs_device
def test_formats_of_render(tmp_path, capsys):
    code, out, _ = run(capsys, *SMALL, "--formats", "png,npz,depth", "--depth-scale", "0.0005", "--deterministic")
    assert (code, listing(tmp_path)) == (0, ["out.depth.png", "out.npz", "out.png"])
    assert all(name in out for name in listing(tmp_path))
    assert "out.exr" not in out
    with np.load("out.npz", allow_pickle=False) as arrays:
        found = dict(arrays)
    depth, scale = depth_png.read("out.depth.png")
    seen = found["id"] > 0
    assert scale == 0.0005
    assert np.array_equal(np.isfinite(depth), seen)
    assert np.abs(depth[seen] - found["Z"][seen]).max() <= scale / 2 * (1 + 1e-9)
    camera = builtin("quads", resolution=(32, 24)).camera
    np.testing.assert_allclose(found["K"], camera.to_matrix()[0], rtol=0, atol=1e-12)
    before = {name: (tmp_path / name).read_bytes() for name in listing(tmp_path)}
    assert run(capsys, *SMALL, "--formats", "depth,npz,png", "--depth-scale", "0.0005", "--deterministic")[0] == 0
    assert {name: (tmp_path / name).read_bytes() for name in listing(tmp_path)} == before


@needs_device
def test_a_name_that_ends_in_npz(tmp_path, capsys):
    assert run(capsys, *SMALL, "-o", "a.npz", "--quiet")[0] == 0
    assert run(capsys, *SMALL, "-o", "b.npz", "--formats", "png", "--quiet")[0] == 0
    assert run(capsys, *TURN, "-o", "c.#.npz", "--quiet")[0] == 0
    assert listing(tmp_path) == ["a.npz", "b.png", "c.1.npz", "c.2.npz"]


@needs_device
def test_depth_adds_its_layer(tmp_path, capsys):
    command = ("render", "quads", "--resolution", "32,24", "--preset", "course", "--layers", "id", "--quiet")
    assert run(capsys, *command, "--formats", "exr,depth")[0] == 0
    assert {"Z", "id"} <= set(exr.read("out.exr")[0])


@needs_device
def test_a_turn_of_two_eyes_with_its_cameras(tmp_path, capsys):
    """What is there is skipped; the cameras that were saved draw the same frames."""
    command = (*TURN, "--formats", "npz,depth", "--stereo", "0.5", "--convergence", "9", "-o", "a/f.##.exr")
    code, out, _ = run(capsys, *command, "--save-cameras", "a/c.json", "--json")
    eyes = ("left", "right")
    kinds = ("depth.png", "npz")
    names = [f"a/f.{eye}.{k:02d}.{kind}" for eye in eyes for k in (1, 2) for kind in kinds]
    assert (code, listing(tmp_path)) == (0, sorted(["a", *(f"a/c.{eye}.json" for eye in eyes), *names]))
    found = json.loads(out)
    assert [(found[eye]["drawn"], found[eye]["files"]) for eye in eyes] == [(2, ["npz", "depth"])] * 2
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


@needs_device
@pytest.mark.parametrize("kind", ["exr", "png", "npz", "depth"])
def test_frames_of_another_size(tmp_path, capsys, kind):
    """Each kind alone: refused in a line, nothing is drawn or changed."""
    command = (*TURN, "--formats", kind, "-o", "f.#")
    assert run(capsys, *command, "--frames", "1", "--quiet")[0] == 2  # --count and --frames
    first = ("turntable", *SMALL[1:], "--frames", "1", "--formats", kind, "-o", "f.#", "--quiet")
    assert run(capsys, *first)[0] == 0
    (name,) = listing(tmp_path)
    before = (tmp_path / name).read_bytes()
    found = run(capsys, *command, "--resolution", "16,12")
    assert_refused(found, f"{name}: expected 16x12 of the frames to draw, found 32x24 of an earlier run: --overwrite")
    assert listing(tmp_path) == [name]
    assert (tmp_path / name).read_bytes() == before


REFUSED = [
    ((*SMALL, "--formats", "exr,pgn"), ("--formats", "exr, png, npz, depth", "did you mean 'png'?")),
    ((*SMALL, "--formats", "numpy"), ("did you mean 'npz'?",)),
    ((*SMALL, "--formats", ""), ("--formats", "expected")),
    ((*SMALL, "--depth-scale", "0.01"), ("--depth-scale: needs --formats depth",)),
    ((*SMALL, "--formats", "depth", "--depth-scale", "0"), ("depth_scale: expected a finite number above 0",)),
    ((*SMALL, "--formats", "depth", "--depth-scale", "mm"), ("--depth-scale", "a number")),
    (
        (*SMALL, "--formats", "depth,exr", "--depth-scale", "1e-6"),
        ("depth_scale: expected ", " or more, as 65535 steps"),
    ),
    ((*SMALL, "--formats", "npz", "--sheet"), ("--formats: cannot go with --sheet",)),
    ((*SMALL, "--formats", "png", "--flow-to", "c.json"), ("--flow-to: needs exr or npz in --formats", "not png")),
    ((*TURN, "--formats", "png,depth", "--flow"), ("flow: needs exr or npz among the files, which hold it",)),
    ((*SMALL, "--stereo", "0"), ("Camera.stereo: baseline: expected a finite number above 0, found 0",)),
    ((*SMALL, "--stereo", "nan"), ("baseline",)),
    ((*SMALL, "--convergence", "3"), ("--convergence: needs --stereo BASELINE",)),
    ((*SMALL, "--stereo", "1", "--convergence", "-3"), ("convergence: expected a finite number above 0, found -3",)),
    ((*SMALL, "--stereo", "1", "--views", "front"), ("--stereo: cannot go with --views",)),
    ((*SMALL, "--stereo", "1", "--sheet"), ("--stereo: cannot go with --sheet",)),
    ((*SMALL, "--stereo", "1", "--orthographic"), ("expected a perspective camera, found an orthographic one",)),
    ((*TURN, "--convergence", "3"), ("--convergence: needs --stereo BASELINE",)),
    ((*TURN, "--stereo", "-1"), ("baseline: expected a finite number above 0, found -1",)),
    ((*TURN, "--formats", "npz", "-o", "a.mp4"), ("--formats: cannot go with a film, a.mp4",)),
    ((*TURN, "--save-cameras", "out.0001.exr/c.json"), ("out.0001.exr", "is not a folder")),
    ((*TURN, "--formats", "depth", "--depth-scale", "1e-6", "-o", "new/#.exr"), ("frame 1: ", "65535 steps")),
]


@needs_device
@pytest.mark.parametrize(("arguments", "parts"), REFUSED)
def test_refused_command_lines(tmp_path, capsys, arguments, parts):
    (tmp_path / "out.0001.exr").write_text("earlier")
    (tmp_path / "out.exr").write_text("earlier")
    assert_refused(run(capsys, *arguments), *parts)
    assert listing(tmp_path) == ["out.0001.exr", "out.exr"]
    assert {(tmp_path / name).read_text() for name in listing(tmp_path)} == {"earlier"}


@needs_device
def test_a_stereo_pair_with_magnified_crops(tmp_path, capsys):
    command = (*SMALL, "--stereo", "0.5", "--crop-zoom", "2,3,8,6", "--json", "--formats", "png")
    code, out, _ = run(capsys, *command)
    assert code == 0
    assert [each["resolution"] for each in json.loads(out)["stereo"].values()] == [[32, 24]] * 2
    assert listing(tmp_path) == [
        f"out.{eye}{ending}.png" for eye in ("left", "right") for ending in ("", "_crop", "_marked")
    ]
    left, right = (png.read(f"out.{eye}.png") for eye in ("left", "right"))
    assert (left != right).any()
