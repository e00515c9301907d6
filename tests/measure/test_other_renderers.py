"""demos/other_renderers.py: the exact answer that renderers are compared with, and errors of images."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import clshade

sys.path.append(str(Path(__file__).resolve().parents[2] / "demos"))  # where its processes find it, too

import other_renderers as script

SIZE = (16, 12)  # columns and rows
PITCH = 1.0 / 8.0  # of a pixel at depth 1
LIGHT = np.array([0.5, 1.0, 0.0])


def scene_of(corners, faces, depth=1.0):
    """Return triangles whose corners are places in the image, in pixels from its lower left, at a depth."""
    columns, rows = SIZE
    camera = clshade.Camera((0.0,) * 3, (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (rows * PITCH, columns * PITCH), SIZE)
    places = PITCH * (np.array(corners) - [columns / 2, rows / 2])
    verts = depth * np.concatenate([places, np.full((len(places), 1), -1.0)], axis=1)
    return script.plain("known", verts, np.array(faces), camera, LIGHT)


KNOWN = scene_of([[3.0, 2.0], [13.0, 2.0], [3.0, 10.0]], [[0, 1, 2]], depth=2.0)


def known_answer():
    """Return coverage, depth and color of the pixels of KNOWN in closed form; no center lies on an edge."""
    columns, rows = SIZE
    x, up = np.meshgrid(np.arange(columns) + 0.5, rows - np.arange(rows) - 0.5)
    covered = (x > 3.0) & (up > 2.0) & ((x - 3.0) / 10.0 + (up - 2.0) / 8.0 < 1.0)
    points = 2.0 * np.stack([PITCH * (x - columns / 2), PITCH * (up - rows / 2), np.full_like(x, -1.0)], axis=2)
    toward = LIGHT - points
    cosine = toward[..., 2] / np.linalg.norm(toward, axis=2)
    return covered, np.where(covered, 2.0, np.inf), np.where(covered, cosine, 0.0)[..., None] * script.KD


def test_the_exact_answer_is_the_known_one():
    answer, (covered, depth, rgb) = script.exact(KNOWN), known_answer()
    assert not answer.tied.any()
    assert (answer.covered == covered).all()
    np.testing.assert_allclose(answer.depth, depth, rtol=1e-12)
    np.testing.assert_allclose(answer.rgb, rgb, atol=1e-7)


def test_a_center_on_an_inner_edge_is_covered_and_one_on_the_outline_is_tied():
    _, rows = SIZE
    answer = script.exact(scene_of([[2.5, 2.5], [10.5, 2.5], [10.5, 8.5], [2.5, 8.5]], [[0, 1, 2], [0, 2, 3]]))
    inner, outer = np.zeros((2, *SIZE[::-1]), bool)
    inner[rows - 8 : rows - 3, 3:10] = True
    outer[rows - 9 : rows - 2, 2:11] = True
    assert (answer.covered & ~answer.tied == inner).all()  # among them centers on the diagonal
    assert (answer.tied == (outer & ~inner)).all()


def test_a_hole_between_triangles_that_touch_at_the_center_is_tied():
    """Two triangles whose tips meet at a pixel's center: an answer either way is right."""
    corners = [[8.5, 6.5], [12.5, 5.0], [12.5, 8.0], [4.5, 5.0], [4.5, 8.0]]
    assert script.exact(scene_of(corners, [[0, 1, 2], [0, 4, 3]])).tied[SIZE[1] - 7, 8]


def test_errors_count_coverage_surfaces_depth_and_color():
    covered, depth, rgb = known_answer()
    depth = np.where(np.arange(SIZE[0]) > 6, depth + 1.0, depth)  # a range of depths
    right = script.Exact(covered, np.zeros_like(covered), depth, rgb)
    first, second, third, fourth = (tuple(place) for place in np.argwhere(right.covered)[[0, 10, 20, 30]])
    picture = script.Picture(right.rgb.copy(), right.depth.copy(), right.covered.astype(np.float32))
    assert script.exact_errors(picture, right) == {"wrong": 0, "depth": 0.0, "color": 0.0}
    picture.alpha[first] = 0.0
    picture.depth[second] += 0.5
    picture.depth[third] += 0.004
    picture.rgb[third] += 0.03
    picture.depth[fourth] = np.nan
    errors = script.exact_errors(picture, right)
    count = int(right.covered.sum()) - 3
    assert errors["wrong"] == 3
    assert errors["depth"] == pytest.approx(0.004 / np.sqrt(count))
    assert errors["color"] == pytest.approx(0.03 / np.sqrt(count))
    tied = np.zeros_like(right.covered)
    tied[first] = tied[second] = tied[fourth] = True
    assert script.exact_errors(picture, right._replace(tied=tied))["wrong"] == 0


def test_clshade_agrees_with_the_exact_answer_to_its_grid(opened):
    scene = script.SCENES["teapot"]((64, 48))
    frame = clshade.render(scene, device=opened, layers=("Z",))
    errors = script.exact_errors(script.Picture(frame.rgb, frame["Z"], frame.alpha), script.exact(scene))
    assert errors["wrong"] == 0
    assert errors["depth"] < 4e-6  # of corners on 1/256 px: 4e-4
    assert errors["color"] < 2e-5


@pytest.mark.long
def test_renderers_draw_the_known_scene(tmp_path, monkeypatch, capsys):
    """Those that are installed, each in a process; what is missing is named."""
    (mesh,) = KNOWN.meshes
    deep = mesh.verts * [[0.5], [1.0], [1.5]]  # covers these pixels at several depths
    scene = script.plain("known", deep, mesh.faces, KNOWN.camera, LIGHT)
    monkeypatch.setitem(script.SCENES, "fan", lambda resolution: scene)
    assert script.main(["--only", "fan", "--frames", "1", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "| wrong pixels | clshade | float64 |" in printed
    wrong = next(line for line in printed.splitlines() if line.startswith("| known |"))
    assert set(wrong.strip("| ").split(" | ")[1:]) == {"0"}
    missing = [line for line in printed.splitlines() if line.startswith("not drawn: known: ")]
    assert all("No module named" in line for line in missing), missing
    assert (tmp_path / "other_renderers.png").stat().st_size > 10_000
