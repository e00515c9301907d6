"""`--cryptomatte` of `render`, `turntable` and `animate`: parts of the EXR with the masks of `clshade.cryptomatte`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import assert_refused, listing, run
from devices import working_devices

import clshade
from clshade import exr
from clshade.cli.main import COMMANDS

pytest.importorskip("mmh3")
needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")
SMALL = ("box_room", "--resolution", "40x30", "--samples", "2")


@needs_device
def test_render_writes_the_masks(folder, capsys):
    code, _, err = run(capsys, "render", *SMALL, "--cryptomatte", "object,material", "-o", "room")
    assert code == 0, err
    channels, _ = exr.read("room.exr")
    mattes = clshade.cryptomatte(clshade.render(clshade.builtin("box_room"), resolution=(40, 30), samples=2))
    for kind in ("object", "material"):
        for name, plane in mattes[kind].channels.items():
            assert np.array_equal(channels[name], plane), name
    assert not [name for name in channels if name.startswith("CryptoInstance")]


@needs_device
def test_turntable_writes_all_kinds_into_each_frame(folder, capsys):
    code, _, err = run(
        capsys, "turntable", *SMALL, "--count", "2", "--cryptomatte", "-o", "t.#.exr", "--formats", "exr"
    )
    assert code == 0, err
    assert listing(folder) == ["t.1.exr", "t.2.exr"]
    first, second = (exr.read(f"t.{number}.exr")[0] for number in (1, 2))
    assert {name[:-4] for name in first if name.startswith("Crypto")} == {
        "CryptoObject",
        "CryptoMaterial",
        "CryptoInstance",
    }
    assert (first["CryptoObject00.G"] != second["CryptoObject00.G"]).any()


@needs_device
def test_others_find_the_parts(folder, capsys):
    oiio = pytest.importorskip("OpenImageIO")
    assert run(capsys, "render", *SMALL, "--cryptomatte", "object", "-o", "room", "--quiet")[0] == 0
    image = oiio.ImageInput.open("room.exr")
    assert image.seek_subimage(1, 0)
    names = [each for each in image.spec().extra_attribs if each.name.startswith("cryptomatte/")]
    manifest = next(json.loads(each.value) for each in names if each.name.endswith("/manifest"))
    assert len(manifest) == len(clshade.builtin("box_room").meshes)


@pytest.mark.parametrize("command", ["render", "turntable"])
@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--cryptomatte", "objects"), ("--cryptomatte", "object, material, instance", "'objects'")),
        (("--cryptomatte", "--formats", "png"), ("files", "exr among them", "png")),
    ],
)
def test_what_cannot_be_written_is_refused_before_it_is_drawn(folder, capsys, command, arguments, parts):
    assert command in COMMANDS
    assert_refused(run(capsys, command, *SMALL, *arguments, "--quiet"), *parts)
    assert listing(folder) == []


def test_films_have_no_masks(folder, capsys):
    found = run(capsys, "turntable", *SMALL, "--cryptomatte", "-o", "film.gif", "--quiet")
    assert_refused(found, "--cryptomatte", "frames as --output", "film.gif")


def test_a_missing_package_is_named(folder, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mmh3", None)
    assert_refused(run(capsys, "render", *SMALL, "--cryptomatte", "--quiet"), "mmh3", "pip install")
    assert listing(folder) == []
