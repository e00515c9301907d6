"""Layers in files as other programs read them, with OpenEXR and OpenImageIO: names, types, windows and header."""

from __future__ import annotations

import json
import math
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from layer_scenes import CAMERA, dome, mixed, wedge

import clshade
from clshade.images import exr
from clshade.images.layers import LAYER_TABLE
from clshade.pipeline.frame import Frame
from clshade.pipeline.opencl.device import Device
from clshade.scene.geometry import camera_matrices
from clshade.scene.model import Scene

ROOT = Path(__file__).resolve().parent.parent.parent
README = (ROOT / "clshade" / "pipeline" / "README.md").read_text()
LINK = re.compile(r"\[([^]]+)\]\([^)]+\)")


def readme_rows() -> dict[str, tuple[str, ...]]:
    """Return channels, type, description and background of each layer, by the README's table."""
    rows = re.findall(r"^\| `(\w+)` \| `([^|`]+)` \| (.+) \| (.+) \| (\w+) \|$", README, re.MULTILINE)
    return {
        name: (channels, kind, LINK.sub(r"\1", what), background) for name, channels, kind, what, background in rows
    }


# Channel of a frame without scalars -> type, f for float and u for uint, with its bits.
CHANNELS = dict.fromkeys("RGBA", "f32")
for layer, (channels, kind, *_) in readme_rows().items():
    if layer != "scalar":
        CHANNELS |= dict.fromkeys(channels.split(), "u32" if kind == "uint32" else "f32")
HALVES = {name for name, kind in CHANNELS.items() if kind == "f32" and name[0] not in "ZP"}


def test_the_readme_has_the_rows_of_the_table():
    kinds = {"uint32": "uint32", "real": "float", "float64": 'float; `frame["{}"]` float64'}
    ends = {0.0: "0", math.inf: "infinity"}
    expected = {}
    for name, row in LAYER_TABLE.items():
        channels = " ".join(f"{name}.{letter}" for letter in row.components) or name
        background = ends.get(row.background, "NaN")
        expected[name] = channels, kinds[row.kind].format(name), row.described(), background
    assert readme_rows() == expected


@pytest.fixture(scope="module")
def frame(opened: Device) -> Frame:
    """Render a frame with background on every side."""
    return clshade.render(Scene((dome(),), CAMERA, background=None), layers="all", ambient_occlusion=2, device=opened)


@pytest.fixture(scope="module")
def window(frame) -> tuple[int, int, int, int]:
    """Return the window of the covered pixels."""
    rows, columns = np.nonzero(frame.alpha)
    bounds = int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())
    assert 0 < bounds[0] < bounds[2] < 63
    assert 0 < bounds[1] < bounds[3] < 47
    return bounds


def expected_plane(frame: Frame, channel: str) -> np.ndarray:
    layer, _, letter = channel.partition(".")
    if channel in "RGBA":
        return frame.rgba[..., "RGBA".index(channel)]
    plane = frame[layer] if not letter else frame[layer][..., exr.SUFFIXES.get(layer, "RGB").index(letter)]
    return plane if plane.dtype == np.uint32 else plane.astype(np.float32)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("crop", [False, True])
def test_openimageio_reads_the_layers(frame, window, tmp_path, half, crop):
    oiio = pytest.importorskip("OpenImageIO")
    frame.save(tmp_path / "a", crop=crop, half=half, compression="piz")
    file = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert file, oiio.geterror()
    spec = file.spec()
    kinds = {"f32": "half" if half else "float", "u32": "uint"}
    formats = {name: str(spec.channelformat(k)) for k, name in enumerate(spec.channelnames)}
    assert formats == {n: "float" if n[0] in "ZP" else kinds[kind] for n, kind in CHANNELS.items()}
    x0, y0, x1, y1 = window if crop else (0, 0, 63, 47)
    assert (spec.x, spec.y, spec.x + spec.width - 1, spec.y + spec.height - 1) == (x0, y0, x1, y1)
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 64, 48)
    assert spec.getattribute("compression") == "piz"
    assert spec.getattribute("Software") == "clshade"
    matrix = np.reshape(spec.getattribute("worldtocamera"), (4, 4))
    assert np.array_equal(matrix, camera_matrices(CAMERA)[0].astype(np.float32))
    for k, name in enumerate(spec.channelnames):
        kind = np.uint32 if CHANNELS[name] == "u32" else np.float32
        pixels = file.read_image(0, 0, k, k + 1, "uint" if kind is np.uint32 else "float")[..., 0]
        expected = expected_plane(frame, name)[y0 : y1 + 1, x0 : x1 + 1]
        expected = expected.astype(np.float16).astype(np.float32) if half and name in HALVES else expected
        assert np.array_equal(pixels, expected), name
    file.close()


@pytest.mark.parametrize("half", [False, True])
def test_a_cropped_file_reads_as_the_whole_one(frame, window, tmp_path, half):
    """Every channel is equal, Z of the background included, and the file is smaller."""
    for crop in (False, True):
        frame.save(tmp_path / str(crop), crop=crop, half=half)
    (uncropped, header), (cropped, header_of_cropped) = (exr.read(tmp_path / f"{crop}.exr") for crop in (False, True))
    assert header["dataWindow"] == header["displayWindow"] == header_of_cropped["displayWindow"] == (0, 0, 63, 47)
    assert header_of_cropped["dataWindow"] == window
    assert set(uncropped) == set(cropped) == set(CHANNELS)
    for name in CHANNELS:
        assert uncropped[name].dtype == (
            np.uint32 if CHANNELS[name] == "u32" else np.float16 if half and name in HALVES else np.float32
        )
        assert uncropped[name].tobytes() == cropped[name].tobytes(), name
    assert (tmp_path / "True.exr").stat().st_size < (tmp_path / "False.exr").stat().st_size


@pytest.mark.long
def test_the_header_names_objects_and_materials(opened, tmp_path):
    named = replace(wedge(), name="Keil \u00e4", material=replace(wedge().material, name="T\u00f6n"))
    scene = Scene((dome(), replace(named, name=""), named), CAMERA)
    clshade.render(scene, device=opened, layers=("object_id", "material_id")).save(tmp_path / "a")
    _, header = exr.read(tmp_path / "a.exr")
    assert json.loads(header["objectNames"]) == {"1": "dome", "3": "Keil \u00e4"}
    assert json.loads(header["materialNames"]) == {"1": "shell", "2": "T\u00f6n"}
    clshade.render(scene, device=opened, layers=("object_id",)).save(tmp_path / "a")
    assert not {"materialNames", "instanceNames"} & set(exr.read(tmp_path / "a.exr")[1])


def test_the_header_names_instances(opened, tmp_path):
    """Counted through all meshes; those without a name are left out."""
    names = ("links", "", "Mitte \u00e4")
    scene = Scene((wedge(), replace(dome(), instance_names=names)), CAMERA)
    frame = clshade.render(scene, device=opened, layers=("instance_id",))
    frame.save(tmp_path / "a")
    channels, header = exr.read(tmp_path / "a.exr")
    assert json.loads(header["instanceNames"]) == {"2": "links", "4": "Mitte \u00e4"}
    assert np.array_equal(channels["instance_id"], frame["instance_id"])
    assert set(np.unique(channels["instance_id"])) >= {0, 1, 2, 4}
    clshade.render(scene, device=opened, layers=("object_id",)).save(tmp_path / "a")
    assert "instanceNames" not in exr.read(tmp_path / "a.exr")[1]


@pytest.mark.long
def test_what_is_not_cropped(opened, tmp_path):
    """A background that is not black is kept; a file with nothing in it keeps one pixel."""
    scene = Scene((wedge(),), CAMERA, background=(0.0, 0.1, 0.0))
    clshade.render(scene, device=opened, layers="Z").save(tmp_path / "a", crop=True)
    channels, header = exr.read(tmp_path / "a.exr")
    assert header["dataWindow"] == header["displayWindow"]
    assert (channels["G"] > 0).all()
    clshade.render(replace(scene, meshes=(), background=None), device=opened, layers="Z").save(
        tmp_path / "a", crop=True
    )
    channels, header = exr.read(tmp_path / "a.exr")
    assert header["dataWindow"] == (0, 0, 0, 0)
    assert np.isposinf(channels["Z"]).all()


@pytest.mark.long
def test_values_beyond_half_are_warned_of(opened, tmp_path):
    frame = clshade.render(Scene((wedge(),), CAMERA), device=opened, layers=("P", "uv"))
    frame["uv"][3, 4] = 7e4, -7e4
    frame["P"][3, 4, 0] = 7e4
    frame.rgba[1, 1, 0] = 1e5
    with pytest.warns(UserWarning, match="became infinity in half") as caught:
        lines = frame.save(tmp_path / "a", half=True)
    expected = [f"{name}: 1 finite values of 65520 or more became infinity in half" for name in ("R", "uv.U", "uv.V")]
    assert lines == [str(warning.message) for warning in caught] == expected
    assert caught[0].filename == __file__
    channels, _ = exr.read(tmp_path / "a.exr")
    assert channels["P.X"][3, 4] == np.float32(7e4)
    assert channels["uv.V"][3, 4] == -np.inf
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert frame.save(tmp_path / "a") == []


@pytest.mark.long
def test_the_command_line_writes_all_layers(opened, tmp_path, capsys):
    from clshade.cli.main import main

    name = str(tmp_path / "a")
    scene = ("render", "icosphere", "--resolution", "40,30", "--device", opened.index)
    assert main([*scene, "--layers", "all", "--ambient-occlusion", "2", "--crop", "--half", "-o", name]) == 0
    channels, header = exr.read(name + ".exr")
    assert set(channels) == set(CHANNELS)
    assert channels["N.X"].dtype == np.float16
    assert channels["Z"].shape == (30, 40)
    assert header["dataWindow"] != header["displayWindow"]
    capsys.readouterr()
    assert main(["render", "--help"]) == 0
    assert "object_id" in capsys.readouterr().out


@pytest.mark.long
def test_the_scene_is_read_back_as_it_was_drawn(opened, tmp_path):
    """Position, depth and camera of the file are consistent: the third coordinate of P times worldToCamera is Z."""
    clshade.render(mixed(), device=opened, layers=("Z", "P", "id")).save(tmp_path / "a")
    channels, header = exr.read(tmp_path / "a.exr")
    shown = channels["id"] > 0
    points = np.stack(
        [channels[f"P.{axis}"][shown].astype(np.float64) for axis in "XYZ"] + [np.ones(shown.sum())], axis=-1
    )
    seen = points @ header["worldToCamera"].astype(np.float64)
    # Coordinates and matrix are rounded to float32: 4 products of numbers up to 30, with two errors of half an ulp
    # each.
    rounding = 8 * 30 * 2.0**-24
    assert np.abs(seen[:, 2] - channels["Z"][shown]).max() <= rounding
    in_image = points @ header["worldToNDC"].astype(np.float64)
    rows, columns = np.nonzero(shown)
    place = in_image[:, :2] / in_image[:, 3:] * [64, 48]
    # Numerator and denominator are off by as much, and the quotient by as much more as the depth is less than 1.
    off = np.abs(place - np.stack([columns, rows], axis=-1) - 0.5)
    assert off.max() <= 64 * 2 * rounding / channels["Z"][shown].min()
