"""Options of every command: quiet, verbose, before and after its name; and `render` of several scenes."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, run
from scene_files import TRIANGLE, write

import clshade
from clshade.cli import DONE, render
from clshade.cli.main import COMMANDS, _parser, main
from clshade.images import exr

SIZE = ("--resolution", "32,24")
COUNTED = ("inspect", "view", "coco", "grade", "verify")
NEEDED = {**dict.fromkeys(COUNTED, 1), "compare": 2, "animate": 2}  # arguments without an option


@pytest.fixture
def scenes(tmp_path):
    """Write three files to a folder: a triangle, one that is not a scene, the triangle again."""
    folder = tmp_path / "in"
    folder.mkdir()
    for name, text in (("a.obj", TRIANGLE + "f 1 2 3\n"), ("bad.obj", "v 1 2\n"), ("c.obj", TRIANGLE + "f 1 2 3\n")):
        write(folder / name, text)
    return [folder / name for name in ("a.obj", "bad.obj", "c.obj")]


# Several scenes


@pytest.mark.long
@needs_device
def test_several_scenes_go_to_a_folder(tmp_path, capsys, scenes):
    code, out, err = run(capsys, "render", scenes[0], scenes[2], "quads", *SIZE, "-o", tmp_path / "new")
    assert (code, err) == (0, [])
    expected = [f"{name}.{kind}" for name in ("a", "c", "quads") for kind in ("exr", "png")]
    assert listing(tmp_path / "new") == expected
    assert out.count("wrote") == 3
    assert exr.read(tmp_path / "new" / "a.exr")[0]["A"].sum() > 20
    run(capsys, "render", "quads", *SIZE, "-o", tmp_path / "one", "--deterministic")
    run(capsys, "render", "quads", scenes[0], *SIZE, "-o", tmp_path / "new", "--deterministic")
    assert (tmp_path / "new" / "quads.exr").read_bytes() == (tmp_path / "one.exr").read_bytes()


@needs_device
def test_a_bad_scene_does_not_stop_the_others(folder, capsys, scenes):
    missing = folder / "none.obj"
    code, out, err = run(capsys, "render", *scenes, missing, *SIZE, "--json")
    assert code == 2
    assert listing(folder) == ["a.exr", "a.png", "c.exr", "c.png", "in", "in/a.obj", "in/bad.obj", "in/c.obj"]
    assert len(err) == 2
    assert str(scenes[1]) in err[0]
    assert str(missing) in err[1]
    found = json.loads(out)
    assert [each["scene"] for each in found] == [str(path) for path in (*scenes, missing)]
    assert ["error" in each for each in found] == [False, True, False, True]
    assert found[2]["resolution"] == [32, 24]


@needs_device
def test_an_option_that_one_scene_refuses_names_it(tmp_path, capsys, scenes):
    code, _, err = run(capsys, "render", "quads", scenes[0], *SIZE, "--lights", "2", "-o", tmp_path / "new")
    assert (code, len(err)) == (2, 1)
    assert err[0].startswith("clshade: quads: --lights")
    assert listing(tmp_path / "new") == ["a.exr", "a.png"]


@pytest.mark.parametrize("others", [("sub/a.obj",), ("b.obj", "A.glb"), ("in/a.obj",), ("a.exr.ply",)])
def test_scenes_of_one_name_are_refused_before_any_is_loaded(tmp_path, capsys, monkeypatch, others):
    monkeypatch.setattr(render, "load_scene", lambda *arguments: pytest.fail("a scene was loaded"))
    monkeypatch.chdir(tmp_path)
    assert_refused(run(capsys, "render", "in/a.obj", *others, "-o", "new"), "in/a.obj", others[-1], ".exr", "new")
    assert listing(tmp_path) == []


def test_a_folder_that_stays_empty_is_not_left_behind(tmp_path, capsys):
    code, _, err = run(capsys, "render", "none.obj", "neither.obj", "-o", tmp_path / "new")
    assert code == 2
    assert err
    assert listing(tmp_path) == []
    (tmp_path / "file").write_bytes(b"")
    assert_refused(run(capsys, "render", "quads", "box_room", "-o", tmp_path / "file" / "new"), "file/new", "cannot be")


@needs_device
def test_one_scene_into_a_folder(tmp_path, capsys):
    assert run(capsys, *SMALL, "-o", f"{tmp_path}/new/")[0] == 0
    assert listing(tmp_path) == ["new", "new/quads.exr", "new/quads.png"]


# Verbosity


@needs_device
def test_quiet_prints_errors_alone(tmp_path, capsys):
    mesh = write(tmp_path / "a.obj", "mtllib none.mtl\n" + TRIANGLE + "f 1 2 3\n")
    given = ("render", mesh, *SIZE, "--look", "plain", "-o", tmp_path / "out")
    assert run(capsys, *given)[2] != []  # a warning that the library is missing
    assert run(capsys, *given, "--quiet") == (0, "", [])
    assert run(capsys, "--quiet", *given) == (0, "", [])
    code, out, err = run(capsys, *given, "-q", "--json")
    assert (code, err) == (0, [])
    assert json.loads(out)["triangles"] == 1
    assert_refused(run(capsys, "-q", "render", tmp_path / "none.obj"), "none.obj")


def test_quiet_says_nothing_of_slow_files_and_half_floats(tmp_path, capsys, monkeypatch):
    from clshade.base import console

    def slow(arguments):
        console.progress("loading")
        console.detail("loaded")
        console.warning("half")
        return DONE

    monkeypatch.setattr(render, "run_render", slow)
    assert run(capsys, "render", "-q")[2] == []
    assert run(capsys, "render")[2] == ["clshade: loading", "clshade: warning: half"]
    assert run(capsys, "render", "-v")[2] == ["clshade: loading", "clshade: loaded", "clshade: warning: half"]


@needs_device
def test_verbose_says_what_is_done_on_standard_error(tmp_path, capsys):
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / "a", "--verbose", "--json")
    assert code == 0
    assert json.loads(out)["resolution"] == [32, 24]
    assert any(line.startswith("clshade: loaded quads: ") and line.endswith(" ms") for line in err), err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_the_general_options(name):
    taken = _parser([name]).parse_args(["--quiet", name, *(["x"] * NEEDED.get(name, 0))])
    assert (taken.quiet, taken.verbose, taken.debug) == (True, False, False)
    taken = _parser([name]).parse_args(["--debug", name, *(["x"] * NEEDED.get(name, 0)), "-v"])
    assert (taken.quiet, taken.verbose, taken.debug) == (False, True, True)


def test_every_option_of_every_command_is_explained():
    """Units and defaults: the help of a number states at least its unit."""
    for name in COMMANDS:
        parser = _parser([name])
        (commands,) = (action for action in parser._actions if action.dest == "command")
        for action in commands.choices[name]._actions:  # type: ignore[union-attr, index]
            assert action.help, (name, action.dest)


def test_the_version(capsys):
    assert run(capsys, "--version") == (0, f"clshade {clshade.__version__}\n", [])


def test_without_standard_output_and_quiet(tmp_path, monkeypatch):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    monkeypatch.setattr("sys.stdout", None)
    assert main(["inspect", "-q", str(tmp_path / "a.exr")]) == 0


@needs_device
def test_scenes_whose_names_hold_another_extension(folder, capsys):
    for name in ("a.jpg.obj", "b.v2.obj"):
        write(folder / name, TRIANGLE + "f 1 2 3\n")
    code, _, err = run(capsys, "render", "a.jpg.obj", "b.v2.obj", *SIZE, "-o", "new")
    assert (code, err) == (0, [])
    assert listing(folder / "new") == ["a.jpg.exr", "a.jpg.png", "b.v2.exr", "b.v2.png"]
