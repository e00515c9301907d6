"""`clshade.check` and `render --check`: planted errors of an image are found."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import needs_device, run
from oracle_frames import frame_of

import clshade
from clshade import oracle
from clshade.errors import InputError
from clshade.images import exr
from clshade.measure.check import check, oracle_bounds
from clshade.pipeline.frame import Frame
from clshade.scene.builtin import scenes
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Settings

LAYERS = ("Z", "id")


def teapot_frame(preset: str = "standard", layers: tuple[str, ...] = LAYERS) -> Frame:
    return frame_of(scenes.teapot(3, (80, 60)), Settings.from_preset(preset, layers=layers))


@pytest.mark.parametrize("preset", ["course", "standard"])
def test_a_right_image_passes(preset):
    frame = teapot_frame(preset)
    for pixels in (4096, 500, "all"):
        report = clshade.check(frame, pixels)
        assert report.passed
        assert (report.wrong, report.ties, report.gates) == (0, 0, 0)
        assert 0.0 < report.bounds <= 1.0  # only the rounding of the result
        assert 0.0 < report.error < 2.0**-22
        assert 0.0 < report.depth <= 1.0
        assert report.ids
        assert frame.check is report
        assert (report.pixels, report.complete) == (4800 if pixels == "all" else pixels, pixels == "all")


def plant(frame: Frame, row: int, column: int, relative: float) -> None:
    """Plant an error in green, relative to the light budget."""
    expected = oracle.render(frame.scene, frame.settings, np.array([row]), np.array([column]))
    frame.rgba[row, column, 1] += relative * expected.budget[0, 1]


def test_one_changed_pixel_of_all_is_found():
    frame = teapot_frame()
    row, column = (int(i) for i in np.argwhere(frame.alpha > 0)[700])
    plant(frame, row, column, 1e-3)
    report = clshade.check(frame, "all")
    assert not report.passed
    assert (report.worst, report.wrong) == ((row, column), 0)
    assert report.error == pytest.approx(1e-3, rel=1e-3)
    assert report.bounds > 32.0
    assert np.argwhere(report.image > 1.0).tolist() == [[row, column]]
    assert report.image.max() == report.image[row, column]


def test_a_sample_reports_an_error_in_a_pixel_it_looks_at():
    frame = teapot_frame()
    looked_at = check._sample(check._strata(frame).ravel(), 400, 0)
    assert len(looked_at) == len(set(looked_at.tolist())) == 400
    covered = np.flatnonzero(frame.alpha.ravel() > 0)
    inside, outside = np.intersect1d(covered, looked_at)[99], np.setdiff1d(covered, looked_at)[99]
    for index, seen in ((inside, True), (outside, False)):
        changed = teapot_frame()
        row, column = (int(i) for i in np.divmod(index, 80))
        plant(changed, row, column, 1e-4)
        report = clshade.check(changed, 400)
        assert report.passed is not seen
        assert (report.worst == (row, column)) is seen
        assert "lower bound" in " ".join(report.lines())


# What is wrong in a pixel, and how that is said
PLANTED = {
    "id": (lambda frame, at: frame["id"].__setitem__(at, frame["id"][at] + 1), "id is wrong"),
    "alpha": (lambda frame, at: frame.rgba.__setitem__((*at, 3), 0.0), "alpha is wrong"),
    "Z": (lambda frame, at: frame["Z"].__setitem__(at, frame["Z"][at] * 1.00001), "depths are beyond their bounds"),
    "rgb": (lambda frame, at: frame.rgba.__setitem__((*at, 2), np.nan), "rgb is wrong"),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", PLANTED)
def test_wrong_owners_coverage_depths_and_values_that_are_not_finite(name):
    frame, (spoil, is_wrong) = teapot_frame(), PLANTED[name]
    at = tuple(np.argwhere(frame.alpha > 0)[700].tolist())
    assert check.problem(frame) == ""
    spoil(frame, at)
    said = f"{is_wrong}: 1 of 4800 pixels, the first at row {at[0]}, column {at[1]}: expected "
    assert check.problem(frame).startswith(said)
    assert check.problem(frame, np.arange(4800).reshape(60, 80) == np.ravel_multi_index(at, (60, 80))) == ""
    report = clshade.check(frame, 20 if name == "rgb" else "all")
    assert not report.passed
    assert report.wrong == (name != "Z")
    assert report.strata["not finite"][0] == (name == "rgb")  # always looked at
    assert name == "rgb" or np.isinf(report.image[at]) == (name != "Z")
    assert (report.depth > 100.0) == (name == "Z")


def test_without_layers_coverage_and_colors_are_checked():
    frame = teapot_frame(layers=())
    report = clshade.check(frame, "all")
    assert report.passed
    assert (report.ids, report.depth) == (False, None)
    frame.rgba[0, 0, 3] = 1.0
    assert clshade.check(frame, "all").wrong == 1


def two_cards(apart: float) -> Scene:
    """Return two cards across the image, the second `apart` behind the first."""
    verts = np.array([[-9, -9, 0], [9, -9, 0], [0, 18, 0]])
    cards = (((1, 0, 0), 0.0), ((0, 1, 0), apart))
    meshes = tuple(Mesh(verts + [0, 0, z], [[0, 1, 2]], material=Material(color=color)) for color, z in cards)
    return Scene(meshes, Camera((0, 0, -4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (16, 12)), ambient=1.0)


@pytest.mark.parametrize("layers", [LAYERS, ()])
@pytest.mark.parametrize(("apart", "tied"), [(1e-12, True), (1e-7, False)])
def test_either_of_two_faces_at_one_depth_may_own_a_pixel(layers, apart, tied):
    frame = frame_of(two_cards(apart), Settings(layers=layers))
    assert clshade.check(frame, "all").passed
    frame.rgba[3, 3, :3] = (0.0, 1.0, 0.0)
    if layers:
        frame["id"][3, 3] = 2
    report = clshade.check(frame, "all")
    assert (report.passed, report.ties) == (tied, tied)


def test_a_highlights_gate_may_be_decided_either_way():
    frame = teapot_frame()
    frame.rgba[30, 40, :3] += 1e-3
    assert clshade.check(frame, "all").gates == 0
    rows, columns = np.divmod(np.arange(4800), 80)
    expected = oracle.render(frame.scene, frame.settings, rows, columns)
    for highlight, excepted in ((1e-3, True), (9e-4, False)):
        jump = expected.jump.copy()
        jump[30 * 80 + 40] = highlight
        comparison = check.Comparison(frame, replace(expected, jump=jump), rows, columns)
        assert comparison.gates.sum() == excepted
        assert (comparison.counted.max() <= 1.0) == excepted


def test_edges_and_highlights_have_their_share():
    frame = teapot_frame()
    counts = {name: count for name, (count, _) in clshade.check(frame, 400).strata.items()}
    assert sum(counts.values()) == 400
    assert min(counts["silhouettes"], counts["highlights"]) >= 80
    assert counts["background"] >= 10
    limit = np.quantile(frame.rgb.max(axis=-1)[frame.alpha > 0], 0.9)
    assert (frame.rgb.max(axis=-1)[check._strata(frame) == check.STRATA.index("highlights")] >= limit).all()


def test_an_image_of_one_pixel_and_an_empty_one():
    scene = scenes.teapot(3, (80, 60))
    small = [replace(scene, camera=scene.camera.with_resolution(size)) for size in ((1, 1), (1, 5), (7, 1))]
    for odd in (*small, replace(scene, meshes=())):
        assert clshade.check(frame_of(odd, Settings(layers=LAYERS))).passed


def test_refused_numbers_of_pixels():
    frame = teapot_frame()
    for pixels in (0, -1, 2.5, "some", None, True):
        with pytest.raises(InputError, match="check: pixels: expected a whole number"):
            clshade.check(frame, pixels)


@pytest.mark.long
@pytest.mark.parametrize("name", ["teapot", "course", "box_room", "quads", "icosphere"])
@pytest.mark.parametrize(("preset", "shader"), [
    ("standard", "phong"), ("standard", "gouraud"), ("course", "gouraud"), ("course", "nolight"),
])  # fmt: skip
def test_built_in_scenes_pass(device, name, preset, shader):
    scene = scenes.builtin(name, resolution=(160, 120))
    frame = clshade.render(scene, device=device, preset=preset, shader=shader, layers=LAYERS)
    assert clshade.check(frame, "all").passed


SMALL = ("render", "quads", "--resolution", "32,24", "--preset", "course")


@needs_device
@pytest.mark.parametrize(("pixels", "title"), [
    ("200", "lower bound of the largest error: 200 of 768"), ("all", "largest error: 768 of 768"),
])  # fmt: skip
def test_check_prints_its_error_and_writes_it_into_the_header(tmp_path, capsys, pixels, title):
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / "a", "--check", pixels)
    assert (code, err) == (0, [])
    count = int(title.split()[-3])
    for words in (f"{count} of 768 pixels computed again in float64", "0 wrong"):
        assert words in out
    channels, header = exr.read(tmp_path / "a.exr")
    assert set(channels) == {"R", "G", "B", "A", "Z", "id", *(["error"] if pixels == "all" else [])}
    assert header["check"].startswith(f"{title} pixels")
    assert (header["checkPixels"], header["checkWrongPixels"]) == (count, 0)
    assert 0.0 < header["checkErrorBounds"] < 32.0
    assert 0.0 < header["checkErrorRelative"] < 1e-4
    assert 0.0 <= header["checkDepthRoundings"] <= oracle_bounds.DEPTH_ROUNDINGS
    if pixels == "all":
        assert channels["error"].dtype == np.float32
        assert channels["error"].max() == pytest.approx(header["checkErrorBounds"])
        report = json.loads(run(capsys, *SMALL, "-o", tmp_path / "a", "--check", "all", "--stats")[1])["check"]
        assert (report["passed"], report["allowed"], report["pixels"], report["of"]) == (True, 32.0, 768, 768)


@needs_device
def test_a_failed_check_is_an_exit_code(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(oracle_bounds, "HALF_ULP", 2.0**-40)
    code, out, _ = run(capsys, *SMALL, "-o", tmp_path / "a", "--check")
    assert (code, "FAILED" in out) == (1, True)
    assert (tmp_path / "a.exr").exists()
