"""`clshade.verify`: images are judged from their files."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracle_frames import frame_of
from processes import ROOT

import clshade
from clshade.errors import InputError
from clshade.images import exr, png
from clshade.measure.verify.confidence import upper_bound
from clshade.measure.verify.recorded_image import nearest_stored, read_record, stored_range
from clshade.pipeline.frame_results import RECORD, seal_of, sealed
from clshade.scene.builtin import scenes
from clshade.scene.description import PARTS
from clshade.scene.model import Material, Mesh, Scene, Settings

Change = Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]


def scene() -> Scene:
    return scenes.teapot(3, (80, 60))


def saved(folder: Path, **options: object) -> Path:
    """Return the EXR of a teapot that is right."""
    settings = Settings(layers=("Z", "id"))
    frame_of(scene(), settings).save(folder / "teapot", **options)
    return folder / "teapot.exr"


# Values as stored


def test_stored_values_may_have_been_half_a_step_away():
    low, high = stored_range(np.array([1.0, 65504.0, np.inf, 0.0], np.float16))
    assert low.tolist() == [1.0 - 2.0**-12, 65488.0, 65520.0, -(2.0**-25)]
    assert high.tolist() == [1.0 + 2.0**-11, 65520.0, np.inf, 2.0**-25]
    expected = np.array([1.0001, 70000.0, 70000.0, np.nan])
    nearest = nearest_stored(np.array([1.0, 65504.0, np.inf, 0.5], np.float16), expected)
    assert nearest.tolist() == [1.0001, 65520.0, 70000.0, 0.5]


# Verification


@pytest.mark.parametrize("options", [{}, {"half": True}, {"crop": True, "deterministic": True, "exposure": 1.5}])
def test_a_right_image_is_verified(tmp_path, options):
    path = saved(tmp_path, **options)
    verdict = clshade.verify(path, scene(), pixels=500, seed=7)
    assert verdict.passed
    assert verdict.pixels == 500
    assert verdict.seed == 7
    assert verdict.compared == ("color", "coverage", "Z", "id", "PNG")
    assert 0.0 < verdict.at_most == upper_bound(0, 500, 4800)
    assert "with 99 % confidence fewer than 0.92 % of the pixels are wrong" in verdict.lines()
    assert clshade.verify(path, scene(), pixels="all").claim.startswith("0 of 4,800 pixels are wrong")


@pytest.mark.parametrize(("name", "code"), [("teapot", 0), ("icosphere", 1)])
def test_nothing_of_it_imports_opencl(tmp_path, name, code):
    drawn, settings = scenes.builtin("teapot"), Settings(layers=("Z", "id"))
    drawn = replace(drawn, camera=drawn.camera.with_resolution((80, 60)))
    frame_of(drawn, settings).save(tmp_path / "teapot")
    program = "import sys; sys.modules['pyopencl'] = None\nfrom clshade.cli.main import main\n"
    program += f"sys.exit(main(['verify', {str(tmp_path / 'teapot.exr')!r}, {name!r}]))"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == code
    assert done.stderr in ("", "clshade: computing pixels again in float64 ...\n")  # which is said where it is slow
    expected = ("compared: color, coverage, Z, id, PNG", "the scene is not the one that was drawn: its meshes")
    assert expected[code] in done.stdout


def test_seeds_are_fresh_and_repeat_a_sample(tmp_path):
    path = saved(tmp_path)
    first, second = (clshade.verify(path, scene(), pixels=9) for _ in range(2))
    assert first.seed != second.seed
    assert clshade.verify(path, scene(), pixels=9, seed=first.seed).stats() == first.stats()


def written_again(
    path: Path,
    record: Mapping[str, Any] = {},
    storage: Mapping[str, Any] = {},
    half=False,
    change: Change | None = None,
) -> None:
    """Write an EXR with other fields of its record, None for none, and the seal that belongs to it, with changed channels or
    as half."""
    planes, header = exr.read(path)
    new = {**json.loads(header[RECORD]), **record}
    new = {name: value for name, value in new.items() if value is not None}
    new["storage"] = {**new["storage"], **storage}
    metadata = {name: value for name, value in header.items() if name not in exr.PROTECTED}
    exr.write(path, change(planes) if change else planes, metadata=sealed(metadata, new), half=half)


def test_other_kernels_are_a_remark(tmp_path):
    path = saved(tmp_path)
    written_again(path, {"kernels": "others", "device": "a Würfel", "version": "1\nverified \x1b[31m"})
    verdict = clshade.verify(path, scene(), pixels=50)
    assert verdict.passed
    assert "other kernels" in verdict.remarks[0]
    lines = "\n".join(verdict.lines())
    assert lines.count("\n") == len(verdict.lines()) - 1
    assert "\x1b" not in lines
    assert "on a Würfel, as the header says" in lines
    header = exr.read(path)[1]
    assert "Würfel" in header[RECORD]  # which people can read
    assert header["clshadeSeal"] == seal_of(header)


def cut(name: str) -> Change:
    return lambda planes: {layer: plane for layer, plane in planes.items() if layer != name}


def retyped(name: str, kind: type) -> Change:
    return lambda planes: {**planes, name: np.nan_to_num(planes[name], posinf=1.0).astype(kind)}


PICTURE = {"tonemap": "srgb", "exposure": 0.0, "colorbar": False}
SCENE = r"\.scene: expected digests of meshes, materials"
CORNERS = "header: clshade.subpixels: expected corners snapped to 1/65536 px, found 1/256 px: only the version"
PRECISION = "header: clshade.settings.precision: expected float32 or float64, found fast: only the version of clshade"
ALL = "R, G, B and A of the whole image"
# Fields of the record, of its storage, a change of the channels; the refusal
REFUSED: list[tuple[dict[str, Any], dict[str, Any], Change | None, str]] = [
    ({}, {}, lambda planes: {name: plane[:-1] for name, plane in planes.items()}, "80 x 60 pixels, as the header says"),
    ({}, {}, cut("Z"), "the layer Z, as the header says"),
    ({}, {}, cut("A"), ALL),
    ({}, {}, retyped("R", np.uint32), "channels: expected"),
    ({}, {}, retyped("Z", np.uint32), "channels: expected"),
    ({}, {}, retyped("id", np.float32), "channels: expected"),
    ({}, {"half": "yes"}, None, r"clshade\.storage"),
    ({}, {"crop": 1}, None, r"clshade\.storage"),
    ({}, {"png": {"tonemap": "srgb"}}, None, r"clshade\.storage"),
    ({}, {"png": {**PICTURE, "tonemap": "no such"}}, None, r"clshade\.storage"),
    ({}, {"png": {**PICTURE, "exposure": 1e9}}, None, r"clshade\.storage"),
    ({}, {"png": {**PICTURE, "colorbar": True}}, None, r"clshade\.storage"),  # without scalars
    ({}, {"more": 1}, None, r"clshade\.storage"),
    ({"scene": {}}, {}, None, SCENE),
    ({"scene": {"meshes": "0"}}, {}, None, SCENE),
    ({"scene": dict.fromkeys(PARTS, 0)}, {}, None, SCENE),
    ({"subpixels": None}, {}, None, CORNERS),
    ({"subpixels": 256}, {}, None, CORNERS),
    ({"settings": {"layers": ["Z", "id"], "precision": "fast"}}, {}, None, PRECISION),
]


@pytest.mark.parametrize(("record", "storage", "change", "message"), REFUSED)
def test_what_cannot_be_judged_is_refused_in_one_line(tmp_path, record, storage, change, message):
    path = saved(tmp_path)
    written_again(path, record, storage, change=change)
    with pytest.raises(InputError, match=message) as caught:
        clshade.verify(path, scene())
    assert "\n" not in str(caught.value)


def test_files_and_arguments_that_are_refused(tmp_path):
    path = saved(tmp_path)
    with pytest.raises(InputError, match="expected the Scene that was drawn"):  # teapot(3) is not the built-in one
        clshade.verify(path)
    planes, header = exr.read(path)
    metadata = {name: value for name, value in header.items() if name not in exr.PROTECTED}
    for change, expected in (
        ({"metadata": {}}, "the record of how, found none"),
        ({"compression": "dwaa"}, "compression: expected a lossless one"),
    ):
        exr.write(tmp_path / "other.exr", **{"channels": planes, "metadata": metadata, **change})
        with pytest.raises(InputError, match=expected):
            clshade.verify(tmp_path / "other.exr", scene())
    for refused in ({"pixels": 0}, {"seed": -1}, {"scene": "teapot"}):
        with pytest.raises(InputError, match=f"{next(iter(refused))}: expected"):
            clshade.verify(path, **{"scene": scene(), **refused})


def test_an_image_written_again_as_half_is_not_as_its_record_says(tmp_path):
    path = saved(tmp_path)
    written_again(path, half=True)
    verdict = clshade.verify(path, scene(), pixels=50)
    assert "the file was written again: float16 where it had float32" in verdict.faults


@pytest.mark.parametrize("name", ["R", "A", "Z", "id"])
def test_an_image_of_which_nothing_is_right(tmp_path, name):
    path = saved(tmp_path)
    off = np.nan if name == "Z" else 7
    written_again(path, change=lambda planes: {**planes, name: planes[name] + planes[name].dtype.type(off)})
    verdict = clshade.verify(path, scene(), pixels=300)
    assert verdict.wrong == 300
    assert verdict.claim == "any number of the pixels may be wrong"


def test_a_picture_that_is_not_the_exr_is_a_fault(tmp_path):
    path = saved(tmp_path)
    png.write(path.with_suffix(".png"), np.zeros((30, 40, 3), np.uint8))
    (fault,) = clshade.verify(path, scene(), pixels=50).faults
    expected = "expected 80 x 60 pixels of 3 channels, found 40 x 30 pixels of 3 channels"
    assert fault == f"teapot.png is of another size: {expected}"
    path.with_suffix(".png").write_bytes(b"\x89PNG")  # damaged
    verdict = clshade.verify(path, scene(), pixels=50)
    assert (verdict.pixels, len(verdict.faults)) == (50, 1)
    assert "teapot.png" in verdict.faults[0]


def test_pixels_whose_face_cannot_be_told_are_not_verified(tmp_path):
    """Two quads at one depth, of which either may show, so that any color would pass."""
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    quads = tuple(Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=Material(kd=kd)) for kd in (0.2, 0.9))
    drawn = replace(scenes.builtin("teapot"), meshes=quads, name="quads at one depth")
    camera = replace(drawn.camera, eye=(0, 0, 5), lookat=(0, 0, 0), up=(0, 1, 0)).with_resolution((40, 40))
    drawn = replace(drawn, camera=camera)
    frame_of(drawn, Settings()).save(tmp_path / "quads")
    path = tmp_path / "quads.exr"
    assert clshade.verify(path, drawn, pixels="all").passed
    planes = exr.read(path)[0]
    path.with_suffix(".png").unlink()
    other_colors = {name: np.where(planes["A"] > 0, 123, planes[name]).astype(np.float32) for name in "RGB"}
    written_again(path, change=lambda _: {**planes, **other_colors})
    with pytest.raises(InputError, match="which cannot be judged"):
        clshade.verify(path, drawn, pixels="all")
    at = np.argwhere(planes["A"] > 0)[0]
    planes["R"][tuple(at)] = 123
    written_again(path, change=lambda _: planes)
    verdict = clshade.verify(path, drawn, pixels="all")
    assert verdict.ties == 1
    assert "and 1 cannot be judged" in verdict.claim
    assert verdict.at_most == 1 / 1600


@pytest.mark.parametrize("seed", range(3))
def test_damaged_records_are_refused_in_one_line(tmp_path, seed):
    """Of any bytes a record is made, or one line says why none is."""
    header = exr.read(saved(tmp_path))[1]
    random = np.random.default_rng(seed)
    text = header[RECORD].encode()
    refused = 0
    for k in range(300):
        at, end = sorted(random.integers(0, len(text), 2).tolist())
        noise = (b"", random.bytes(3), b"9" * 400, b"1e999", b"[" * 2000, b"null", b"-1", b'"\\u0000"')[k % 8]
        damaged = text[:at] + noise + (b"" if k % 3 else text[end:])
        try:
            read_record({RECORD: damaged.decode("utf-8", "replace")}, "image.exr")
        except InputError as error:
            refused += 1
            assert "\n" not in str(error)
            assert str(error).startswith("image.exr: ")
    assert refused > 250
