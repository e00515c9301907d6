"""The command line: files, exit codes, refusals, interrupts, standard output, help; `render` of several scenes."""

import json
import os
import re
import threading
from unittest.mock import Mock

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, process, run, without_notices
from devices import is_tested, working_devices
from processes import ROOT
from scene_files import TRIANGLE, write

import clshade
from clshade.base import interrupts
from clshade.cli import render
from clshade.cli.main import COMMANDS
from clshade.errors import InputError
from clshade.images import exr, png
from clshade.pipeline.frame_results import RECORD, SEAL

SIZE = ("--resolution", "32,24")
FACE = TRIANGLE + "f 1 2 3\n"


@needs_device
def test_render_writes_an_exr_and_a_png(folder, capsys):
    for output, stem in (("picture.exr", "picture"), ("v1.2", "v1.2"), ("new/", "new/quads")):
        code, out, err = run(capsys, *SMALL, "-o", output)
        assert (code, err) == (0, [])
        assert "32x24" in out
        assert f"{stem}.exr" in out
        channels, _ = exr.read(f"{stem}.exr")
        assert set(channels) == {"R", "G", "B", "A", "Z", "id"}
        assert png.read(f"{stem}.png").shape == (24, 32, 3)
    stems = ("new/quads", "picture", "v1.2")
    assert listing(folder) == ["new", *(f"{stem}.{kind}" for stem in stems for kind in ("exr", "png"))]


@needs_device
def test_options_reach_the_image(folder, capsys):
    def drawn(*options):
        code, out, err = run(capsys, *SMALL, "-o", "a", "--deterministic", "--stats", *options)
        assert (code, err) == (0, [])
        return (folder / "a.exr").read_bytes(), exr.read("a.exr"), png.read("a.png"), json.loads(out)

    data, (channels, header), picture, stats = drawn()
    assert stats["resolution"] == [32, 24]
    assert "renderTimeSeconds" not in header
    assert drawn()[0] == data
    _, (dark, dark_header), dark_picture, _ = drawn("--exposure", "-2", "--tonemap", "aces")
    assert all(channels[name].tobytes() == dark[name].tobytes() for name in channels)
    changed = {name for name in header if str(header[name]) != str(dark_header[name])}
    assert changed == {RECORD, SEAL}  # how the PNG is made
    assert picture.mean() > dark_picture.mean() + 5


def test_a_refusal_as_a_process(tmp_path, capsys):
    done = process("render", "none.obj", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(without_notices(done.stderr)) == 1
    assert done.stderr.startswith("clshade")
    assert listing(tmp_path) == []
    with pytest.raises(InputError, match=r"none\.obj"):
        run(capsys, "--debug", "render", "none.obj")


@pytest.mark.parametrize(("error", "code", "line"), [
    (MemoryError("9 GiB\nwanted"), 2, "out of memory: 9 GiB wanted"), (KeyboardInterrupt(), 130, "interrupted"),
])  # fmt: skip
def test_out_of_memory_and_interrupted(capsys, monkeypatch, error, code, line):
    monkeypatch.setattr(render, "load_scene", Mock(side_effect=error))
    monkeypatch.setattr(interrupts, "_told", threading.Lock())  # another test of this process may have been interrupted
    assert run(capsys, *SMALL) == (code, "", [f"clshade: {line}"])


@pytest.mark.sampled
@pytest.mark.parametrize("module", ["numpy", "_signal"])
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


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("arguments", [("--help",), ("inspect", "a.exr")])
def test_standard_output_that_is_full_or_read_by_nobody(tmp_path, arguments):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    with open("/dev/full", "w") as full:
        done = process(*arguments, cwd=tmp_path, stdout=full)
    assert without_notices(done.stderr) == ["clshade: standard output: cannot be written: No space left on device"]
    assert done.returncode == 2
    reader, writer = os.pipe()
    os.close(reader)
    done = process(*arguments, cwd=tmp_path, stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def options_in(help_text):
    return re.findall(r"^  (?:-\w\b[^-]*)?(--[a-z-]+)", help_text, re.M)


def test_help_and_version(capsys):
    for name in COMMANDS:
        code, out, err = run(capsys, name, "--help")
        assert (code, err) == (0, [])
        assert out.startswith(f"usage: clshade {name}")
    assert run(capsys, "--version") == (0, f"clshade {clshade.__version__}\n", [])
    out = run(capsys, "inspect", "--help")[1]
    assert out == run(capsys, "inspect", "--help", "all")[1]  # as it has few options
    assert "--pixel" in out


@pytest.mark.parametrize("command", ["render", "poster", "view", "stability"])
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


@pytest.mark.long
def test_devices_as_json(capsys):
    code, out, err = run(capsys, "devices", "--json")
    assert (code == 0, err) == (bool(working_devices()), [])
    listed = (info for info in json.loads(out) if info["works"] and is_tested(info["platform"]))
    assert tuple(info["index"] for info in listed) == working_devices()


@needs_device
def test_several_scenes_go_to_a_folder(folder, capsys):
    for name, text in (("a.jpg.obj", FACE), ("bad.obj", "v 1 2\n"), ("c.v2.obj", FACE)):
        write(folder / "in" / name, text)
    scenes = ["in/a.jpg.obj", "in/bad.obj", "in/c.v2.obj", "in/none.obj", "quads"]
    code, out, err = run(capsys, "render", *scenes, *SIZE, "--lights", "2", "--json", "-o", "new")
    assert code == 2
    assert listing(folder / "new") == [f"{name}.{kind}" for name in ("a.jpg", "c.v2") for kind in ("exr", "png")]
    starts = ("clshade: in/bad.obj", "clshade: in/none.obj", "clshade: quads: --lights")
    assert [line.startswith(start) for line, start in zip(err, starts, strict=True)] == [True] * 3, err
    records = json.loads(out)
    assert [record["scene"] for record in records] == scenes
    assert ["error" in record for record in records] == [False, True, False, True, True]
    assert records[2]["resolution"] == [32, 24]


def test_scenes_of_one_name_are_refused_before_any_is_loaded(folder, capsys, monkeypatch):
    """And no empty folder is left behind where none can be read."""
    assert run(capsys, "render", "none.obj", "neither.obj", "-o", "new")[0] == 2
    monkeypatch.setattr(render, "load_scene", lambda *arguments: pytest.fail("a scene was loaded"))
    for paths in (("sub/a.obj",), ("b.obj", "A.glb"), ("in/a.obj",), ("a.exr.ply",)):
        assert_refused(run(capsys, "render", "in/a.obj", *paths, "-o", "new"), "in/a.obj", paths[-1], ".exr", "new")
    assert listing(folder) == []


@needs_device
def test_quiet_and_verbose(tmp_path, capsys):
    mesh = write(tmp_path / "a.obj", "mtllib none.mtl\n" + FACE)
    command = ("render", mesh, *SIZE, "--look", "plain", "-o", tmp_path / "out")
    assert run(capsys, *command, "--quiet") == (0, "", [])
    code, out, err = run(capsys, "-q", *command, "--json")
    assert (code, err, json.loads(out)["triangles"]) == (0, [], 1)
    code, out, err = run(capsys, *command, "--verbose", "--json")
    assert (code, json.loads(out)["triangles"]) == (0, 1)
    assert any("there is no file 'none.mtl'" in line for line in err)
    assert any(line.startswith(f"clshade: loaded {mesh}: ") and line.endswith(" ms") for line in err), err
    assert_refused(run(capsys, "-q", "render", tmp_path / "none.obj"), "none.obj")
    assert_refused(run(capsys, "-q", *command, "--verbose"), "not allowed with argument -q/--quiet")
