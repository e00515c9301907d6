"""What is behind a scene: `Settings.background` in image, header, PNG and whatever else shows PNGs, and the environment."""

from dataclasses import replace

import numpy as np
import oracle_asserts
import pytest
from command_line import needs_device, run
from devices import rendered
from PIL import Image

import clshade
from clshade import oracle
from clshade.errors import InputError
from clshade.images import png
from clshade.images.tonemap import over, over_checkers, straight, tonemap, tonemap_rgba
from clshade.oracle import environment as backdrop
from clshade.oracle.transform import unit
from clshade.pipeline.effective_settings import effective_settings
from clshade.pipeline.features import derive
from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.environment import Environment
from clshade.scene.material import MetallicRoughness
from clshade.scene.model import Material, Mesh, PointLight, Scene
from clshade.scene.settings import Settings, SettingsFields
from clshade.view.sheet import draw_sheet

SMALL = clshade.builtin("icosphere", level=1, resolution=(40, 30))
UNLIT: SettingsFields = {"shader": "nolight"}  # light does not matter here, and the kernels build faster without


def test_the_scenes_background_a_color_and_none():
    assert Settings().background == "scene"
    for option, expected in (("scene", SMALL.background), (None, None), ((1, 0.5, 0), [1, 0.5, 0]), ("red", [1, 0, 0])):
        color = effective_settings(SMALL, background=option)[0].background
        assert color is expected if expected is None else np.array_equal(color, expected)
    only = clshade.Edges(only=True)
    assert effective_settings(SMALL, edges=only)[0].background.tolist() == [1, 1, 1]
    assert effective_settings(SMALL, edges=only, background=None)[0].background is None


def test_straight_alpha():
    rgba = np.array([[[0.25, 0.5, 1.0, 0.5], [0, 0, 0, 0], [3.0, 0, 0, 1.0], [0.1, 0.1, 0.1, 0.25]]], np.float32)
    assert straight(rgba)[0].tolist() == pytest.approx(np.array([[0.5, 1, 2], [0, 0, 0], [3, 0, 0], [0.4, 0.4, 0.4]]))
    for operator in ("none", "aces", "neutral"):
        codes = tonemap_rgba(rgba, operator, 1.0)
        assert codes[0, :, 3].tolist() == [128, 0, 255, 64]
        assert np.array_equal(codes[..., :3], tonemap(straight(rgba), operator, 1.0))
    shown = over(np.array([[[200, 100, 0, 128], [9, 9, 9, 0], [1, 2, 3, 255]]], np.uint8), (255, 255, 255))
    assert shown.tolist() == [[[227, 177, 127], [255, 255, 255], [1, 2, 3]]]
    checkers = over_checkers(np.zeros((20, 20, 4), np.uint8)).reshape(-1, 3)
    assert np.unique(checkers, axis=0).tolist() == [[153] * 3, [204] * 3]


@needs_device
def test_images_over_nothing_and_over_a_color(tmp_path):
    nothing = clshade.render(SMALL, background=None, samples=4)
    color = clshade.render(SMALL, background=(0.5, 0.25, 2.0), samples=4)
    assert clshade.check(color, "all").passed
    behind = (1.0 - nothing.alpha[..., None]) * np.array([0.5, 0.25, 2.0])
    assert color.rgb == pytest.approx(nothing.rgb + behind, abs=1e-5)
    assert "background=None" in nothing.metadata()["settings"]
    assert "background=(0.5, 0.25, 2.0)" in color.metadata()["settings"]
    nothing.save(tmp_path / "a")
    with Image.open(tmp_path / "a.png") as image:
        assert image.mode == "RGBA"
        assert np.array_equal(np.asarray(image), nothing.to_png8())
    assert np.array_equal(nothing.to_png8()[..., 3], np.floor(255 * nothing.alpha.astype(float) + 0.5))


@needs_device
def test_the_command_line(tmp_path, capsys):
    command = ("render", "icosphere", "--resolution", "24,18", "--quiet", "-o", tmp_path / "a")
    assert run(capsys, *command, "--background", "none", "--crop-zoom", "0,0,8,8")[0] == 0
    assert png.read(tmp_path / "a.png", alpha=True)[0, 0].tolist() == [0, 0, 0, 0]
    assert png.read(tmp_path / "a_crop.png")[0, 0].tolist() == [204, 204, 204]
    for text, code in (("#336699", (0x33, 0x66, 0x99)), ("white", (255, 255, 255)), ("1,0,0", (255, 0, 0))):
        assert run(capsys, *command, "--background", text)[0] == 0
        assert png.read(tmp_path / "a.png", alpha=True)[0, 0].tolist() == list(code)
    for option in ("--background", "--edge-color", "--nan-color"):
        code, out, lines = run(capsys, "render", "icosphere", option, "1,2")
        assert (code, out, len(lines)) == (2, "", 1)
        assert f"argument {option}: expected a name such as white, #rrggbb (sRGB), or three linear" in lines[0]


@pytest.mark.long
@needs_device
def test_sheets_stand_on_white_and_films_keep_alpha_where_they_can(tmp_path, capsys):
    sheet = draw_sheet(SMALL, ("front",), background=None, **UNLIT)
    x, y = sheet.facts["views"][0]["panel"][:2]
    assert sheet.picture[y, x].tolist() == [255, 255, 255]
    small = ("--count", "2", "--resolution", "16,12", "--shader", "nolight", "--quiet")
    command = ("turntable", "torus_knot", "--background", "none", *small)
    for ending, alpha in (("webp", 0), ("apng", 0), ("gif", 255)):
        assert run(capsys, *command, "-o", tmp_path / f"a.{ending}")[0] == 0
        with Image.open(tmp_path / f"a.{ending}") as film:
            film.seek(1)
            *color, opacity = film.convert("RGBA").getpixel((0, 0))
        assert opacity == alpha
        assert alpha == 0 or color == [0, 0, 0]


IMAGE = np.random.default_rng(3).random((7, 12, 3)) ** 2
AROUND = Environment(IMAGE, rotation=25, intensity=1.5, up=(0.1, 1, 0.3))
CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.5, 2.0), (44, 33))


def scene(environment: Environment | None = AROUND, **fields) -> Scene:
    solid = Mesh([[-0.7, -0.7, -1.7], [1.05, -0.7, -0.3], [0.0, 0.84, -1.0]], [[0, 1, 2]], material=Material(0.9))
    defaults = {"meshes": solid, "camera": CAMERA, "lights": PointLight((2, 3, 4))}
    return Scene(**{**defaults, "environment": environment, **fields})


def draw(device, drawn: Scene, **options) -> Frame:
    return rendered(drawn, device=device, background="environment", layers=("Z", "id"), **options)


def seen(environment: Environment, d) -> np.ndarray:
    return backdrop.seen(environment, unit(np.atleast_2d(np.asarray(d, float))), "float64")[0]


# The oracle


def test_centers_of_pixels_seam_and_poles():
    environment = Environment(IMAGE)
    rows, columns = IMAGE.shape[:2]
    polar = (np.arange(rows) + 0.5)[:, None] * np.pi / rows
    longitude = np.pi - (np.arange(columns) + 0.5) * 2.0 * np.pi / columns
    left, front = np.sin(polar) * np.sin(longitude), np.sin(polar) * np.cos(longitude)
    d = np.stack([left, np.cos(polar) * np.ones(columns), front], axis=-1)
    np.testing.assert_allclose(seen(environment, d.reshape(-1, 3)).reshape(IMAGE.shape), IMAGE, atol=1e-7)
    middle = (np.pi / 2.0, 0.0, -1.0)  # the seam is at -z, in the middle row of seven
    np.testing.assert_allclose(seen(environment, (0, 0, -1)), (IMAGE[3, :1] + IMAGE[3, -1:]) / 2.0, atol=1e-7)
    for end, row in ((1.0, 0), (-1.0, -1)):
        around = [(1e-9 * np.cos(t), end, 1e-9 * np.sin(t)) for t in np.linspace(0.0, 6.0, 9)]
        np.testing.assert_allclose(seen(environment, around), np.tile(IMAGE[row].mean(axis=0), (9, 1)), atol=1e-6)
    for near in (middle, (0.3, 1.0, 0.1), (0.02, -1.0, 0.01)):
        off = np.array(near) + np.array([[0, 0, 0], [1e-7, 0, 0], [0, -1e-7, 0], [0, 0, 1e-7]])
        assert np.ptp(seen(environment, off), axis=0).max() < 1e-4


@pytest.mark.parametrize("up", [(0, 1, 0), (1, 0, 0.2)])
def test_a_mirror_shows_what_the_background_shows_in_the_reflected_direction(up):
    """Radiance that tells its direction: red x, green y, blue z, as the background's rays and a mirror see it."""
    blank = Environment(np.zeros((64, 128, 3)), rotation=70, up=up)
    polar, turn = np.mgrid[:64, :128] + 0.5
    polar, turn = polar * (np.pi / 64), np.pi - turn * (2.0 * np.pi / 128)
    local_directions = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    environment = replace(blank, image=0.5 + 0.5 * (local_directions @ blank.axes))
    facets = Material(color=1.0, pbr=MetallicRoughness(1.0, 0.0))
    corners = [[-3, -2, 0], [3, -2, 0.5], [0, 2, -0.5]]
    mirror = Mesh(corners, [[0, 1, 2]], normals=[[0.3, 0.2, 1.0]] * 3, material=facets)
    drawn = scene(environment, meshes=mirror, lights=(), ambient=0.0, preset="pbr")
    drawn, settings = effective_settings(drawn, background="environment")
    y, x = np.mgrid[32:-1:-1, :44] * 256 + 128  # the pixels' centers
    frame, rays = oracle.render(drawn, settings), backdrop.rays(CAMERA, x.ravel(), y.ravel()).reshape(33, 44, 3)
    normal = unit(np.array([0.3, 0.2, 1.0]))
    reflected = rays - 2.0 * (rays @ normal)[..., None] * normal
    shows = np.where(frame.alpha[..., None] > 0.0, reflected, rays)
    assert 0.1 < frame.alpha.mean() < 0.9
    np.testing.assert_allclose(frame.rgb, 0.5 + 0.5 * shows, atol=0.03)  # grazing metal loses some light


# Frames


@pytest.mark.parametrize("toward", [*np.eye(3), *-np.eye(3)], ids=str)
def test_along_axes_at_poles_and_at_the_seam(device, toward):
    """The middle pixel looks exactly along an axis."""
    camera = Camera((0, 0, 0), toward, np.roll(toward, 1), 1.0, (1.5, 1.5), (33, 33))
    oracle_asserts.assert_all(draw(device, scene(Environment(IMAGE), camera=camera)))


def test_a_steep_horizon_is_antialiased(device):
    """Each sample sees its own ray: across an edge between two rows the mean of four rays differs from that of one."""
    image = np.zeros((1024, 1, 3))
    image[:512] = 1.0
    frame = draw(device, scene(Environment(image)), samples=4)
    assert {0.0, 1.0} < set(frame.rgb[:, 0, 0].tolist())
    oracle_asserts.assert_all(frame)


def test_an_orthographic_camera_sees_one_direction():
    parallel = scene(camera=replace(CAMERA, orthographic=True, eye=(1, 2, 4)))
    frame = oracle.render(*effective_settings(parallel, background="environment"))
    shown = frame.rgb[frame.alpha == 0.0]
    assert (shown == shown[0]).all()
    np.testing.assert_allclose(shown[0], seen(AROUND, (-1, -2, -4))[0], atol=1e-12)


def test_a_black_environment_needs_nothing_and_none_is_refused():
    shown = Settings(background="environment")
    for environment, expected in ((Environment(np.zeros((1, 1, 3))), 0), (AROUND, 1)):
        assert derive(scene(environment), shown, double_positions=False)["BACKDROP"] == expected
    with pytest.raises(InputError, match=r"render: background: .* --environment FILE or studio"):
        effective_settings(scene(None), background="environment")
    stands_in, _ = effective_settings(scene(None, preset="pbr", own_lights=False), background="environment")
    assert stands_in.environment.name == "studio"
