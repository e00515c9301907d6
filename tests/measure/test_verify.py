"""`clshade.verify`: images are judged from their files, and planted changes of them are found."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from oracle_frames import frame_of

import clshade
from clshade.errors import InputError
from clshade.images import exr
from clshade.measure.verify.confidence import rounded_up, upper_bound
from clshade.measure.verify.planted import plant
from clshade.measure.verify.recorded_image import nearest_stored, read_recorded, stored_range
from clshade.pipeline.drawing_record import RECORD, read_record, seal_of, sealed
from clshade.scene.builtin import scenes
from clshade.scene.description import digest_of, part_digests
from clshade.scene.model import Scene, Settings

ROOT = Path(__file__).resolve().parents[2]


def scene() -> Scene:
    return scenes.teapot(3, (80, 60))


def saved(folder: Path, **options: object) -> Path:
    """Return the EXR of a teapot that is right."""
    settings = Settings(layers=("Z", "id"))
    frame_of(scene(), settings).save(folder / "teapot", **options)
    return folder / "teapot.exr"


# The bound


@pytest.mark.parametrize(("found", "looked_at"), [(0, 10), (1, 10), (3, 40), (39, 40), (0, 4605)])
def test_the_bound_is_where_so_few_are_found_with_one_percent(found, looked_at):
    share = Fraction(upper_bound(found, looked_at, 10**6))
    ways = (math.comb(looked_at, k) * share**k * (1 - share) ** (looked_at - k) for k in range(found + 1))
    assert float(sum(ways)) == pytest.approx(0.01, rel=1e-9)


def test_the_bound_of_all_pixels_is_their_share():
    assert upper_bound(3, 12, 12) == 0.25
    assert upper_bound(12, 12, 13) == 1.0


def test_4605_pixels_are_the_fewest_that_bound_a_thousandth():
    assert upper_bound(0, 4605, 480000) < 0.001 < upper_bound(0, 4602, 480000)
    assert rounded_up(upper_bound(0, 4605, 480000)) == "0.1 %"
    assert [rounded_up(share) for share in (0.0, 0.01001, 0.5)] == ["0 %", "1.1 %", "50 %"]


# Descriptions of scenes


def test_descriptions_are_the_same_in_another_process():
    code = "import clshade, json; from clshade.scene.description import part_digests\n"
    code += "print(json.dumps(part_digests(clshade.builtin('quads'))))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == part_digests(clshade.builtin("quads"))


def test_descriptions_tell_values_apart():
    values = [0, 0.0, -0.0, False, None, "", "0", (), (0,), ((0,),), {"0": 0}, np.zeros(1), np.zeros((1, 1))]
    values += [np.zeros(2, np.float32), np.zeros(1, np.int64), ("a", "b"), ("ab",), Settings()]
    assert len({digest_of(value) for value in values}) == len(values)
    big = np.arange(6.0).reshape(2, 3)
    assert digest_of(big.astype(">f8")) == digest_of(np.asfortranarray(big)) == digest_of(big)
    with pytest.raises(TypeError, match="expected plain values"):
        digest_of(object())


def test_only_the_part_that_changed_differs():
    before = scene()
    for part, changed in {
        "camera": replace(before, camera=before.camera.with_resolution((40, 30))),
        "lights": replace(before, lights=()),
        "meshes": replace(before, meshes=tuple(replace(each, name="other") for each in before.meshes)),
        "others": replace(before, ambient=0.5),
    }.items():
        a, b = part_digests(before), part_digests(changed)
        assert [name for name in a if a[name] != b[name]] == [part]
    assert part_digests(replace(before, preset="pbr", ignored=("a remark",))) == part_digests(before)


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
def test_a_right_image_is_verified_without_opencl(tmp_path, options):
    path = saved(tmp_path, **options)
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(sys.modules, "pyopencl", None)  # importing it fails
        found = clshade.verify(path, scene(), pixels=500, seed=7)
    assert found.passed
    assert found.pixels == 500
    assert found.seed == 7
    assert found.compared == ("color", "coverage", "Z", "id", "PNG")
    assert 0.0 < found.at_most == upper_bound(0, 500, 4800)
    assert "with 99 % confidence fewer than 0.92 % of the pixels are wrong" in found.lines()
    assert clshade.verify(path, scene(), pixels="all").claim.startswith("0 of 4,800 pixels are wrong")


def test_nothing_of_it_imports_opencl(tmp_path):
    path = saved(tmp_path)
    code = "import sys; sys.modules['pyopencl'] = None\nfrom clshade.cli.main import main\n"
    code += f"sys.exit(main(['verify', {str(path)!r}, 'icosphere']))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1
    assert not done.stderr
    assert "the scene is not the one that was drawn: its meshes" in done.stdout


def test_seeds_are_fresh_and_repeat_a_sample(tmp_path):
    path = saved(tmp_path)
    first, second = (clshade.verify(path, scene(), pixels=9) for _ in range(2))
    assert first.seed != second.seed
    assert clshade.verify(path, scene(), pixels=9, seed=first.seed).stats() == first.stats()


def test_other_kernels_are_a_remark(tmp_path):
    path = saved(tmp_path)
    planes, header = exr.read(path)
    record = {**json.loads(header[RECORD]), "kernels": "others", "device": None}
    metadata = {name: value for name, value in header.items() if name not in exr.PROTECTED}
    exr.write(path, planes, metadata=sealed(metadata, record))
    found = clshade.verify(path, scene(), pixels=50)
    assert found.passed
    assert "other kernels" in found.remarks[0]
    header = exr.read(path)[1]
    assert header["clshadeSeal"] == seal_of(header)


def test_thirty_planted_changes_are_found(tmp_path):
    image = read_recorded(saved(tmp_path))
    found = plant(image, scene(), 30, pixels=1000, seed=5)
    assert found.passed, found.lines()
    assert found.found.total() + found.outside.total() == 30


@pytest.mark.long
def test_a_thousand_planted_changes_are_found(tmp_path):
    image = read_recorded(saved(tmp_path))
    found = plant(image, scene(), 1000, pixels=1000)
    assert found.passed, found.lines()
    assert found.found.total() + found.outside.total() == 1000
    assert len(found.outside) > 0


def test_what_cannot_be_judged_is_refused_in_one_line(tmp_path):
    path = saved(tmp_path)
    planes, header = exr.read(path)
    metadata = {name: value for name, value in header.items() if name not in exr.PROTECTED}
    for change, expected in (
        ({"metadata": {}}, "the record of how, found none"),
        ({"channels": {name: plane[:-1] for name, plane in planes.items()}}, "80 x 60 pixels, as the header says"),
        ({"channels": {name: planes[name] for name in "RGBA"}}, "the layer Z, as the header says"),
        ({"compression": "dwaa"}, "compression: expected a lossless one"),
    ):
        exr.write(tmp_path / "other.exr", **{"channels": planes, "metadata": metadata, **change})
        with pytest.raises(InputError, match=expected) as caught:
            clshade.verify(tmp_path / "other.exr", scene())
        assert "\n" not in str(caught.value)
    for refused, expected in (({"pixels": 0}, "pixels: expected"), ({"seed": -1}, "seed: expected")):
        with pytest.raises(InputError, match=expected):
            clshade.verify(path, scene(), **refused)
    with pytest.raises(InputError, match="scene: expected a Scene"):
        clshade.verify(path, "teapot")


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
