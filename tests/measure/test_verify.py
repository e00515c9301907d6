"""`clshade.verify`: images are judged from their files, by a random sample with a bound; planted changes are found."""

import json
import math
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import assert_refused, needs_device, run
from oracle_frames import frame_of
from processes import ROOT
from scene_files import write

import clshade
from clshade import oracle
from clshade.errors import InputError
from clshade.images import exr, png
from clshade.measure.check import oracle_bounds
from clshade.measure.verify.confidence import rounded_up, sampled, upper_bound
from clshade.measure.verify.recorded_image import nearest_stored, read_record, read_recorded, stored_range
from clshade.measure.verify.verify import as_drawn, verified
from clshade.pipeline import renderer
from clshade.pipeline.frame import Frame
from clshade.pipeline.frame_results import NOT_SEALED, RECORD, SEAL, sealed
from clshade.scene.builtin import scenes
from clshade.scene.description import PARTS
from clshade.scene.model import Material, Mesh, Scene, Settings, with_materials


def scene() -> Scene:
    return scenes.teapot(3, (80, 60))


@cache
def teapot_frame() -> Frame:
    return frame_of(scene(), Settings(layers=("Z", "id")))


def saved(folder: Path, **options: object) -> Path:
    teapot_frame().save(folder / "teapot", **options)
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


@pytest.mark.long
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


def written_again(path: Path, record: Mapping = {}, storage: Mapping = {}, half=False, change=None):
    """Write an EXR with other fields of its record, None for none, and the seal that belongs to it, or other channels."""
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


def cut(name: str):
    return lambda planes: {layer: plane for layer, plane in planes.items() if layer != name}


def retyped(name: str, kind: type):
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


@pytest.mark.long
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
    random = np.random.default_rng(1)
    text = exr.read(saved(tmp_path))[1][RECORD].encode()
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


# Changes that are planted


@dataclass(frozen=True)
class Files:
    planes: dict[str, np.ndarray]
    header: dict[str, Any]
    codes: np.ndarray | None
    scene: Scene


class Planting:
    def __init__(self, folder: Path, half: bool) -> None:
        self.half = half
        image = read_recorded(saved(folder, half=half))
        assert verified(image, [scene()], pixels="all").passed
        self.files = Files(*exr.read(image.path), png.read(folder / "teapot.png", alpha=True), scene())
        shown, settings = as_drawn(scene(), image.record), image.record.settings
        expected = oracle.render(shown, settings)
        bound = oracle_bounds.color_bound(expected, settings.precision)
        limit = oracle_bounds.allowed(shown, settings) * bound + expected.jump
        self.right, self.most = expected.rgb, np.maximum(limit, oracle_bounds.FLOAT32_TINY)
        everywhere = np.ones(expected.alpha.shape, bool)
        self.decided = ~(expected.unsure | oracle_bounds.depth_ties(shown, settings, everywhere))  # a tie is no fault

    def color(self, change, files: Files, random) -> Files:
        """Change colors of a pixel, a block or a part of a row by more than is allowed, without the PNG that would tell."""
        rgb = np.stack([files.planes[name] for name in "RGB"], axis=-1)
        while True:
            rows, columns = random.choice([(1, 1), (4, 4), (1, 32)])
            row, column = place(rgb[..., 0], random)
            where = slice(row, row + int(rows)), slice(column, column + int(columns))
            new = rgb.copy()
            limit = (self.right + self.most)[where].astype(rgb.dtype)
            new[where] = change(rgb[where].astype(np.float64), limit)
            read = nearest_stored(new, self.right) if self.half else new.astype(np.float64)
            is_wrong = ~(np.abs(read - self.right) <= self.most).all(axis=-1)
            new = np.where((is_wrong & self.decided)[..., None], new, rgb)
            if not np.array_equal(new, rgb, equal_nan=True):
                planes = {**files.planes, **{name: new[..., k] for k, name in enumerate("RGB")}}
                return replace(files, planes=planes, codes=None)


def place(array: np.ndarray, random) -> tuple[int, ...]:
    return tuple(int(random.integers(size)) for size in array.shape)


def changed_layer(name: str, files: Files, random) -> Files:
    plane = files.planes[name].copy()
    at = place(plane, random)
    value = plane[at]
    wrong = {"id": value + 1, "A": 1.0 - value if value != 0.5 else 1.0}
    plane[at] = wrong.get(name, value * np.float32(1.0 + 2.0**-18) if np.isfinite(value) else 1.0)
    return replace(files, planes={**files.planes, name: plane})


def changed_attribute(files: Files, random) -> Files:
    ours = sorted(name for name in files.header if name not in NOT_SEALED - {SEAL} and name != RECORD)
    name = ours[int(random.integers(len(ours)))]
    value = files.header[name]
    if isinstance(value, str):
        value = value[:-1] + ("x" if value[-1:] != "x" else "y")
    else:
        value = np.float32(2.0) * value + 1 if isinstance(value, np.ndarray) else 2 * value + 1
    changes: list[dict[str, Any]] = [{name: value}, {"added": "by someone"}]
    changes += [] if name == "pixelAspectRatio" else [{name: None}]  # every file has one
    return replace(files, header={**files.header, **changes[int(random.integers(len(changes)))]})


def changed_record(files: Files, random) -> Files:
    text = files.header[RECORD]
    at = int(random.integers(len(text)))
    new = text[:at] + str(random.choice(["", "0", "x", '"', "}", "9e999"])) + text[at + 1 :]
    return replace(files, header={**files.header, RECORD: new if new != text else text + " "})


def changed_scene(change, files: Files, random) -> Files:
    return replace(files, scene=change(files.scene))


def changed_code(files: Files, random) -> Files:
    codes = files.codes.copy()
    at = place(codes, random)
    codes[at] += 1 if codes[at] < 255 else -1
    return replace(files, codes=codes)


def next_to(values: Any) -> np.ndarray:
    values = np.asarray(values)
    return np.nextafter(values, values.dtype.type(np.inf))


COLORS = {  # of colors (K, L, 3) with the largest that are allowed
    "an ulp beyond its bound": lambda rgb, limit: next_to(next_to(limit)),
    "1 % brighter": lambda rgb, limit: 1.01 * rgb,
    "NaN": lambda rgb, limit: np.full_like(rgb, np.nan),
    "negative": lambda rgb, limit: -rgb - 1e-3,
    "channels exchanged": lambda rgb, limit: rgb[..., ::-1],
    "moved by a column": lambda rgb, limit: np.roll(rgb, 1, axis=1),
}
SCENES = {
    "meshes": lambda scene: replace(scene, meshes=(*scene.meshes[1:], Mesh(np.eye(3), [[0, 1, 2]]))),
    "materials": lambda scene: with_materials(scene, lambda material: replace(material, kd=next_to(material.kd))),
    "lights": lambda scene: replace(scene, lights=()),
    "camera": lambda scene: replace(scene, camera=replace(scene.camera, eye=next_to(scene.camera.eye))),
}
OTHERS = {"header attribute": changed_attribute, "header record": changed_record, "PNG code": changed_code}


def written(path: Path, files: Files, half: bool) -> None:
    metadata = {name: value for name, value in files.header.items() if name not in exr.PROTECTED}
    exr.write(path, files.planes, metadata=metadata, half=half, compression=files.header["compression"])
    path.with_suffix(".png").unlink(missing_ok=True)
    if files.codes is not None:
        png.write(path.with_suffix(".png"), files.codes)


@pytest.mark.sampled
@pytest.mark.parametrize(("count", "half"), [(16, True), (30, False), (100, False)])
def test_changes_are_found(tmp_path, count, half):
    """Those of half floats are beyond what half hides. One after another of each kind is planted."""
    planting = Planting(tmp_path, half)
    kinds = [
        *((f"color {name}", partial(planting.color, change)) for name, change in COLORS.items()),
        *((f"layer {name}", partial(changed_layer, name)) for name in ("A", "id", "Z")),
        *((f"scene {name}", partial(changed_scene, change)) for name, change in SCENES.items()),
        *OTHERS.items(),
    ]
    for seed in range(count):
        kind, change = kinds[seed % len(kinds)]
        changed = change(planting.files, np.random.default_rng(seed))
        written(tmp_path / "planted.exr", changed, half)
        try:
            is_found = not verified(read_recorded(tmp_path / "planted.exr"), [changed.scene], pixels="all").passed
        except InputError:
            is_found = kind == "header record"  # nothing may be left of it that can be judged
        assert is_found, (kind, seed)


CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
SMALL = ("--resolution", "64,48", "--samples", "1", "-q")


@needs_device
def test_an_image_is_found_again_by_its_header(folder, capsys):
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
    write(folder / "given" / "solid.obj", CUBE)
    assert run(capsys, "verify", "other/out.exr", "given/solid.obj", "--all")[0] == 0
    (new_folder / "solid.obj").unlink()
    assert_refused(run(capsys, "verify", "other/out.exr"), "solid.obj", "no such file")


@needs_device
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
        written_again(folder / "out.exr", {"command": command})
        assert_refused(run(capsys, "verify", "out.exr"), expected)
    written_again(
        folder / "out.exr", {"command": f"clshade render icosphere {drawn} --save-scene=made.glb --output=made"}
    )
    assert run(capsys, "verify", "out.exr")[0] == 0
    assert sorted(folder.iterdir()) == before
    # It may not name another camera or other settings than those that the pixels show.
    for changed, expected in (
        ("--camera-azimuth-angle=77", "camera: the header differs from its command in eye"),
        ("--shadows --samples=16", "settings: the header differs from its command in s"),
    ):
        written_again(folder / "out.exr", {"command": f"clshade render icosphere {drawn} {changed}"})
        code, out, _ = run(capsys, "verify", "out.exr")
        assert code == 1
        assert expected in out


@pytest.mark.long
@needs_device
def test_a_contact_shadow_is_computed_again_without_a_device(folder, monkeypatch, capsys):
    (folder / "solid.obj").write_text(CUBE)
    assert run(capsys, "render", "solid.obj", "-o", "out", *SMALL)[0] == 0
    monkeypatch.setattr(renderer, "Renderer", None)
    assert run(capsys, "verify", "out.exr", "--all")[0] == 0
