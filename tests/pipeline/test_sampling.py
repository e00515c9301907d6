"""Several samples per pixel: their positions, their coverage, and the resolve."""

from dataclasses import replace

import numpy as np
import oracle_asserts
import pytest
from devices import rendered

import clshade
from clshade import oracle
from clshade.errors import InputError
from clshade.measure.stability.cases.lit import CAMERA, LIGHTS, blob
from clshade.oracle.coverage import places
from clshade.pipeline import programs
from clshade.pipeline.camera_space import sample_positions
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Settings

LAYERS = ("Z", "id")
# One unit in the plane z = 0 is a pixel; the image's lower left corner is (0, 0).
WIDTH, HEIGHT = 61, 47


def flat(points, faces, **fields) -> Scene:
    """Return triangles in the plane z = 0, in pixels, by default white on black."""
    eye = (WIDTH / 2, HEIGHT / 2, -100.0)
    camera = Camera(eye, (*eye[:2], 0.0), (0, 1, 0), 100.0, (float(HEIGHT), float(WIDTH)), (WIDTH, HEIGHT))
    # Seen from -z with y up, the x axis points to the left: mirror it, so that columns increase with x.
    x, y = np.asarray(points, float).T
    return Scene(Mesh(np.stack([WIDTH - x, y, 0.0 * x], axis=1), faces, **fields), camera)


def draw(device, scene: Scene, **options):
    return rendered(scene, device=device, layers=LAYERS, **options)


# Positions


def test_places():
    """On the grid of 1/256 px, all different, symmetric about the center, the nearest to it first, and the oracle's. A
    triangle that covers them all is lit at the center; one sample is there."""
    for samples in range(1, 65):
        positions = sample_positions(samples)
        assert positions.min() >= 0, samples
        assert positions.max() <= 255, samples
        assert np.unique(positions, axis=0).shape == (samples, 2)
        assert (np.diff(((positions - 128) ** 2).sum(axis=1)) >= 0).all(), samples
        assert {tuple(place) for place in positions} == {tuple(place) for place in 256 - positions}, samples
        assert np.array_equal(positions, places(samples)), samples


@pytest.mark.parametrize(("samples", "rows"), [(4, 4), (9, 9), (16, 16), (64, 43)])
def test_every_column_and_nearly_every_row_of_strips_has_a_sample(samples, rows):
    """Each of S columns has exactly one sample, and so has each row of a rotated grid; of S rows, the golden ratio's
    multiples leave less than a third empty: at most three different gaps occur between them, the widest 1.9 times the
    mean."""
    x, y = sample_positions(samples).T * samples // 256
    assert sorted(x) == list(range(samples))
    assert len(set(y)) >= rows


# Coverage


def star(points: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """Return needles around a center, none along an axis."""
    i = np.arange(2 * points)
    angle, radius = 0.1234 + i * np.pi / points, np.where(i % 2, 6.0, 21.0)
    rim = np.stack([30.3 + radius * np.cos(angle), 23.4 + radius * np.sin(angle)], axis=1)
    return np.concatenate([[[30.3, 23.4]], rim]), np.stack([0 * i, 1 + i, 1 + (i + 1) % len(i)], axis=1)


def test_a_mesh_is_watertight_at_every_sample(device):
    """Triangles over the whole image, down to slivers: no sample is missed."""
    rng = np.random.default_rng(7)
    corners = [[-5, -5], [WIDTH + 5, -5], [WIDTH + 5, HEIGHT + 5], [-5, HEIGHT + 5]]
    points = np.concatenate([corners, rng.uniform([0, 0], [WIDTH, HEIGHT], (1, 2))])
    faces = [[k, (k + 1) % 4, 4] for k in range(4)]
    for k in range(5, 40):  # a random point splits a triangle in three
        a, b, c = faces.pop(int(rng.integers(len(faces))))
        points = np.concatenate([points, [rng.dirichlet([1, 1, 1]) @ points[[a, b, c]]]])
        faces += [[a, b, k], [b, c, k], [c, a, k]]
    scene = flat(points, faces)
    for samples in (3, 16, 64):
        frame = draw(device, scene, shader="nolight", samples=samples)
        assert (frame.alpha == 1.0).all()
        assert (frame.rgb == 1.0).all()


@pytest.mark.long
@pytest.mark.parametrize("options", [{"lanes": 1}, {}], ids=str)
def test_triangles_of_a_millionth_of_a_pixel_show_at_centers(device, options):
    """Their edge functions are below 2^16, the unit in which blocks are tested."""
    places = np.argwhere(np.ones((4, 4))) + [8, 20]
    corners = np.array([[0.0, 1e-3], [-1e-3, -1e-3], [1e-3, -1e-3]]) + places[:, None] + 0.5
    frame = draw(device, flat(corners.reshape(-1, 2), np.arange(48).reshape(-1, 3)), shader="nolight", **options)
    rows, columns = np.nonzero(frame.alpha)
    assert sorted(zip(columns, HEIGHT - 1 - rows, strict=True)) == [tuple(place) for place in places]


def test_a_triangle_that_covers_all_samples_is_lit_at_the_center(device):
    """The same bits as with one sample, except where a pixel has several owners."""
    scene = Scene((blob(),), CAMERA.with_resolution((64, 48)), LIGHTS)
    one, four = draw(device, scene), draw(device, scene, samples=4)
    assert 0.5 < (one.rgb == four.rgb).all(axis=-1)[four.alpha == 1.0].mean() < 1.0


def needles(samples: int, length: float) -> Scene:
    """Return colored triangles, some 1/2000 px wide, that cover at least two samples of a pixel each."""
    places, rng = sample_positions(samples) / 256, np.random.default_rng(samples)
    points = []
    for row in range(2, HEIGHT, 3):
        a, b = places[rng.choice(samples, 2, replace=False)] + [WIDTH // 2, row]
        along = length * (b - a) / np.linalg.norm(b - a)
        aside = 1e-4 * np.array([-along[1], along[0]]) / length
        points += [a - along - aside, b + along - aside, (a + b) / 2 + 4 * aside]
    return flat(points, np.arange(len(points)).reshape(-1, 3), colors=rng.uniform(size=(len(points), 3)))


@pytest.mark.parametrize("length", [2.0, 200.0])
@pytest.mark.parametrize("interpolation", ["affine", "perspective"])
def test_where_rounding_puts_the_mean_beside_a_triangle_its_color_is_not_extrapolated(device, length, interpolation):
    """The mean of samples in a line, rounded to 1/256 px, is often outside of a needle, by many times its width."""
    frame = draw(device, needles(8, length), shader="nolight", samples=8, interpolation=interpolation)
    oracle_asserts.assert_drawn(frame)
    color = frame.rgb[frame.alpha > 0.2] / frame.alpha[frame.alpha > 0.2][:, None]
    assert len(color) > 10
    assert color.max() <= 1.0 + 1e-6


# The resolve


@pytest.mark.long
def test_weighted_keeps_bright_samples_from_standing_out(device):
    """A surface of radiance 1000 beside black: half a pixel gives 500, weighted 1000 * w / (w + 1), w = 1/1001."""
    points = [[-1, -1], [30.5, -1], [30.5, HEIGHT + 1], [-1, HEIGHT + 1]]
    scene = flat(points, [[0, 1, 2], [0, 2, 3]], material=Material(color=1000.0))
    for resolve, expected in (("mean", 500.0), ("weighted", 1000.0 / 1001.0 / (1.0 / 1001.0 + 1.0))):
        frame = draw(device, scene, shader="nolight", samples=4, resolve=resolve)
        assert frame.rgb[20, 30] == pytest.approx(expected, rel=1e-5)


def test_weighted_over_nothing_is_premultiplied(device):
    """A single color is preserved, however bright: only its coverage changes."""
    points, faces = star()
    for color in (100.0, 1e24):
        scene = replace(flat(points, faces, material=Material(color=color)), background=None)
        frame = draw(device, scene, shader="nolight", samples=16, resolve="weighted")
        oracle_asserts.assert_drawn(frame)
        for drawn, tolerance in ((frame, 1e-5), (oracle.render(scene, frame.settings), 1e-12)):
            assert np.allclose(drawn.rgb, color * drawn.alpha[..., None], rtol=tolerance)


def test_pixels_with_a_saturated_sample_are_counted(device):
    """Two lights beyond float32 on one half of a pixel: its mean is not the largest float32, but it is counted."""
    points, faces = star()
    material = Material(ka=0.0, kd=1.0, ks=0.0, color=3e38)
    lights = clshade.PointLight((30, 23, -50), (10.0, 10.0, 10.0))
    scene = replace(flat(points, faces, material=material), lights=lights)
    for options in ({}, {"resolve": "weighted"}):
        frame = draw(device, scene, samples=8, **options)
        assert frame.stats["saturated"] == np.count_nonzero(frame.alpha)


# Programs and bits


def test_another_number_of_samples_builds_nothing(device):
    scene = Scene((blob(),), CAMERA.with_resolution((32, 32)), LIGHTS)
    draw(device, scene, samples=2)
    before = len(programs.built())
    for samples in (3, 17, 64):
        draw(device, scene, samples=samples)
    assert len(programs.built()) == before


@pytest.mark.parametrize("samples", [0, 65, 2.5, True, "4"])
def test_refused_numbers_of_samples(samples):
    with pytest.raises(InputError, match=r"Settings: samples: expected a whole number from 1 to 64, found"):
        Settings(samples=samples)
