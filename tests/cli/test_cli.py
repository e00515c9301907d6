"""The command line: files, exit codes, one line on stderr for any refusal, and nothing left behind; options of every
command: quiet, verbose, before and after its name; and `render` of several scenes."""

from __future__ import annotations

import json
import os
import re
import sys
import threading

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, process, run, scene_of, without_notices
from devices import is_tested, working_devices
from processes import ROOT
from scene_files import TRIANGLE, write

import clshade
from clshade.base import console, interrupts
from clshade.cli import DONE, render
from clshade.cli.main import COMMANDS, _parser, main
from clshade.images import exr, png
from clshade.pipeline.frame_results import RECORD, SEAL

SIZE = ("--resolution", "32,24")
COUNTED = ("inspect", "view", "coco", "grade", "verify")
NEEDED = {**dict.fromkeys(COUNTED, 1), "compare": 2, "animate": 2}  # arguments without an option


# Rendering


@needs_device
@pytest.mark.parametrize(
    ("output", "stem"),
    [("picture", "picture"), ("picture.exr", "picture"), ("a.png", "a"), ("v1.2", "v1.2"), ("sub/x", "sub/x")],
)
def test_render_writes_an_exr_and_a_png(tmp_path, capsys, output, stem):
    (tmp_path / "sub").mkdir()
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / output)
    assert (code, err) == (0, [])
    assert listing(tmp_path) == sorted([f"{stem}.exr", f"{stem}.png", "sub"])
    assert "32x24" in out
    assert f"{stem}.exr" in out
    channels, _ = exr.read(tmp_path / f"{stem}.exr")
    assert set(channels) == {"R", "G", "B", "A", "Z", "id"}
    assert channels["R"].shape == (24, 32)
    assert png.read(tmp_path / f"{stem}.png").shape == (24, 32, 3)


@needs_device
def test_options_reach_the_image(tmp_path, capsys):
    options = ("--deterministic", "--stats")
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / "a", *options)
    assert (code, err) == (0, [])
    stats = json.loads(out)
    assert stats["resolution"] == [32, 24]
    assert "phong" in stats["times_ms"]
    channels, header = exr.read(tmp_path / "a.exr")
    assert channels["id"].min() > 0
    assert "renderTimeSeconds" not in header
    first = (tmp_path / "a.exr").read_bytes()
    assert run(capsys, *SMALL, "-o", tmp_path / "b", *options)[0] == 0
    assert (tmp_path / "b.exr").read_bytes() == first
    assert run(capsys, *SMALL, "-o", tmp_path / "c", *options, "--lights", "1")[0] == 0
    assert exr.read(tmp_path / "c.exr")[0]["G"].mean() < channels["G"].mean()


def test_options_reach_the_scene():
    plain, chosen = scene_of("quads"), scene_of("quads", "--lights", "1", "--components", "ambient,specular")
    assert len(plain.lights) == 2
    assert [light.position.tolist() for light in chosen.lights] == [plain.lights[1].position.tolist()]
    was, now = plain.meshes[0].material, chosen.meshes[0].material
    assert (now.ka.tolist(), now.kd.tolist(), now.ks.tolist()) == (was.ka.tolist(), [0, 0, 0], was.ks.tolist())


@needs_device
def test_exposure_and_tone_map_change_the_png_alone(tmp_path, capsys):
    run(capsys, *SMALL, "-o", tmp_path / "a", "--deterministic")
    run(capsys, *SMALL, "-o", tmp_path / "b", "--deterministic", "--exposure", "-2", "--tonemap", "aces")
    (planes, header), (planes_b, header_b) = (exr.read(tmp_path / f"{name}.exr") for name in "ab")
    assert all(planes[name].tobytes() == planes_b[name].tobytes() for name in planes)
    assert {name for name in header if str(header[name]) != str(header_b[name])} == {
        RECORD,
        SEAL,
    }  # how the PNG is made
    assert png.read(tmp_path / "a.png").mean() > png.read(tmp_path / "b.png").mean() + 5


# Refusals


def test_refusals_as_a_process(tmp_path):
    """Exit code, one line, no traceback, as seen by a shell."""
    for arguments in (("render", "none.obj"), ("render", "--shader", "flat")):
        done = process(*arguments, cwd=tmp_path)
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(without_notices(done.stderr)) == 1
        assert done.stderr.startswith("clshade")
    assert listing(tmp_path) == []


def test_debug_shows_the_traceback(tmp_path):
    done = process("--debug", "render", "none.obj", cwd=tmp_path)
    assert done.returncode != 0
    assert "Traceback" in done.stderr
    assert "none.obj" in done.stderr


def test_interrupted(capsys, monkeypatch):
    def stop(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(render, "load_scene", stop)
    monkeypatch.setattr(interrupts, "_told", threading.Lock())  # another test of this process may have been interrupted
    code, out, err = run(capsys, *SMALL)
    assert (code, out) == (130, "")
    assert len(err) == 1


@pytest.mark.parametrize(("error", "line"), [(MemoryError(), ""), (MemoryError("9 GiB\nwanted"), ": 9 GiB wanted")])
def test_out_of_memory(capsys, monkeypatch, error, line):
    def stop(*arguments):
        raise error

    monkeypatch.setattr(render, "load_scene", stop)
    assert run(capsys, *SMALL) == (2, "", [f"clshade: out of memory{line}"])
    with pytest.raises(MemoryError):
        run(capsys, "--debug", *SMALL)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "module", ["argparse", "clshade.errors", "clshade.cli.main", "clshade.scene.model", "numpy", "_signal"]
)
def test_interrupted_while_importing(tmp_path, module):
    code = f"""
import os, signal, sys
def interrupt(*arguments):
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1_000_000_000):  # until the interrupt comes
        pass
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            interrupt()
sys.meta_path.insert(0, Interrupt())
if {module!r} == "_signal":  # not imported any more: between the imports and the scene
    import clshade.cli.main
    clshade.cli.main.join_values  # there
    clshade.cli.main.join_values = interrupt
"""
    (tmp_path / "sitecustomize.py").write_text(code)
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    done = process("render", "quads", cwd=tmp_path, PYTHONPATH=path, PYTHONDONTWRITEBYTECODE="1")
    assert done.returncode == 130, done.stderr
    assert done.stderr in ("", "clshade: interrupted\n")
    assert listing(tmp_path) == ["sitecustomize.py"]


# Standard output


@pytest.mark.sampled
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("inspect", "a.exr"), ("render", *SMALL[1:])])
def test_a_full_disk_behind_standard_output(tmp_path, arguments):
    if arguments[0] == "render" and not working_devices():
        pytest.skip("no OpenCL device works here")
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    with open("/dev/full", "w") as full:
        done = process(*arguments, cwd=tmp_path, stdout=full)
    assert without_notices(done.stderr) == ["clshade: standard output: cannot be written: No space left on device"]
    assert done.returncode == 2


@pytest.mark.parametrize("arguments", [("--help",), ("inspect", "a.exr")])
def test_nobody_reads_standard_output(tmp_path, arguments):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    reader, writer = os.pipe()
    os.close(reader)
    done = process(*arguments, cwd=tmp_path, stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("options", [(), ("-q",)])
def test_without_standard_output(tmp_path, monkeypatch, options):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["inspect", *options, str(tmp_path / "a.exr")]) == 0


# The other commands


def test_help_and_version(capsys):
    for arguments in (("--help",), ("render", "--help"), ("devices", "--help"), ("inspect", "--help"), ("--version",)):
        code, out, err = run(capsys, *arguments)
        assert (code, err) == (0, [])
        assert out.startswith(("usage: clshade", "clshade "))
    assert out == f"clshade {clshade.__version__}\n"
    help_text = run(capsys, "render", "--help", "all")[1]
    names = ("shader", "preset", "resolution", "layers", "tonemap", "exposure", "device", "stats")
    assert all(f"--{name}" in help_text for name in names)


def options_in(help_text):
    return re.findall(r"^  (?:-\w\b[^-]*)?(--[a-z-]+)", help_text, re.M)


@pytest.mark.parametrize("command", ["render", "turntable", "animate", "poster", "view", "report", "stability"])
def test_help_begins_with_the_options_that_people_use_first(command, capsys):
    code, out, err = run(capsys, command, "--help")
    assert (code, err) == (0, [])
    assert 10 <= len(options_in(out)) <= 16
    assert options_in(out)[0] in ("--output", "--out")
    assert len(out.splitlines()) < 80
    topics = re.findall(r"^  ([a-z]+)(?:  .*)?$", out.split("--help TOPIC\n")[1], re.M)
    assert topics[-1] == "general"
    every = set(options_in(run(capsys, command, "--help", "all")[1]))
    assert f"all {len(every)} options" in out
    by_topic = [options_in(run(capsys, command, "--help", topic)[1]) for topic in topics]
    assert all(by_topic)
    assert every == {"--help", *options_in(out)}.union(*by_topic)


def test_help_on_few_options_shows_all(capsys):
    out = run(capsys, "inspect", "--help")[1]
    assert out == run(capsys, "inspect", "--help", "all")[1]
    assert "--pixel" in out


def test_inspect_reads_the_file_once(tmp_path, capsys, monkeypatch):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    reads, read = [], exr.read
    monkeypatch.setattr(exr, "read", lambda path: reads.append(path) or read(path))
    assert run(capsys, "inspect", tmp_path / "a.exr")[0] == 0
    assert reads == [str(tmp_path / "a.exr")]


@pytest.mark.long
def test_devices_as_json(capsys):
    code, out, err = run(capsys, "devices", "--json")
    assert (code == 0, err) == (bool(working_devices()), [])
    listed = (info for info in json.loads(out) if info["works"] and is_tested(info["platform"]))
    assert tuple(info["index"] for info in listed) == working_devices()


# Several scenes


@pytest.fixture
def scenes(tmp_path):
    """Write three files to a folder: a triangle, one that is not a scene, the triangle again."""
    folder = tmp_path / "in"
    folder.mkdir()
    for name, text in (("a.obj", TRIANGLE + "f 1 2 3\n"), ("bad.obj", "v 1 2\n"), ("c.obj", TRIANGLE + "f 1 2 3\n")):
        write(folder / name, text)
    return [folder / name for name in ("a.obj", "bad.obj", "c.obj")]


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
    records = json.loads(out)
    assert [record["scene"] for record in records] == [str(path) for path in (*scenes, missing)]
    assert ["error" in record for record in records] == [False, True, False, True]
    assert records[2]["resolution"] == [32, 24]


@needs_device
def test_an_option_that_one_scene_refuses_names_it(tmp_path, capsys, scenes):
    code, _, err = run(capsys, "render", "quads", scenes[0], *SIZE, "--lights", "2", "-o", tmp_path / "new")
    assert (code, len(err)) == (2, 1)
    assert err[0].startswith("clshade: quads: --lights")
    assert listing(tmp_path / "new") == ["a.exr", "a.png"]


@pytest.mark.parametrize("paths", [("sub/a.obj",), ("b.obj", "A.glb"), ("in/a.obj",), ("a.exr.ply",)])
def test_scenes_of_one_name_are_refused_before_any_is_loaded(tmp_path, capsys, monkeypatch, paths):
    monkeypatch.setattr(render, "load_scene", lambda *arguments: pytest.fail("a scene was loaded"))
    monkeypatch.chdir(tmp_path)
    assert_refused(run(capsys, "render", "in/a.obj", *paths, "-o", "new"), "in/a.obj", paths[-1], ".exr", "new")
    assert listing(tmp_path) == []


def test_a_folder_that_stays_empty_is_not_left_behind(tmp_path, capsys):
    code, _, err = run(capsys, "render", "none.obj", "neither.obj", "-o", tmp_path / "new")
    assert code == 2
    assert err
    assert listing(tmp_path) == []


@needs_device
def test_one_scene_into_a_folder(tmp_path, capsys):
    assert run(capsys, *SMALL, "-o", f"{tmp_path}/new/")[0] == 0
    assert listing(tmp_path) == ["new", "new/quads.exr", "new/quads.png"]


# Verbosity


@needs_device
def test_quiet_prints_errors_alone(tmp_path, capsys):
    mesh = write(tmp_path / "a.obj", "mtllib none.mtl\n" + TRIANGLE + "f 1 2 3\n")
    command = ("render", mesh, *SIZE, "--look", "plain", "-o", tmp_path / "out")
    assert run(capsys, *command)[2] != []  # a warning that the library is missing
    assert run(capsys, *command, "--quiet") == (0, "", [])
    assert run(capsys, "--quiet", *command) == (0, "", [])
    code, out, err = run(capsys, *command, "-q", "--json")
    assert (code, err) == (0, [])
    assert json.loads(out)["triangles"] == 1
    assert_refused(run(capsys, "-q", "render", tmp_path / "none.obj"), "none.obj")


def test_quiet_says_nothing_of_slow_files_and_half_floats(tmp_path, capsys, monkeypatch):
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


@needs_device
def test_scenes_whose_names_hold_another_extension(folder, capsys):
    for name in ("a.jpg.obj", "b.v2.obj"):
        write(folder / name, TRIANGLE + "f 1 2 3\n")
    code, _, err = run(capsys, "render", "a.jpg.obj", "b.v2.obj", *SIZE, "-o", "new")
    assert (code, err) == (0, [])
    assert listing(folder / "new") == ["a.jpg.exr", "a.jpg.png", "b.v2.exr", "b.v2.png"]
