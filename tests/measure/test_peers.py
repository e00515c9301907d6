"""`report --peers`: the exact answer, its comparison with images, and where a peer is better."""

from __future__ import annotations

import json
import os
import pickle
import re
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from command_line import run

from clshade.base import text_tables
from clshade.measure.peers import OURS, PEERS, drawing, figure, measure, opener_of, peers, process, scenes, tables
from clshade.measure.peers.drawing import Larger, Picture
from clshade.measure.peers.exact import Exact, exact
from clshade.measure.peers.measure import Errors, Failure, Result
from clshade.measure.timing import FEWEST
from clshade.pipeline.renderer import render
from clshade.scene.camera import Camera

SIZE = (16, 12)  # columns and rows
PITCH = 1.0 / 8.0  # of a pixel at depth 1
LIGHT = np.array([0.5, 1.0, 0.0])


def known_scene():
    """A triangle at depth 2, seen along -z, with the right angle in the image's lower left: legs along the lower edge of row
    2 from the bottom and the left edge of column 3."""
    columns, rows = SIZE
    camera = Camera((0.0,) * 3, (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (rows * PITCH, columns * PITCH), SIZE)
    corners = np.array([[3.0, 2.0], [13.0, 2.0], [3.0, 10.0]]) - [columns / 2, rows / 2]
    verts = 2.0 * np.concatenate([PITCH * corners, [[-1.0]] * 3], axis=1)
    return scenes.plain("known", verts, np.array([[0, 1, 2]]), camera, LIGHT)


def known_answer():
    """Return coverage, depth and color of its pixels in closed form; no center lies on an edge."""
    columns, rows = SIZE
    x, up = np.meshgrid(np.arange(columns) + 0.5, rows - np.arange(rows) - 0.5)
    covered = (x > 3.0) & (up > 2.0) & ((x - 3.0) / 10.0 + (up - 2.0) / 8.0 < 1.0)
    points = 2.0 * np.stack([PITCH * (x - columns / 2), PITCH * (up - rows / 2), np.full_like(x, -1.0)], axis=2)
    toward = LIGHT - points
    cosine = toward[..., 2] / np.linalg.norm(toward, axis=2)
    return covered, np.where(covered, 2.0, np.inf), np.where(covered, cosine, 0.0)[..., None] * scenes.KD


def assert_known(picture, depths=1e-5, colors=1e-5):
    covered, depth, rgb = known_answer()
    assert ((picture.alpha > 0.0) == covered).all()
    assert np.isinf(picture.depth[~covered]).all()
    np.testing.assert_allclose(picture.depth[covered], depth[covered], rtol=depths)
    np.testing.assert_allclose(picture.rgb, rgb, atol=colors)


# The exact answer


def test_the_exact_answer_is_the_known_one():
    found = exact(known_scene())
    assert not found.tied.any()
    assert_known(Picture(found.rgb, found.depth, found.covered), 1e-12, 1e-7)


def test_a_center_on_an_inner_edge_is_covered_and_one_on_the_outline_is_tied():
    columns, rows = SIZE
    scene = known_scene()
    corners = np.array([[2.5, 2.5], [10.5, 2.5], [10.5, 8.5], [2.5, 8.5]]) - [columns / 2, rows / 2]
    verts = np.concatenate([PITCH * corners, [[-1.0]] * 4], axis=1)
    square = scenes.plain("square", verts, np.array([[0, 1, 2], [0, 2, 3]]), scene.camera, LIGHT)
    found = exact(square)
    inner = np.zeros((rows, columns), bool)
    inner[rows - 8 : rows - 3, 3:10] = True
    outer = np.zeros((rows, columns), bool)
    outer[rows - 9 : rows - 2, 2:11] = True
    assert (found.covered & ~found.tied == inner).all()  # among them centers on the diagonal
    assert (found.tied == (outer & ~inner)).all()


def test_a_hole_between_triangles_that_touch_at_the_center_is_tied():
    """Two triangles whose tips meet at a pixel's center: an answer either way is right."""
    columns, rows = SIZE
    tip = [8.5, 6.5]
    corners = np.array([tip, [12.5, 5.0], [12.5, 8.0], [4.5, 5.0], [4.5, 8.0]]) - [columns / 2, rows / 2]
    verts = np.concatenate([PITCH * corners, [[-1.0]] * 5], axis=1)
    bow = scenes.plain("bow", verts, np.array([[0, 1, 2], [0, 4, 3]]), known_scene().camera, LIGHT)
    assert exact(bow).tied[rows - 7, 8]


def test_the_nearer_of_two_surfaces_is_seen():
    scene = known_scene()
    (mesh,) = scene.meshes
    verts = np.concatenate([mesh.verts, 0.5 * mesh.verts])
    both = scenes.plain("both", verts, np.array([[0, 1, 2], [3, 4, 5]]), scene.camera, LIGHT)
    found = exact(both)
    assert (found.depth[found.covered] == 1.0).all()


def test_clshade_agrees_with_the_exact_answer_to_its_grid(opened):
    scene = scenes.SCENES[0].make((64, 48))
    frame = render(scene, device=opened, layers=("Z",))
    errors = measure.exact_errors(Picture(frame.rgb, frame["Z"], frame.alpha), exact(scene))
    assert errors.wrong <= 2
    assert errors.depth < 1e-3
    assert errors.color < 1e-3


@pytest.mark.parametrize("scene", scenes.SCENES[:5], ids=lambda scene: scene.name)
def test_scenes_are_float32_and_fill_a_part_of_the_image(scene):
    made = scene.make((48, 36))
    (mesh,) = made.meshes
    assert mesh.verts.dtype == mesh.normals.dtype == np.float32
    assert made.camera.resolution == (48, 36)
    if len(mesh.faces) < 10_000 and scene.name != "fan":
        assert 0.02 < exact(made).covered.mean() < 0.7


# Errors of images


def right_answer():
    covered, depth, rgb = known_answer()
    return Exact(covered, np.zeros_like(covered), depth, rgb)


def test_errors_count_coverage_surfaces_depth_and_color():
    right = right_answer()
    first, second, third = np.argwhere(right.covered)[[0, 10, 20]]
    right = right._replace(depth=np.where(np.arange(SIZE[0]) > 6, right.depth + 1.0, right.depth))  # a range of depths
    picture = Picture(right.rgb.copy(), right.depth.copy(), right.covered.astype(np.float32))
    assert measure.exact_errors(picture, right) == Errors(0, 0, 0.0, 0.0, 0.0)
    picture.alpha[tuple(first)] = 0.0
    picture.depth[tuple(second)] += 0.5
    picture.depth[tuple(third)] += 0.004
    picture.rgb[tuple(third)] += 0.03
    found = measure.exact_errors(picture, right)
    count = int(right.covered.sum()) - 2
    assert (found.wrong, found.other) == (1, 1)
    assert found.depth == pytest.approx(0.004 / np.sqrt(count))
    assert found.depth_largest == pytest.approx(0.004)
    assert found.color == pytest.approx(0.03 / np.sqrt(count))


def test_an_image_of_which_nothing_is_right_has_no_errors_of_depth_and_color():
    right = right_answer()
    nothing = Picture(
        np.zeros_like(right.rgb), np.full_like(right.depth, np.inf), np.zeros(right.depth.shape, np.float32)
    )
    found = measure.exact_errors(nothing, right)
    assert found == Errors(wrong=int(right.covered.sum()), other=0)
    empty = Exact(np.zeros_like(right.covered), right.tied, nothing.depth, nothing.rgb)
    assert measure.exact_errors(nothing, empty) == Errors(wrong=0, other=0)


def test_a_tie_is_no_error_and_a_missing_depth_is_another_surface():
    right = right_answer()
    place = tuple(np.argwhere(right.covered)[0])
    picture = Picture(right.rgb, right.depth.copy(), right.covered.astype(np.float32))
    picture.depth[place] = np.nan
    assert measure.exact_errors(picture, right).other == 1
    tied = np.zeros_like(right.covered)
    tied[place] = True
    assert measure.exact_errors(picture, right._replace(tied=tied)).other == 0


@pytest.mark.long
def test_the_converged_image_has_the_area_and_light_of_the_scene(opened):
    converged = measure._converged(known_scene(), opened)
    assert converged.alpha.sum() == pytest.approx(40.0, rel=1e-3)  # pixels: half of 10 x 8
    covered, _, rgb = known_answer()
    inside = covered & (converged.alpha == 1.0)
    np.testing.assert_allclose(converged.rgb[inside], rgb[inside], rtol=2e-2)


def test_a_larger_image_gives_the_mean():
    opener = opener_of("numpy")
    picture = Larger(opener, "numpy", known_scene(), 16, 0).draw()
    assert picture.depth.size == 0
    assert picture.rgb.shape == (*SIZE[::-1], 3)
    assert picture.alpha.sum() == pytest.approx(40.0, abs=0.7)
    assert set(np.unique(picture.alpha * 16.0)) <= set(range(17))


def test_lambert_without_normal_or_behind_is_dark():
    scene = known_scene()
    normals = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, 2.0]], np.float32)
    lit = drawing.lambert(normals, np.array([[0.5, 1.0, -1.0]] * 3, np.float32), scene)
    np.testing.assert_allclose(lit, [[0.0] * 3, [0.0] * 3, scenes.KD], rtol=1e-6)
    assert lit.dtype == np.float32


# Renderers


@pytest.mark.parametrize("name", ["clshade", "numpy"])
def test_a_renderer_samples_the_centers_of_pixels(name, opened):
    assert_known(opener_of(name)(name, known_scene(), 1, 0).draw())


@pytest.mark.long
@pytest.mark.parametrize("samples", drawing.SAMPLES)
@pytest.mark.parametrize("name", [name for name in PEERS if name not in ("clshade", "numpy")])
def test_a_renderer_in_its_own_process_draws_the_known_image(name, samples, tmp_path):
    """The known triangle, whose every edge is far from centers: a shift or a mirrored image would show."""
    (tmp_path / "scene").write_bytes(pickle.dumps(known_scene()))
    try:
        made = process.Process(name, *process.command(name, tmp_path / "scene", samples, 1))
    except process.PeerError as error:
        if name in OURS or not re.search("not installed|on Debian", str(error)):
            raise
        pytest.skip(str(error))
    with closing(made):
        made.draw()
        picture = made.picture()
    if samples == 1:
        assert_known(picture, *((1e-5, 2.1e-3) if name == "vtk" else ()))
    else:
        assert picture.alpha.sum() == pytest.approx(40.0, abs=0.7)
        covered, _, rgb = known_answer()
        inside = covered & (picture.alpha == 1.0)
        assert inside.sum() > 20
        np.testing.assert_allclose(picture.rgb[inside], rgb[inside], atol=5e-3)


# Tables


def result(renderer="clshade", scene="grid", samples=1, ms=2.0, **errors):
    return Result(scene, renderer, samples, f"{renderer} 1.0", Errors(**errors), True, True, (ms,) * 5)


FIRST = {"wrong": 1, "other": 0, "depth": 1e-3, "depth_largest": 1e-2, "color": 1e-4}
FOUND = [
    result(**FIRST),
    result("embree", ms=3.0, **{**FIRST, "wrong": 0, "depth": 0.95e-3}),
    result("numpy", ms=1.0, **{**FIRST, "depth": 1e-6, "color": 1e-3}),
    result(samples=16, alpha=2e-2, color=1e-2),
    replace(result("numpy", samples=16, alpha=1e-2, color=1e-2), same_runs=False),
    Failure("grid", "vtk", 1, "vtk: vtk is not installed"),
    Failure("grid", "vtk", 16, "vtk: vtk is not installed"),
    Failure("fan", "vtk", 1, "vtk: vtk is not installed"),
]


def test_sentences_say_where_a_peer_is_better():
    assert tables.better(FOUND) == [
        "A peer is better in wrong pixels at 1 sample on 1 of 1 scenes: grid (embree 0, clshade 1).",
        "A peer is better in RMS error of depth at 1 sample on 1 of 1 scenes: grid (numpy 1e-06, clshade 0.001).",
        "A peer is better in milliseconds at 1 sample on 1 of 1 scenes: grid (numpy 1, clshade 2).",
        "A peer is better in RMSE of coverage at 16 samples on 1 of 1 scenes: grid (numpy 0.01, clshade 0.02).",
    ]
    assert tables.better(FOUND[1:3]) == []


def test_a_peer_that_draws_nothing_right_is_better_in_nothing():
    nothing = result("embree", wrong=40, other=0)
    assert tables.better([FOUND[0], nothing]) == []
    assert tables.rows([nothing])[0][2:6] == ("40", "-", "-", "-")


def test_few_frames_do_not_show_that_a_peer_is_faster():
    few = [replace(each, times=each.times[: FEWEST - 1]) for each in (FOUND[0], result("numpy", ms=1.0, **FIRST))]
    assert tables.better(few) == []


def test_the_table_has_a_row_for_each_scene_and_renderer_and_fits():
    rows = tables.rows(FOUND)
    assert rows[0] == ("grid", "clshade", "1", "0.001", "0.01", "0.0001", "2", "0.02", "0.01", "2", "same")
    assert rows[1] == ("grid", "embree", "0", "0.00095", "0.01", "0.0001", "3", "-", "-", "-", "same")
    assert rows[2][-1] == "runs"
    lines = text_tables.as_lines(
        tables.HEADER,
        [*rows, ("slivers", "clshade-float64", "1502", *["2.4e-07"] * 3, "1051", *["2.4e-07"] * 2, "4032", "same")],
        2,
    )
    assert len(lines) == 1 + len(rows) + 1  # in one piece
    assert tables.failures(FOUND) == ["not drawn: grid, fan: vtk: vtk is not installed"]
    assert tables.passed(FOUND)
    assert not tables.passed([*FOUND, Failure("fan", "clshade", 1, "clshade: ended with exit code 1")])


def test_means_are_of_the_scenes_that_all_drew_with_as_many_samples():
    more = [result(scene="fan"), result("numpy", scene="fan")]
    assert figure._common([each for each in tables.results([*FOUND, *more]) if each.samples == 1]) == {"grid"}
    assert figure._common(more) == {"fan"}


def test_the_figure_names_every_renderer_that_drew_something_right(tmp_path, monkeypatch):
    named = []
    monkeypatch.setattr(
        figure, "label_points", lambda axes, across, up, names: named.extend(zip(names, across, up, strict=True))
    )
    figure.plot([*FOUND, result("riley", wrong=40, other=0)], tmp_path / "peers.png")
    assert [name for name, *_ in named] == ["clshade", "embree", "numpy", "clshade, 16", "numpy, 16"]
    assert named[2][1:] == pytest.approx((1.0, 1e-3))
    figure.plot([], tmp_path / "none.png")
    assert (tmp_path / "none.png").is_file()


# The command


@pytest.mark.long
def test_the_command_measures_and_writes(tmp_path, capsys, opened):
    small = "--only", "grid", "--resolution", "24x18", "--frames", "1", "-o", tmp_path
    code, printed, _ = run(capsys, "report", "--peers", "numpy", *small)
    assert code == 0
    assert "grid   numpy" in printed
    assert max(map(len, printed.splitlines()[2:-4])) <= text_tables.WIDTH
    stats = json.loads((tmp_path / "peers.json").read_text())
    assert [(each["renderer"], each["samples"]) for each in stats["results"]] == [
        (name, samples) for samples in (1, 16) for name in ("clshade", "numpy")
    ]
    assert stats["results"][1]["errors"]["wrong"] <= 2  # its float32 spans leave out two centers on inner edges
    assert stats["results"][1]["errors"]["depth"] < 1e-6
    assert (tmp_path / "peers.png").is_file()
    assert (tmp_path / "peers.csv").read_text().startswith("scene,renderer,wrong,")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--peers", "llvmpip"), "found 'llvmpip': did you mean 'llvmpipe'?"),
        (("--peers", "--only", "gird"), "found 'gird': did you mean 'grid'?"),
        (("--peers", "--frames", "0"), "--frames: expected a whole number above 0, found 0"),
        (("--peers", "--budget", "5"), "--budget: cannot go with --peers"),
        (("--peers", "--look", "plain"), "--look: cannot go with --peers"),
        (("--peers", "--camera-view-angle", "40"), "--camera-view-angle: cannot go with --peers"),
        (("icosphere", "--peers"), "SCENE: cannot go with --peers"),
    ],
)
def test_what_the_command_refuses(options, message, capsys):
    code, _, said = run(capsys, "report", *options)
    assert code == 2
    assert len(said) == 1
    assert message in said[0]


def test_the_device_is_that_of_the_renderers_processes_too(monkeypatch, capsys):
    monkeypatch.setenv("CLSHADE_DEVICE", "nvidia")
    seen = []
    monkeypatch.setattr(
        peers, "run", lambda names, device, **_: seen.append((device, os.environ["CLSHADE_DEVICE"])) or True
    )
    assert run(capsys, "report", "--peers", "--device", "pocl")[0] == 0
    assert seen == [("pocl", "pocl")]


def test_a_scene_whose_file_is_not_there_is_refused_or_left_out(monkeypatch):
    monkeypatch.delenv(scenes.DATA, raising=False)
    assert [each.name for each in peers._scenes(())] == ["teapot", "fan", "grid", "offset", "slivers", "million"]
    with pytest.raises(Exception, match=r"--only: spot: expected a file spot/spot\.obj in the folder CLSHADE_DATA"):
        peers._scenes(["spot"])


def test_the_list_names_renderers_and_scenes(capsys):
    code, printed, _ = run(capsys, "report", "--peers", "--list")
    assert code == 0
    for name in (*PEERS, *(each.name for each in scenes.SCENES)):
        assert f"\n{name} " in f"\n{printed}"
