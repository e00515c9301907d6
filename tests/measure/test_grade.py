"""`grade`: mistakes that are planted are found, and right images are right."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from course_reference import light, scene_arguments

from clshade.errors import InputError
from clshade.measure.grade import drawing, grade, search, tables
from clshade.measure.grade.mistakes import MISTAKES, coverage
from clshade.oracle import frame
from clshade.oracle.lights import Directions
from clshade.scene.builtin.scenes import builtin
from clshade.scene.geometry import camera_axes, vertex_normals
from clshade.scene.lights import PointLight
from clshade.scene.material import Material
from clshade.scene.model import Mesh, Scene, Settings, with_materials

SIZE = 48


def lit(scene: Scene, intensity: float) -> Scene:
    """Return a scene with lights that many times as bright."""
    lights = tuple(replace(light, intensity=intensity * light.intensity) for light in scene.lights)
    return replace(scene, lights=lights)


def untextured(scene: Scene) -> Scene:
    return with_materials(scene, lambda material: replace(material, texture=None))


@cache
def right(shader: str = "phong", bright: bool = False) -> grade.Right:
    """Return the right image of the built-in course scene. bright: with lights that exceed 1."""
    scene = lit(builtin("course", resolution=(SIZE, SIZE)), 30.0 if bright else 1.0)
    return grade.right_of(scene, Settings.from_preset("course", shader=shader))


def with_mistakes(solution: grade.Right, *labels: str) -> drawing.Drawing:
    by_label = {change.label: change for change in search.changes_of(solution.drawing)}
    return search.applied(solution.drawing, [by_label[label] for label in labels])


def drawn(solution: grade.Right, *labels: str) -> np.ndarray:
    """Return the codes of the image with mistakes."""
    return np.rint(drawing.code_image(with_mistakes(solution, *labels)))


def found_first(solution: grade.Right, image: np.ndarray) -> list[set[str]]:
    """Return the labels of the best explanation, and of what gives the same image."""
    best = grade.graded(image, solution, "image").best
    assert best is not None
    assert best.claimed
    return [{change.label for change in changes} for changes in (best.changes, *best.same)]


# The drawing


@pytest.mark.parametrize("shader", ["phong", "gouraud"])
@pytest.mark.parametrize("visibility", ["painter", "depth"])
def test_the_right_image_is_the_oracle_s(shader, visibility):
    settings = Settings.from_preset("course", shader=shader, visibility=visibility)
    scene = builtin("course", resolution=(64, 48))
    image = grade.right_of(scene, settings).linear
    assert np.array_equal(image, frame.render(scene, settings).rgb)


def test_every_mistake_has_a_name_of_its_own_and_says_what_to_do():
    assert len(MISTAKES) == 62
    assert len({mistake.name for mistake in MISTAKES}) == len(MISTAKES)
    assert all(mistake.advice.endswith(".") for mistake in MISTAKES)


def test_terms_of_the_light_in_closed_form():
    z, tilted = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])
    at = Directions(normal=z, to_light=tilted, to_eye=z)

    def term(label: str, name: str, at: Directions) -> float:
        return float(with_mistakes(right(), label).light.terms[name](at, np.float64(3.0)))

    assert np.isclose(term("N.L not clamped", "kd", at._replace(to_light=-tilted)), -0.8)
    assert np.isclose(term("N.L by absolute value", "kd", at._replace(to_light=-tilted)), 0.8)
    assert np.isclose(term("Blinn for Phong", "ks", at), np.cos(0.5 * np.arccos(0.8)) ** 3)
    assert np.isclose(term("R with the wrong sign", "ks", at), 0.0)
    assert np.isclose(term("R with the wrong sign", "ks", at._replace(to_eye=np.array([0.6, 0.0, -0.8]))), 1.0)
    assert np.isclose(term("R without its factor 2", "ks", at._replace(to_eye=np.array([-0.6, 0.0, 0.8]))), 0.36**3)
    assert np.isclose(term("R.V by absolute value", "ks", at._replace(to_eye=np.array([0.6, 0.0, -0.8]))), 1.0)
    assert np.isclose(term("highlight without gate", "ks", at._replace(to_light=-tilted, to_eye=-z)), 0.8**3)


def test_pixels_at_other_places():
    codes = right().codes
    for label, image in (
        ("mirrored", codes[:, ::-1]),
        ("turned by 180 degrees", codes[::-1, ::-1]),
        ("axes swapped (about the diagonal from the top left)", codes.swapaxes(0, 1)),
    ):
        assert np.array_equal(drawn(right(), label), image), label


def test_lights_keep_their_numbers_beside_a_missing_one():
    changed = with_mistakes(right(), "a light missing (light 1)", "one channel of a light (red of light 3)")
    before, after = ([light.intensity for light in version.scene.lights] for version in (right().drawing, changed))
    assert np.array_equal(after, [0.0 * before[0], before[1], before[2] * [1.0, 0.0, 0.0]])


def test_settings_that_are_not_modeled_are_refused():
    scene = builtin("course", resolution=(8, 8))
    with pytest.raises(InputError, match="expected one sample"):
        grade.right_of(scene, Settings.from_preset("course", samples=4))


def test_a_normal_that_is_not_renormalized_in_closed_form():
    """All directions along z, with |N| = 0.9: R.V = 2*0.81 - 1."""
    z = np.array([0.0, 0.0, 1.0])
    for pair, expected in (((), 0.62), (("Blinn for Phong",), 0.9), (("R.V by absolute value",), 0.62)):
        light = with_mistakes(right(), "normals not renormalized", *pair).light
        at = light.directions(0.0 * z, 0.9 * z, z, 2.0 * z)
        assert np.isclose(light.terms["ks"](at, np.float64(10.0)), expected**10)
        assert np.isclose(light.terms["kd"](at, np.float64(10.0)), 0.9)


def vertex_colored(shader: str, intensity: float) -> grade.Right:
    """Return the right image of the course's object without texture, with lights that many times as bright."""
    scene = untextured(builtin("course", resolution=(SIZE, SIZE)))
    return grade.right_of(lit(scene, intensity), Settings.from_preset("course", shader=shader))


def linear_of(solution: grade.Right, label: str) -> np.ndarray:
    return drawing.linear_image(with_mistakes(solution, label))


@pytest.mark.parametrize("shader", ["phong", "gouraud"])
def test_a_highlight_without_color_is_that_of_a_white_object(shader):
    solution = vertex_colored(shader, 1.0)
    scene, settings = solution.drawing.scene, solution.drawing.settings
    mesh = scene.meshes[0]
    matte = replace(mesh, material=replace(mesh.material, ks=0.0))
    white = replace(mesh, colors=None, material=replace(mesh.material, ka=0.0, kd=0.0, color=1.0))
    parts = [frame.render(replace(scene, meshes=(variant,)), settings).rgb for variant in (matte, white)]
    drawn_at = frame.render(scene, settings).id > 0
    image = linear_of(solution, "highlight without color")
    assert np.allclose(image[drawn_at], (parts[0] + parts[1])[drawn_at])
    assert not np.allclose(image, solution.linear)


@pytest.mark.parametrize("shader", ["phong", "gouraud"])
def test_dim_light_that_is_clipped_before_the_color_is_right(shader):
    solution = vertex_colored(shader, 0.01)
    assert np.array_equal(linear_of(solution, "light clipped before color"), solution.linear)


def test_bright_light_that_is_clipped_before_the_color_leaves_the_color():
    """Where the light is far above 1 at all corners, ambient light and the color itself are left."""
    solution = vertex_colored("gouraud", 1e6)
    scene, settings = solution.drawing.scene, solution.drawing.settings
    unlit = frame.render(scene, replace(settings, shader="nolight"))
    ambient = scene.meshes[0].material.ka * scene.ambient
    lit = (solution.linear > 1e3).all(axis=2) & (unlit.id > 0)
    image = linear_of(solution, "light clipped before color")
    near = np.isclose(image, unlit.rgb + ambient).all(axis=2)
    assert lit.any()
    assert near[lit].mean() > 0.8  # other triangles have corners in the dark
    assert (image <= unlit.rgb + ambient + 1e-9)[unlit.id > 0].all()


def test_a_triangle_of_one_color_has_the_mean_of_the_three_texels():
    scene = builtin("course", resolution=(SIZE, SIZE))
    solution = grade.right_of(scene, Settings.from_preset("course", shader="nolight"))
    mesh = scene.meshes[0]
    image = mesh.material.texture.image
    corners = mesh.uvs[mesh.faces if mesh.uv_faces is None else mesh.uv_faces] * (np.array(image.shape[1::-1]) - 1)
    low = np.minimum(np.floor(corners).astype(int), np.array(image.shape[1::-1]) - 2)
    (x, y), (s, t) = np.moveaxis(low, -1, 0), np.moveaxis(corners - low, -1, 0)[..., None]
    texels = (1 - t) * ((1 - s) * image[y, x] + s * image[y, x + 1])
    texels += t * ((1 - s) * image[y + 1, x] + s * image[y + 1, x + 1])
    face = frame.render(scene, solution.drawing.settings).id.astype(int)
    expected = (texels.mean(axis=1) * mesh.material.color)[face - 1]
    assert np.allclose(linear_of(solution, "one color per triangle")[face > 0], expected[face > 0])


# Searches


@pytest.mark.long
def test_what_no_mistake_explains_is_not_claimed():
    noise = np.random.default_rng(0).integers(0, 256, (SIZE, SIZE, 3)).astype(float)
    grading = grade.graded(noise, right(), "noise")
    assert not grading.right
    assert not (grading.best and grading.best.claimed)
    assert "None of the modeled mistakes" in "\n".join(tables.lines(grading.facts()))


def test_gamma_beside_a_wrong_background_is_found():
    scene = replace(right().drawing.scene, background=[0.2, 0.5, 0.8])
    linear = np.clip(frame.render(scene, right().drawing.settings).rgb, 0.0, 1.0)
    image = np.rint(255.0 * linear ** (1.0 / 2.2))
    assert {"wrong background (as it is)", "gamma (1/2.2)"} in found_first(right(), image)


@pytest.mark.long
def test_an_image_without_the_object_is_not_blamed_on_edges():
    background = np.zeros((SIZE, SIZE, 3)) + right().drawing.scene.background
    assert {"nothing is drawn"} in found_first(right(), np.rint(grade.as_codes(background)))
    black = grade.graded(np.zeros((SIZE, SIZE, 3)), right(), "black").best
    assert black is not None
    assert "nothing is drawn" in {change.label for change in black.changes}


def painted(scene: Scene, shader: str) -> np.ndarray:
    """Return the image that a student's float code draws: no corner is snapped, weights come from areas, (M, N, 3)."""
    arguments = scene_arguments(scene)
    mesh, camera = scene.meshes[0], scene.camera
    x, y, z = camera_axes(camera) @ (mesh.verts - camera.eye).T
    columns, rows = camera.resolution
    u = (camera.focal * x / (z * camera.plane[1]) + 0.5) * columns
    v = (camera.focal * y / (z * camera.plane[0]) + 0.5) * rows
    normals, colors = vertex_normals(mesh.verts, mesh.faces), arguments["verts_colors"].T
    materials = (mesh.material.ka * scene.ambient, *(arguments[name] for name in ("k_d", "k_s", "n", "l_pos", "l_int")))
    image = np.tile(scene.background, (rows, columns, 1))
    at = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1)
    for face in mesh.faces[np.argsort(-z[mesh.faces].mean(axis=1), kind="stable")]:
        edges = np.array([[*np.stack([u, v], axis=1)[k], 1.0] for k in face])
        weights = np.concatenate([at, np.ones((rows, columns, 1))], axis=2) @ np.linalg.inv(edges)
        drawn = (weights > 0.0).all(axis=2)
        around = mesh.verts[face].mean(axis=0)
        if shader == "gouraud":
            image[drawn] = weights[drawn] @ light(around, normals[face], colors[face], camera.eye, *materials)
        else:
            image[drawn] = light(
                around, weights[drawn] @ normals[face], weights[drawn] @ colors[face], camera.eye, *materials
            )
    return image[::-1]


@pytest.mark.parametrize(("shader", "rounded"), [("phong", np.floor), ("gouraud", np.rint)])
def test_a_student_s_own_code_is_right(shader, rounded):
    scene = untextured(builtin("course", resolution=(80, 60)))
    image = rounded(grade.as_codes(painted(scene, shader)))
    grading = grade.graded(image, grade.right_of(scene, Settings.from_preset("course", shader=shader)), "image")
    assert grading.right
    assert grading.edges < 0.01 * 80 * 60


def test_pixels_that_another_fill_rule_decides_are_right():
    solution = grade.right_of(builtin("course", resolution=(128, 128)), Settings.from_preset("course"))
    for moved in coverage.SUBPIXEL_SHIFTS.values():
        grading = grade.graded(np.rint(drawing.code_image(moved(solution.drawing))), solution, "image")
        assert grading.right
        if grading.edges:
            break
    assert grading.differ == grading.edges > 0
    assert f"but for {grading.edges:,} of 16,384 pixels on edges" in tables.lines(grading.facts())[0]


def crossing() -> Scene:
    """Two triangles that cross and one that faces away, with a dull highlight, under a point light behind them."""
    quads = builtin("quads", resolution=(SIZE, SIZE), count=1)
    verts = np.array(
        [
            [[-3.0, -2.0, -3.0], [3.0, -2.0, -9.0], [-1.0, 3.0, -4.0]],
            [[-3.0, -2.0, -9.0], [3.0, -2.0, -3.0], [1.0, 3.0, -7.0]],
            [[-3.0, 0.5, -3.5], [-1.0, 2.5, -3.5], [-1.0, 0.5, -3.5]],
        ]
    ).reshape(-1, 3)
    mesh = Mesh(
        verts,
        np.arange(9).reshape(3, 3),
        colors=np.repeat([[0.9, 0.2, 0.1], [0.2, 0.8, 0.3], [0.3, 0.4, 0.9]], 3, axis=0),
        normals=np.array([[0.9, 0.0, 0.4]]),
        normal_faces=np.zeros((3, 3), int),
        material=Material(ka=0.1, kd=0.5, ks=0.4, n=3.0),
    )
    lamp = PointLight([-2.0, 2.0, -20.0], [0.8, 0.7, 0.5])
    return replace(quads, meshes=(mesh,), lights=(*quads.lights, lamp))


@pytest.mark.long
def test_every_mistake_shows_somewhere_and_is_found_alone():
    course = Settings.from_preset("course")
    crossed, dull = (
        grade.right_of(scene, course) for scene in (crossing(), untextured(builtin("teapot", resolution=(SIZE, SIZE))))
    )
    seen = set()
    for solution in (right(), right("gouraud"), right(bright=True), crossed, dull):
        for change in search.changes_of(solution.drawing):
            image = drawn(solution, change.label)
            if change.mistake.name not in seen and search.wrong(image, solution.codes).sum() > 20:
                seen.add(change.mistake.name)
                assert {change.label} in found_first(solution, image), change.label
    assert {mistake.name for mistake in MISTAKES} - seen <= {"the other interpolation"}
