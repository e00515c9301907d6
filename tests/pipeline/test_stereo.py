"""Stereo pairs that were drawn: disparities are what the depths of either image say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.cli.main import main
from clshade.images import exr
from clshade.pipeline.renderer import Renderer, render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene

FOCAL, BASELINE, CONVERGENCE = 240.0, 0.5, 8.0
K = np.array([[FOCAL, 0.0, 81.3], [0.0, 220.0, 60.2], [0.0, 0.0, 1.0]])
POSE = np.array([[0.6, 0.0, -0.8, 1.0], [0.0, 1.0, 0.0, -2.0], [0.8, 0.0, 0.6, 3.0], [0.0, 0.0, 0.0, 1.0]])
SIZE = (160, 120)


def drawn(scene: Scene, camera: Camera, device) -> list[np.ndarray]:
    """Return Z, float64, and id of the left and of the right image."""
    pair = camera.stereo(BASELINE, CONVERGENCE)
    with Renderer(scene, shader="nolight", layers=("Z", "id"), device=device) as renderer:
        frames = [renderer.render(eye) for eye in pair]
        return [layer for frame in frames for layer in (frame["Z"].astype(np.float64), frame["id"].astype(int))]


def placed(local: np.ndarray) -> np.ndarray:
    """Return points of an OpenCV camera's frame in world space."""
    return local @ POSE[:3, :3].T + POSE[:3, 3]


def disparity(depth: np.ndarray) -> np.ndarray:
    return FOCAL * BASELINE * (1 / depth - 1 / CONVERGENCE)


def test_whole_disparities_shift_the_image(device):
    """Bars at depths whose disparities are whole numbers: the right image is the left one, shifted row by row."""
    depths, corners = np.array([2.0, 3.0, 4.0, 6.0, 10.0, 12.0]), []
    for k, depth in enumerate(depths):
        top, left = 8.37 + 18 * k, 51.21 + 3 * k
        pixels = np.array([[left, top], [left + 57.4, top], [left + 57.4, top + 13.3], [left, top + 13.3]])
        corners.append(np.column_stack([(pixels - K[:2, 2]) / [FOCAL, 220.0] * depth, np.full(4, depth)]))
    faces = np.concatenate([[[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]] for i in range(len(depths))])
    camera = Camera.from_matrix(K, POSE, SIZE)
    scene = Scene((Mesh(placed(np.concatenate(corners)), faces),), camera)
    left, left_id, right, right_id = drawn(scene, camera, device)
    for k, depth in enumerate(depths):
        band = slice(round(8 + 18 * k), round(24 + 18 * k))
        shift = round(disparity(depth))
        assert disparity(depth) == pytest.approx(shift, abs=1e-12)
        moved = np.roll(left[band], -shift, axis=1)
        moved_id = np.roll(left_id[band], -shift, axis=1)
        assert (moved_id > 0).sum() > 600
        assert np.array_equal((moved_id + 1) // 2, (right_id[band] + 1) // 2)
        seen = moved_id > 0
        # Z is constant on a bar; 10 roundings of 2^-24.
        assert np.abs(moved[seen] / depth - 1).max() <= 10 * 2.0**-24
        assert np.abs(right[band][seen] / depth - 1).max() <= 10 * 2.0**-24


def test_a_pixel_of_the_left_image_is_found_in_the_right_one(device):
    """Of a slanted plane 1/Z is linear in the image, so between two pixels of the right one it is interpolated exactly; at
    where the left depth says, its own depth says the same disparity, within 1/12000 px: vertices are snapped by up to
    1/131072 px along either axis in each image, where disparities change by less than 1/4 px a pixel, and each 1/Z has up
    to 10 roundings of 2^-24, of 46 px of disparity."""
    local = np.array([[-1.1, -0.9, 2.6], [1.3, -1.0, 4.1], [1.2, 1.1, 4.9], [-1.0, 0.8, 3.2]])
    local[3, 2] = (
        local[0, 2]
        + np.linalg.solve(  # on the plane of the others
            np.column_stack([local[1, :2] - local[0, :2], local[2, :2] - local[0, :2]]), local[3, :2] - local[0, :2]
        )
        @ (local[1:3, 2] - local[0, 2])
    )
    camera = Camera.from_matrix(K, POSE, SIZE)
    scene = Scene((Mesh(placed(local), [[0, 1, 2], [0, 2, 3]]),), camera)
    left, left_id, right, right_id = drawn(scene, camera, device)
    rows, columns = np.nonzero(left_id)
    there = columns - disparity(left[rows, columns])
    first = np.floor(there).astype(int)
    inside = (first >= 0) & (first < SIZE[0] - 1)
    rows, columns, there, first = rows[inside], columns[inside], there[inside], first[inside]
    both = (right_id[rows, first] > 0) & (right_id[rows, first + 1] > 0)
    assert both.sum() > 4000
    rows, columns, there, first = rows[both], columns[both], there[both], first[both]
    part = there - first
    inverse = (1 - part) / right[rows, first] + part / right[rows, first + 1]
    error = np.abs(disparity(1 / inverse) - (columns - there))
    assert np.ptp(there - columns) > 10
    assert error.max() < 1 / 12000


@pytest.mark.parametrize("convergence", [None, 5.0])
def test_pairs_of_a_command_are_those_of_python(device, tmp_path, convergence):
    """Also at another resolution than the scene's, at which principal points are fractions of another width."""
    options = () if convergence is None else ("--convergence", str(convergence))
    small = ("--resolution", "40,24", "--preset", "course", "--layers", "Z,id", "--deterministic", "--quiet")
    assert main(["render", "quads", *small, "--stereo", "0.25", *options, "-o", str(tmp_path / "a")]) == 0
    scene = builtin("quads")
    pair = scene.camera.with_resolution((40, 24)).stereo(0.25, convergence)
    for eye, name in zip(pair, ("left", "right"), strict=True):
        frame = render(replace(scene, camera=eye), preset="course", layers=("Z", "id"), device=device)
        assert np.array_equal(exr.read(tmp_path / f"a.{name}.exr")[0]["Z"], frame["Z"])
