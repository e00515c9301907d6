"""Regions of large errors: planted ones are found, noise is not, and a figure shows them magnified."""

import json

import numpy as np
import pytest
from command_line import run

from clshade.images import compare, compare_figure, exr
from clshade.images.compare import Cluster, find_clusters, leading_clusters
from clshade.images.image_file import Picture


def planted():
    """Return errors with three regions, of 200, 30 and 1 pixels, above noise of at most 1e-4."""
    errors = np.random.default_rng(3).uniform(0.0, 1e-4, (120, 160))
    errors[20:30, 40:60] = 0.1
    errors[22, 50] = 0.2
    errors[80:110, 150] = 0.05
    errors[5, 5] = 0.4
    return errors


def test_planted_regions_are_found_largest_first():
    assert find_clusters(planted()) == (
        Cluster(40, 20, 20, 10, 200, 0.2, (50, 22)),
        Cluster(150, 80, 1, 30, 30, 0.05, (150, 80)),
        Cluster(5, 5, 1, 1, 1, 0.4, (5, 5)),
    )


def test_diagonal_neighbors_are_connected_and_distant_pixels_are_not():
    errors = np.zeros((64, 64))
    assert find_clusters(errors) == ()
    errors[range(8, 24), range(8, 24)] = errors[60, 60] = 1.0
    assert [cluster.pixels for cluster in find_clusters(errors)] == [16, 1]
    errors[range(23, 7, -1), range(8, 24)] = 1.0  # a cross
    assert [cluster.pixels for cluster in find_clusters(errors)] == [32, 1]


def test_infinite_errors_count_and_are_the_worst():
    errors = planted()
    errors[100, 20] = np.inf
    clusters = find_clusters(errors)
    assert clusters[2] == Cluster(20, 100, 1, 1, 1, np.inf, (20, 100))
    assert clusters[2] in leading_clusters(clusters, 2)


@pytest.fixture
def files(folder):
    """Write a.exr, and b.exr, with a square of 6 x 5 pixels that differs in depth and a NaN in its color."""
    planes = {name: np.linspace(0.1, 0.9, 3600, dtype=np.float32).reshape(48, 75).copy() for name in "RGBZ"}
    exr.write("a.exr", planes)
    planes["Z"][30:35, 50:56] += 1.0
    planes["G"][3, 4] = np.nan
    exr.write("b.exr", planes)


def test_the_command_says_where(files, capsys):
    code, out, _ = run(capsys, "compare", "b.exr", "a.exr", "--json")
    layers = json.loads(out, parse_constant=pytest.fail)["layers"]
    assert code == 0
    (cluster,), (unknown, *_) = (layers[name]["clusters"] for name in ("Z", "RGB"))
    assert [cluster[name] for name in ("x", "y", "width", "height", "pixels")] == [50, 30, 6, 5, 30]
    assert (unknown["worst"], unknown["maximum"]) == ([4, 3], "inf")
    code, out, _ = run(capsys, "compare", "b.exr", "a.exr")
    assert code == 0
    assert "Z differs most in 6 x 5 at 50,30 (30 pixels, up to 1)" in " ".join(out.split())


def test_the_figure_shows_them_magnified(files):
    image, reference = (Picture(exr.read(name)[0]) for name in ("b.exr", "a.exr"))
    layers = compare.chosen_layers(image, reference)
    comparisons = compare.compare_layers(image, reference).layers
    clusters = {name: comparisons[name].clusters for name in layers}
    figure = compare_figure.draw(layers, encoded=False, titles=("b", "a"), clusters=clusters)
    panels = [axes for axes in figure.axes if axes.images]
    assert [axes.get_title().split("\n")[0] for axes in panels][9:11] == ["1: Z at 50,30, 6 x 5", "1: a"]
    shown = np.asarray(panels[11].images[0].get_array())
    assert shown.shape == (24, 24, 3)
    assert (np.asarray(panels[5].images[0].get_array()) == compare_figure.UNEQUAL_COLOR).all(axis=-1).sum() == 1
    differs = np.argwhere((shown != shown[0, 0]).any(axis=-1))
    x, y, _, _ = compare_figure.windows(layers, clusters)["Z"][0][1]
    assert [(corner + (y, x)).tolist() for corner in (differs.min(axis=0), differs.max(axis=0))] == [[30, 50], [34, 55]]


def test_windows_lie_in_the_image_and_hold_the_worst_pixel():
    group = compare.group_channels({"Z": np.zeros((300, 500))})["Z"]
    clusters = (
        Cluster(0, 0, 500, 300, 150_000, 0.5, (499, 299)),
        Cluster(400, 200, 3, 3, 9, 0.5, (400, 200)),  # within the first window
        Cluster(0, 299, 1, 1, 1, 2.0, (0, 299)),
    )
    windows = compare_figure.windows({"Z": (group, group)}, {"Z": clusters})["Z"]
    assert [window for _, window in windows] == [(372, 172, 128, 128), (0, 276, 24, 24)]
    inside = Cluster(100, 60, 10, 20, 200, 0.5, (100, 60))
    assert compare_figure.windows({"Z": (group, group)}, {"Z": [inside]})["Z"] == [(inside, (90, 55, 30, 30))]
