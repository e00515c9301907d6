"""demos/other_renderers.py: the exact answer that renderers are compared with, and errors of images."""

import sys
from pathlib import Path

import numpy as np
import pytest

import clshade

sys.path.append(str(Path(__file__).resolve().parents[2] / "demos"))  # where its processes find it, too

import other_renderers as script

COLUMNS, ROWS = SIZE = (16, 12)
PITCH = 1.0 / 8.0  # of a pixel at depth 1
LIGHT = np.array([0.5, 1.0, 0.0])


def scene_of(corners, faces, depth=1.0):
    """Return triangles whose corners are places in the image, in pixels from its lower left, at a depth."""
    camera = clshade.Camera((0.0,) * 3, (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (ROWS * PITCH, COLUMNS * PITCH), SIZE)
    places = PITCH * (np.array(corners) - [COLUMNS / 2, ROWS / 2])
    verts = np.multiply(depth, np.concatenate([places, np.full((len(places), 1), -1.0)], axis=1))
    return script.plain("known", verts, np.array(faces), camera, LIGHT)


KNOWN = [[3.0, 2.0], [13.0, 2.0], [3.0, 10.0]], [[0, 1, 2]]


def known_answer():
    """Return coverage, depth and color of the pixels of KNOWN in closed form; no center lies on an edge."""
    x, up = np.meshgrid(np.arange(COLUMNS) + 0.5, ROWS - np.arange(ROWS) - 0.5)
    covered = (x > 3.0) & (up > 2.0) & ((x - 3.0) / 10.0 + (up - 2.0) / 8.0 < 1.0)
    points = 2.0 * np.stack([PITCH * (x - COLUMNS / 2), PITCH * (up - ROWS / 2), np.full_like(x, -1.0)], axis=2)
    toward = LIGHT - points
    cosine = toward[..., 2] / np.linalg.norm(toward, axis=2)
    return covered, np.where(covered, 2.0, np.inf), np.where(covered, cosine, 0.0)[..., None] * script.KD


def test_the_exact_answer_is_the_known_one():
    answer, (covered, depth, rgb) = script.exact(scene_of(*KNOWN, depth=2.0)), known_answer()
    assert not answer.tied.any()
    assert (answer.covered == covered).all()
    np.testing.assert_allclose(answer.depth, depth, rtol=1e-12)
    np.testing.assert_allclose(answer.rgb, rgb, atol=1e-7)


@pytest.mark.long
def test_renderers_draw_the_known_scene(monkeypatch, capsys):
    """Those that are installed, each in a process; what is missing is named. The scene has several depths."""
    scene = scene_of(*KNOWN, depth=[[1.0], [2.0], [3.0]])
    monkeypatch.setitem(script.SCENES, "fan", lambda resolution: scene)
    assert script.main(["--only", "fan", "--frames", "1"]) == 0
    printed = capsys.readouterr().out
    assert "| wrong pixels | clshade | float64 |" in printed
    wrong = next(line for line in printed.splitlines() if line.startswith("| known |"))
    assert set(wrong.strip("| ").split(" | ")[1:]) == {"0"}
    missing = [line for line in printed.splitlines() if line.startswith("not drawn: known: ")]
    assert all("No module named" in line for line in missing), missing
