"""Looks and grounds: the studio's light and contact shadow, where the ground lies, and what it looks like at its edge."""

from dataclasses import replace

import command_line
import numpy as np
import pytest
from command_line import run

import clshade
from clshade import Camera, Material, Mesh, Scene, Settings, Texture, oracle, with_look
from clshade.errors import InputError
from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.adjust_camera import camera_of, named_cameras, seen_by
from clshade.scene.framing import UPS, framed
from clshade.scene.ground import GRAY, MATERIAL, objects_of, with_ground
from clshade.scene.look import BACKGROUND

CAMERA = Camera((3.0, 3.0, 8.0), (0.0, 0.5, 0.0), (0.0, 1.0, 0.0), 1.0, (0.6, 0.8), (32, 24))
FOOT = Mesh([(-0.01, 0, 0), (0.01, 0, 0), (0, 0, 0.01)], [(0, 1, 2)])  # what touches the ground


def disc(middle: tuple[float, float], height: float, radius: float) -> Mesh:
    """Return a horizontal polygon of 64 corners, nearly a circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    x, z = middle[0] + radius * np.cos(angle), middle[1] + radius * np.sin(angle)
    corners = np.arange(1, 63)
    faces = np.stack([0 * corners, corners, corners + 1], axis=1)
    return Mesh(np.stack([x, np.full(64, height), z], axis=1), faces)


def scene_of(*meshes: Mesh, turn: np.ndarray | None = None) -> Scene:
    """Return the meshes above the plane y = 0, or turned by a rotation."""
    turn = np.eye(3) if turn is None else turn
    meshes = tuple(replace(m, verts=np.asarray(m.verts, np.float64) @ turn.T) for m in meshes)
    camera = Camera(turn @ CAMERA.eye, turn @ CAMERA.lookat, turn @ CAMERA.up, 1.0, CAMERA.plane, CAMERA.resolution)
    return Scene(meshes, camera, (clshade.PointLight((1, 2, 3), (1, 1, 1)),), own_lights=False)


def open_at(scene: Scene, place: tuple[float, float, float]) -> float:
    """Return what the contact shadow leaves of the light at a place on the ground."""
    ground = scene.meshes[-1]
    image = ground.material.texture.image[..., 0]
    # Texture coordinates are linear in the place.
    linear, *_ = np.linalg.lstsq(np.c_[ground.verts, np.ones(len(ground.verts))], ground.uvs, rcond=None)
    column, row = ((np.append(place, 1.0) @ linear) * image.shape[0]).astype(int)
    return float(image[row, column])


def test_the_studio_without_a_shadow():
    scene = with_look(scene_of(FOOT), "studio", ground=False)
    assert (scene.preset, scene.environment.name, scene.own_lights) == ("pbr", "studio", False)
    assert scene.background.tolist() == [BACKGROUND] * 3
    assert len(scene.meshes) == 1
    ground = with_look(scene, "studio", contact_shadow=False).meshes[-1]
    assert (ground.material.name, ground.material.texture) == (MATERIAL.name, None)
    empty = Scene((Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)),), CAMERA)
    assert with_look(empty, "studio").meshes[-1].material.texture is None
    environment = clshade.Environment(np.ones((2, 4, 3)))
    scene = Scene((FOOT,), CAMERA, environment=environment)
    assert with_look(scene, "studio", ground=False).environment is environment


@pytest.mark.parametrize(("height", "expected"), [(0.5, 0.2), (1.0, 0.5)])
def test_under_a_disc_the_sky_is_open_as_its_form_factor_says(height, expected):
    """A disc of radius a at height h covers a^2 / (a^2 + h^2) of the light from above a point below its middle."""
    studio = with_look(scene_of(FOOT, disc((0, 0), height, 1.0)), "studio")
    assert open_at(studio, (0.0, 0.0, 0.0)) == pytest.approx(expected, abs=0.03)
    assert open_at(studio, (2.2, 0.0, 0.0)) > 0.9
    image = studio.meshes[-1].material.texture.image
    assert (image[[0, -1]] == 1.0).all()
    assert (image[:, [0, -1]] == 1.0).all()


@pytest.mark.parametrize("up", list(UPS))
def test_a_shadow_lies_below_what_casts_it(up):
    turn = np.array(UPS[up], np.float64).T  # from x, y, z to the axes of this `up`
    scene = scene_of(FOOT, disc((0.9, 0.5), 0.15, 0.4), turn=turn)
    studio = with_look(scene, "studio", up=up)
    shares = [open_at(studio, turn @ place) for place in ((0.9, 0, 0.5), (-0.9, 0, 0.5), (0.9, 0, -0.5), (0.5, 0, 0.9))]
    assert shares[0] < 0.2
    assert min(shares[1:]) > 0.6


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 1e6), (1e-20, 0.0), (1e20, 1e25)])
def test_far_from_the_origin_and_at_any_size(scale, shift):
    near = with_look(scene_of(FOOT, disc((0, 0), 0.5, 1.0)), "studio")
    moved = [Mesh(np.asarray(m.verts, np.float64) * scale + shift, m.faces) for m in near.meshes[:-1]]
    camera = Camera(CAMERA.eye * scale + shift, CAMERA.lookat * scale + shift, CAMERA.up, 1.0, CAMERA.plane, (32, 24))
    far = with_look(Scene(moved, camera, own_lights=False), "studio")
    images = [variant.meshes[-1].material.texture.image for variant in (near, far)]
    assert abs(images[0] - images[1]).max() < 0.1


def sheet(corners: list, **fields: object) -> Mesh:
    return Mesh(corners, [(0, 1, 2), (0, 2, 3)], **fields)


HALF = np.ones((1, 2, 4))
HALF[0, 0, 3] = 0.0  # where u < 1/2 nothing is
CHECKERS = np.ones((64, 64, 4))
CHECKERS[..., 3] = np.add.outer(np.arange(64), np.arange(64)) % 2
WIDE = [(-1, 0.2, -1), (1, 0.2, -1), (1, 0.2, 1), (-1, 0.2, 1)]


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("fields", "alpha"),
    [
        ({"material": Material(blend=True, opacity=0.25)}, lambda x: 0.25 + 0.0 * x),
        ({"material": Material(blend=True), "alphas": [0.0, 1.0, 1.0, 0.0]}, lambda x: (x + 1.0) / 2.0),
        ({"material": Material(texture=Texture(HALF, filter="nearest"), alpha_cutoff=0.5)}, lambda x: x > 0.0),
        ({"material": Material(texture=Texture(HALF), blend=True, opacity=0.5)}, lambda x: 0.5 * (x > 0.0)),
        ({"material": Material(texture=Texture(HALF, lookup="course"), alpha_cutoff=0.5)}, lambda x: x > 0.0),
        ({"material": Material(texture=Texture(CHECKERS), alpha_cutoff=0.5)}, lambda x: 0.5 + 0.0 * x),
    ],
)
def test_what_lets_light_pass_darkens_the_ground_by_its_alpha(fields, alpha):
    """The mean of alpha over the sheet, seen from below, where it covers h^2 / (pi d^4) of the light per area."""
    uvs = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    studio = with_look(scene_of(FOOT, sheet(WIDE, uvs=uvs, **fields)), "studio")
    x, z = np.meshgrid(np.linspace(-1.0, 1.0, 401), np.linspace(-1.0, 1.0, 401))
    for place in (-0.5, 0.0, 0.5):
        covered = 0.04 / (np.pi * ((x - place) ** 2 + 0.04 + z * z) ** 2) / 200.0**2
        expected = 1.0 - (covered * alpha(x)).sum()
        assert open_at(studio, (place, 0.0, 0.0)) == pytest.approx(expected, abs=0.05), place


def test_two_sheets_of_glass_hold_back_as_their_product():
    glass = {"material": Material(blend=True, opacity=0.5)}
    sheets = [sheet(WIDE, **glass), sheet([(x, 0.4, z) for x, _, z in WIDE], **glass)]
    for count, expected in ((1, 0.5), (2, 0.28)):
        studio = with_look(scene_of(FOOT, *sheets[:count]), "studio")
        assert open_at(studio, (0.0, 0.0, 0.0)) == pytest.approx(expected, abs=0.04)


def shadow_of(*meshes: Mesh) -> np.ndarray:
    return np.asarray(with_look(scene_of(*meshes), "studio").meshes[-1].material.texture.image[..., 0])


def test_instances_cast_shadows_as_meshes_do():
    """Mirrored ones too; none cast none; and what is higher than the rays reach darkens nothing."""
    small = sheet([(-0.3, 0.2, -0.3), (0.3, 0.2, -0.3), (0.3, 0.2, 0.3), (-0.3, 0.2, 0.3)])
    placements = np.tile(np.eye(4), (2, 1, 1))
    placements[0, 0, 0], placements[0, 0, 3], placements[1, 0, 3] = -1.0, -1.0, 1.0
    copies = [replace(small, verts=np.asarray(small.verts) + (x, 0.0, 0.0)) for x in (-1.0, 1.0)]
    none = replace(small, instances=np.zeros((0, 4, 4)))
    post = sheet([(-0.01, 0.0, 0.0), (0.01, 0.0, 0.0), (0.01, 9.0, 0.0), (-0.01, 9.0, 0.0)])
    assert np.array_equal(shadow_of(FOOT, replace(small, instances=placements), none), shadow_of(FOOT, *copies))
    high = replace(small, verts=np.asarray(small.verts) + (0.0, 8.7, 0.0))
    assert np.array_equal(shadow_of(FOOT, post, high), shadow_of(FOOT, post))


@pytest.mark.sampled
@pytest.mark.parametrize("u", [np.nan, np.inf, 3e38, -1e300])
def test_texture_coordinates_without_a_meaning_do_no_harm(u):
    material = Material(texture=Texture(HALF, wrap="mirror"), blend=True)
    image = shadow_of(FOOT, sheet(WIDE, uvs=[(0.0, 0.0), (u, 0.0), (-u, 1.0), (0.0, 1.0)], material=material))
    assert ((image >= 0.0) & (image <= 1.0)).all()


# Grounds

SCENE = framed(clshade.builtin("icosphere", level=1).meshes, "solid", (60, 40))


@pytest.mark.parametrize("up", UPS)
def test_it_lies_below_the_lowest_point_and_faces_up(up):
    scene = with_ground(SCENE, up)
    ground = scene.meshes[-1]
    upward = np.array(UPS[up][1], float)
    heights, lowest = ground.verts @ upward, (SCENE.meshes[0].verts @ upward).min()
    assert np.ptp(heights) < 1e-6
    assert lowest - 0.01 < heights.max() < lowest
    assert np.abs(ground.verts).max() > 8.0  # of a sphere of radius 1
    a, b, c = ground.verts[ground.faces].astype(float).transpose(1, 0, 2)
    assert (np.cross(b - a, c - a) @ upward > 0.0).all()
    assert (ground.normals == upward).all()
    assert ground.verts.dtype == np.float32  # as the scene's
    assert objects_of(scene).meshes == SCENE.meshes
    assert len(with_ground(scene, up).meshes) == len(scene.meshes)


def test_cameras_and_views_leave_it_out():
    scene = with_ground(SCENE)
    for name, camera in named_cameras(SCENE, ("front", "iso")).items():
        with_it = named_cameras(scene, ("front", "iso"))[name]
        assert with_it.plane == camera.plane
        for one, second in zip(seen_by(scene, with_it).lights, seen_by(SCENE, camera).lights, strict=True):
            assert one.position.tolist() == second.position.tolist()
    turned = {"azimuth": 30.0}
    assert camera_of(scene, turned).eye.tolist() == camera_of(SCENE, turned).eye.tolist()


@pytest.mark.parametrize(
    ("background", "settings", "lights"),
    [
        ((0.3, 0.6, 0.9), Settings(ambient="plain"), SCENE.lights),
        (0.5, Settings(), clshade.DirectionalLight((0.3, -1.0, 0.2))),
        (0.5, Settings(shader="nolight", background="white"), SCENE.lights),
        (0.05, Settings.from_preset("pbr"), SCENE.lights),  # the studio in place of the lights
    ],
)
def test_its_edge_has_the_color_of_the_background(background, settings, lights):
    scene = with_ground(replace(SCENE, background=background, lights=lights), settings=settings)
    above = clshade.Camera((0, 30, 0), (0, 0, 0), (0, 0, 1), 1.0, (32.0, 32.0), (160, 160), orthographic=True)
    place = (np.arange(160) + 0.5) / 5.0 - 16.0
    from_middle = np.hypot(place, place[:, None])
    within = (from_middle > 15.4) & (from_middle < 15.5)  # 9 times the radius of the sphere about the box, sqrt(3)
    edge = oracle.render(*effective_settings(replace(scene, camera=above), settings=settings), *np.nonzero(within))
    assert (edge.alpha == 1.0).all()
    assert len(edge.alpha) > 100
    behind = np.broadcast_to(1.0 if settings.shader == "nolight" else background, edge.rgb.shape)
    assert edge.rgb == pytest.approx(behind, rel=0.02)


def test_unlit_materials_leave_it_the_studio_alone():
    """They show their color by ambient light, which the ground must not count."""
    unlit = replace(SCENE.meshes[0], material=clshade.Material(ka=10.0, kd=0.0, ks=0.0))
    settings = Settings.from_preset("pbr")
    beside, alone = (
        with_ground(replace(SCENE, meshes=meshes), settings=settings).meshes[-1].colors
        for meshes in ((*SCENE.meshes, unlit), SCENE.meshes)
    )
    assert np.array_equal(beside, alone)


def test_the_command_line(capsys):
    options = (), ("--ground", "--background", "none")
    alone, grounded = (command_line.scene_of("icosphere", *some) for some in options)
    assert len(grounded.meshes) == 2
    assert np.array_equal(grounded.meshes[0].verts, alone.meshes[0].verts)  # so that the ids of its faces stay
    assert (grounded.meshes[1].colors == GRAY[0]).all()
    assert grounded.camera.eye.tolist() == alone.camera.eye.tolist()
    code, out, lines = run(capsys, "render", "icosphere", "--ground", "--edges", "all")
    assert (code, out, len(lines)) == (2, "", 1)
    assert "--ground: cannot go with --edges" in lines[0]


def test_scenes_without_lights_or_faces_and_of_any_size():
    for scene in (
        replace(SCENE, lights=(), ambient=0.0),
        replace(SCENE, meshes=()),
        replace(SCENE, background=None),
        replace(SCENE, preset="course", ambient=0.5),
    ):
        colors = with_ground(scene).meshes[-1].colors
        assert np.isfinite(colors).all()
        assert (colors >= 0.0).all()
    huge = [replace(mesh, verts=mesh.verts.astype(float) * 1e308) for mesh in SCENE.meshes]
    with pytest.raises(InputError):
        with_ground(replace(SCENE, meshes=huge))
