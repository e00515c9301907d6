"""`clshade.verify`: images are judged from their files, by a random sample with a bound."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracle_frames import frame_of
from processes import ROOT

import clshade
from clshade.errors import InputError
from clshade.images import exr, png
from clshade.measure.verify.confidence import rounded_up, sampled, upper_bound
from clshade.measure.verify.recorded_image import nearest_stored, read_record, stored_range
from clshade.pipeline.frame_results import RECORD, sealed
from clshade.scene.builtin import scenes
from clshade.scene.description import PARTS
from clshade.scene.model import Material, Mesh, Scene, Settings

Change = Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]


def scene() -> Scene:
    return scenes.teapot(3, (80, 60))


def saved(folder: Path, **options: object) -> Path:
    settings = Settings(layers=("Z", "id"))
    frame_of(scene(), settings).save(folder / "teapot", **options)
    return folder / "teapot.exr"


def test_stored_values_may_have_been_half_a_step_away():
    low, high = stored_range(np.array([1.0, 65504.0, np.inf, 0.0], np.float16))
    assert low.tolist() == [1.0 - 2.0**-12, 65488.0, 65520.0, -(2.0**-25)]
    assert high.tolist() == [1.0 + 2.0**-11, 65520.0, np.inf, 2.0**-25]
    expected = np.array([1.0001, 70000.0, 70000.0, np.nan])
    nearest = nearest_stored(np.array([1.0, 65504.0, np.inf, 0.5], np.float16), expected)
    assert nearest.tolist() == [1.0001, 65520.0, 70000.0, 0.5]


@pytest.mark.parametrize(("faults", "looked_at"), [(0, 10), (1, 10), (3, 40), (39, 40), (0, 4605)])
def test_the_bound_is_where_so_few_are_found_with_one_percent(faults, looked_at):
    share = Fraction(upper_bound(faults, looked_at, 10**6))
    ways = (math.comb(looked_at, k) * share**k * (1 - share) ** (looked_at - k) for k in range(faults + 1))
    assert float(sum(ways)) == pytest.approx(0.01, rel=1e-9)


def test_bounds_of_all_pixels_and_of_a_thousandth():
    """Of all pixels it is their share; 4605 are the fewest that bound a thousandth."""
    assert (upper_bound(3, 12, 12), upper_bound(12, 12, 13)) == (0.25, 1.0)
    assert upper_bound(0, 4605, 480000) < 0.001 < upper_bound(0, 4602, 480000)
    shares = (upper_bound(0, 4605, 480000), 0.0, 0.01001, 0.5, 0.999)
    assert list(map(rounded_up, shares)) == ["0.1 %", "0 %", "1.1 %", "50 %", "100 %"]


def test_every_pixel_is_as_likely_to_be_in_the_sample_and_none_twice():
    for of, count in ((1000, 900), (7, 7), (7, 9), (1, 1)):
        index = sampled(of, count, 3)
        assert np.array_equal(index, sampled(of, count, 3))
        assert len(index) == len(set(index)) == min(of, count)
        assert 0 <= index[0] <= index[-1] < of
    drawn = np.bincount(np.concatenate([sampled(20, 5, seed) for seed in range(800)]), minlength=20)
    assert np.abs(drawn - 200).max() < 80  # 6.5 standard deviations


@pytest.mark.sampled
@pytest.mark.parametrize("options", [{"crop": True, "deterministic": True, "exposure": 1.5}, {}, {"half": True}])
def test_a_right_image_is_verified(tmp_path, options):
    path = saved(tmp_path, **options)
    verdict = clshade.verify(path, scene(), pixels=500, seed=7)
    assert (verdict.passed, verdict.pixels, verdict.seed) == (True, 500, 7)
    assert verdict.compared == ("color", "coverage", "Z", "id", "PNG")
    assert 0.0 < verdict.at_most == upper_bound(0, 500, 4800)
    assert "with 99 % confidence fewer than 0.92 % of the pixels are wrong" in verdict.lines()
    assert clshade.verify(path, scene(), pixels="all").claim.startswith("0 of 4,800 pixels are wrong")


@pytest.mark.sampled
@pytest.mark.parametrize(("name", "code"), [("icosphere", 1), ("teapot", 0)])
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
    assert "\x1b" not in lines
    assert "on a Würfel, as the header says" in lines


def cut(name: str) -> Change:
    return lambda planes: {layer: plane for layer, plane in planes.items() if layer != name}


def retyped(name: str, kind: type) -> Change:
    return lambda planes: {**planes, name: np.nan_to_num(planes[name], posinf=1.0).astype(kind)}


PICTURE = {"tonemap": "srgb", "exposure": 0.0, "colorbar": False}
SCENE = r"\.scene: expected digests of meshes, materials"
CORNERS = "header: clshade.subpixels: expected corners snapped to 1/65536 px, found 1/256 px: only the version"
PRECISION = "header: clshade.settings.precision: expected float32 or float64, found fast: only the version of clshade"
WHOLE = "R, G, B and A of the whole image"
STORAGE = r"clshade\.storage"
REFUSED: list[tuple[dict[str, Any], str]] = [  # what is written again otherwise; the refusal
    ({"change": lambda planes: {name: plane[:-1] for name, plane in planes.items()}}, "80 x 60 pixels, as the header"),
    ({"change": cut("Z")}, "the layer Z, as the header says"),
    ({"change": cut("A")}, WHOLE),
    ({"change": retyped("R", np.uint32)}, "channels: expected"),
    ({"change": retyped("id", np.float32)}, "channels: expected"),
    ({"storage": {"crop": 1}}, STORAGE),
    ({"storage": {"png": {**PICTURE, "exposure": 1e9}}}, STORAGE),
    ({"storage": {"png": {**PICTURE, "colorbar": True}}}, STORAGE),  # without scalars
    ({"record": {"scene": dict.fromkeys(PARTS, 0)}}, SCENE),
    ({"record": {"camera": None}}, r"clshade\.camera: expected the camera of a whole image"),
    ({"record": {"subpixels": 256}}, CORNERS),
    ({"record": {"settings": {"layers": ["Z", "id"], "precision": "fast"}}}, PRECISION),
]


@pytest.mark.parametrize(("again", "message"), REFUSED)
def test_what_cannot_be_judged_is_refused_in_one_line(tmp_path, again, message):
    path = saved(tmp_path)
    written_again(path, **again)
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


def test_half_floats_that_were_not_and_a_picture_that_is_not_the_exr_are_faults(tmp_path):
    path = saved(tmp_path)
    written_again(path, half=True)
    assert "the file was written again: float16 where it had float32" in clshade.verify(path, scene(), pixels=50).faults
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


def test_damaged_records_are_refused_in_one_line(tmp_path):
    """Of any bytes a record is made, or one line says why none is."""
    header = exr.read(saved(tmp_path))[1]
    random = np.random.default_rng(1)
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
