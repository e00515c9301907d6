"""Layers in files as other programs read them, with OpenEXR and OpenImageIO: names, types, windows and header."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from layer_scenes import CAMERA, dome, wedge
from processes import ROOT

import clshade
from clshade.images import exr
from clshade.images.layers import LAYER_TABLE
from clshade.pipeline.frame import Frame
from clshade.pipeline.opencl.device import Device
from clshade.scene.geometry import camera_matrices
from clshade.scene.model import Scene

README = (ROOT / "clshade" / "pipeline" / "README.md").read_text()


def readme_rows() -> dict[str, tuple[str, ...]]:
    """Return channels, type, description and background of each layer, by the README's table."""
    text = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", README)  # without links
    rows = re.findall(r"^\| `(\w+)` \| `([^|`]+)` \| (.+) \| (.+) \| (\w+) \|$", text, re.MULTILINE)
    return {name: tuple(cells) for name, *cells in rows}


# Channel of a frame without scalars -> type, f for float and u for uint, with its bits.
CHANNELS = dict.fromkeys("RGBA", "f32")
for layer, (channels, kind, *_) in readme_rows().items():
    if layer != "scalar":
        CHANNELS |= dict.fromkeys(channels.split(), "u32" if kind == "uint32" else "f32")


def test_the_readme_has_the_rows_of_the_table():
    kinds = {"uint32": "uint32", "real": "float", "float64": 'float; `frame["{}"]` float64'}
    ends = {0.0: "0", math.inf: "infinity"}
    expected = {}
    for name, row in LAYER_TABLE.items():
        channels = " ".join(f"{name}.{letter}" for letter in row.components) or name
        expected[name] = channels, kinds[row.kind].format(name), row.described(), ends.get(row.background, "NaN")
    assert readme_rows() == expected


@pytest.fixture(scope="module")
def frame(opened: Device) -> Frame:
    return clshade.render(Scene((dome(),), CAMERA, background=None), layers="all", ambient_occlusion=2, device=opened)


def expected_plane(frame: Frame, channel: str) -> np.ndarray:
    layer, _, letter = channel.partition(".")
    if channel in "RGBA":
        return frame.rgba[..., "RGBA".index(channel)]
    plane = frame[layer] if not letter else frame[layer][..., exr.SUFFIXES.get(layer, "RGB").index(letter)]
    return plane if plane.dtype == np.uint32 else plane.astype(np.float32)


@pytest.mark.parametrize("changed", [False, True])
def test_openimageio_reads_the_layers(frame, tmp_path, changed):
    """As they are; and cropped to the covered pixels, as half: our reader then gives the same planes as without."""
    oiio = pytest.importorskip("OpenImageIO")
    frame.save(tmp_path / "a", crop=changed, half=changed, compression="piz")
    file = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert file, oiio.geterror()
    spec = file.spec()
    kinds = {"f32": "half" if changed else "float", "u32": "uint"}
    formats = {name: str(spec.channelformat(k)) for k, name in enumerate(spec.channelnames)}
    assert formats == {n: "float" if n[0] in "ZP" else kinds[kind] for n, kind in CHANNELS.items()}
    rows, columns = np.nonzero(frame.alpha)
    covered = int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())
    assert 0 < covered[0] < covered[2] < 63
    assert 0 < covered[1] < covered[3] < 47
    x0, y0, x1, y1 = covered if changed else (0, 0, 63, 47)
    assert (spec.x, spec.y, spec.x + spec.width - 1, spec.y + spec.height - 1) == (x0, y0, x1, y1)
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 64, 48)
    assert (spec.getattribute("compression"), spec.getattribute("Software")) == ("piz", "clshade")
    matrix = np.reshape(spec.getattribute("worldtocamera"), (4, 4))
    assert np.array_equal(matrix, camera_matrices(CAMERA)[0].astype(np.float32))
    channels, header = exr.read(tmp_path / "a.exr")
    assert (header["dataWindow"], set(channels)) == ((x0, y0, x1, y1), set(CHANNELS))
    for k, name in enumerate(spec.channelnames):
        kind = np.uint32 if CHANNELS[name] == "u32" else np.float32
        pixels = file.read_image(0, 0, k, k + 1, "uint" if kind is np.uint32 else "float")[..., 0]
        expected = expected_plane(frame, name)
        if changed and CHANNELS[name] == "f32" and name[0] not in "ZP":
            expected = expected.astype(np.float16)
        assert np.array_equal(pixels, expected[y0 : y1 + 1, x0 : x1 + 1].astype(kind)), name
        assert channels[name].dtype == expected.dtype
        assert channels[name].tobytes() == expected.tobytes(), name  # Z of the background included
    file.close()


def test_the_header_names_objects_materials_and_instances(opened, tmp_path):
    """Instances are counted through all meshes; what has no name is left out."""
    named = replace(wedge(), name="Keil \u00e4", material=replace(wedge().material, name="T\u00f6n"))
    placed = replace(dome(), instance_names=("links", "", "Mitte \u00e4"))
    scene = Scene((placed, replace(named, name=""), named), CAMERA)
    clshade.render(scene, device=opened, layers=("object_id", "material_id", "instance_id")).save(tmp_path / "a")
    channels, header = exr.read(tmp_path / "a.exr")
    assert json.loads(header["objectNames"]) == {"1": "dome", "3": "Keil \u00e4"}
    assert json.loads(header["materialNames"]) == {"1": "shell", "2": "T\u00f6n"}
    assert json.loads(header["instanceNames"]) == {"1": "links", "3": "Mitte \u00e4"}
    assert set(np.unique(channels["instance_id"])) >= {0, 1, 3, 5}
    clshade.render(scene, device=opened, layers=("object_id",)).save(tmp_path / "a")
    assert not {"materialNames", "instanceNames"} & set(exr.read(tmp_path / "a.exr")[1])
