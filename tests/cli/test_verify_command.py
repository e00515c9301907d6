"""`clshade verify`: images that the command line drew, found again by their headers."""

from __future__ import annotations

import json
import shutil

from command_line import assert_refused, needs_device, run

from clshade.images import exr
from clshade.pipeline import renderer
from clshade.pipeline.frame_results import RECORD, sealed

CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
SMALL = ("--resolution", "64,48", "--samples", "1", "-q")
pytestmark = needs_device


def with_command(path, command):
    """Write an image anew whose header has another command and the seal that belongs to it."""
    planes, header = exr.read(path)
    record = {**json.loads(header[RECORD]), "command": command}
    metadata = {name: value for name, value in header.items() if name not in exr.PROTECTED}
    exr.write(path, planes, metadata=sealed(metadata, record))


def test_an_image_is_found_again_by_its_header(folder, capsys):
    """From where it was drawn, and elsewhere with its scene beside it."""
    (folder / "solid.obj").write_text(CUBE)
    moved = ("--camera-azimuth-angle", "30", "--look", "plain", "--flat", "--light-intensity", "0.5")
    assert run(capsys, "render", "solid.obj", "-o", "out", *moved, *SMALL)[0] == 0
    code, out, err = run(capsys, "verify", "out.exr", "--all")
    assert (code, err) == (0, [])
    assert "0 of 3,072 pixels are wrong: every one was looked at" in out
    new_folder = folder / "other"
    new_folder.mkdir()
    for name in ("out.exr", "out.png", "solid.obj"):
        shutil.move(folder / name, new_folder / name)
    code, out, _ = run(capsys, "verify", "other/out.exr", "--json", "--seed", "7", "--pixels", "100")
    verdict = json.loads(out)
    assert (code, verdict["passed"], verdict["pixels"], verdict["seed"]) == (0, True, 100, 7)
    (new_folder / "solid.obj").write_text(CUBE.replace("v 1 0 0", "v 1.0000001 0 0"))
    code, out, _ = run(capsys, "verify", "other/out.exr")
    assert code == 1
    assert "the scene is not the one that was drawn: its meshes" in out
    (folder / "given").mkdir()
    (folder / "given" / "solid.obj").write_text(CUBE)
    assert run(capsys, "verify", "other/out.exr", "given/solid.obj", "--all")[0] == 0
    (new_folder / "solid.obj").unlink()
    assert_refused(run(capsys, "verify", "other/out.exr"), "solid.obj", "no such file")


def test_commands_of_strangers_do_nothing(folder, capsys):
    assert run(capsys, "render", "icosphere", "-o", "out", "--layers", "Z", *SMALL)[0] == 0
    before = sorted(folder.iterdir())
    drawn = "--samples=1 --resolution=64,48"
    for command, expected in (
        ("rm -rf out.exr", "expected clshade render"),
        ("clshade render icosphere --no-such-option", "there is no option"),
        ("clshade render icosphere teapot", "expected one scene, found 2"),
        ("clshade render /dev/zero.obj", "found no such file"),
        ("clshade render --samples=" + "9" * 5000, "verify: the header's command"),
        ("clshade render nothing.obj --save-scene=made.glb -o made", "nothing.obj"),
    ):
        with_command(folder / "out.exr", command)
        assert_refused(run(capsys, "verify", "out.exr"), expected)
    with_command(folder / "out.exr", f"clshade render icosphere {drawn} --save-scene=made.glb --output=made")
    assert run(capsys, "verify", "out.exr")[0] == 0
    assert sorted(folder.iterdir()) == before
    # It may not name another camera or other settings than those that the pixels show.
    for changed, expected in (
        ("--camera-azimuth-angle=77", "camera: the header differs from its command in eye"),
        ("--shadows --samples=16", "settings: the header differs from its command in s"),
    ):
        with_command(folder / "out.exr", f"clshade render icosphere {drawn} {changed}")
        code, out, _ = run(capsys, "verify", "out.exr")
        assert code == 1
        assert expected in out


def test_a_contact_shadow_is_computed_again_without_a_device(folder, monkeypatch, capsys):
    (folder / "solid.obj").write_text(CUBE)
    assert run(capsys, "render", "solid.obj", "-o", "out", *SMALL)[0] == 0
    monkeypatch.setattr(renderer, "Renderer", None)
    assert run(capsys, "verify", "out.exr", "--all")[0] == 0
