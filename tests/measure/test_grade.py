"""`grade`: mistakes that are planted are found, and right images are right."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.measure.bench import scanline
from clshade.measure.grade import grade, planted, search, tables
from clshade.measure.grade.mistakes import MISTAKES
from clshade.oracle import frame
from clshade.oracle.terms import Directions
from clshade.scene.builtin.scenes import builtin
from clshade.scene.lights import PointLight
from clshade.scene.model import Settings

SIZE = 48


@cache
def right(shader: str = "phong", bright: bool = False) -> grade.Right:
    """Return the right image of the built-in course scene. bright: with lights that exceed 1."""
    scene = builtin("course", resolution=(SIZE, SIZE))
    if bright:
        lights = tuple(replace(light, intensity=30.0 * light.intensity) for light in scene.lights)
        scene = replace(scene, lights=lights)
    return grade.right_of(scene, Settings.from_preset("course", shader=shader))


def drawn(given: grade.Right, *labels: str) -> np.ndarray:
    """Return the codes of the image with mistakes."""
    known = {change.label: change for change in search.changes_of(given.drawing)}
    drawing = search.Explanation(tuple(known[label] for label in labels), 0.0, 0.0).draw(given.drawing)
    linear = grade.picture(drawing, (SIZE, SIZE))
    return np.rint(grade.as_codes(drawing.shown(linear)))


def found_first(given: grade.Right, image: np.ndarray) -> list[set[str]]:
    """Return the labels of the best explanation, and of what gives the same image."""
    best = grade.graded(image, given, "image").best
    assert best is not None
    assert best.claimed
    return [{change.label for change in changes} for changes in (best.changes, *best.same)]


# The drawing


@pytest.mark.parametrize("shader", ["phong", "gouraud"])
@pytest.mark.parametrize("visibility", ["painter", "depth"])
def test_the_right_image_is_the_oracle_s(shader, visibility):
    settings = Settings.from_preset("course", shader=shader, visibility=visibility)
    scene = builtin("course", resolution=(64, 48))
    found = grade.right_of(scene, settings).linear
    assert np.array_equal(found, frame.render(scene, settings).rgb)


def test_every_mistake_has_a_name_of_its_own_and_says_what_to_do():
    assert len(MISTAKES) >= 30
    assert len({each.name for each in MISTAKES}) == len(MISTAKES)
    assert all(each.advice.endswith(".") for each in MISTAKES)


def test_terms_of_the_light_in_closed_form():
    changes = {change.label: change for change in search.changes_of(right().drawing)}
    z, tilted = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])
    at = Directions(normal=z, to_light=tilted, to_eye=z)

    def term(label: str, name: str, at: Directions) -> float:
        return float(changes[label](right().drawing).light.terms[name](at, np.float64(3.0)))

    assert np.isclose(term("N.L not clamped", "kd", at._replace(to_light=-tilted)), -0.8)
    assert np.isclose(term("N.L by absolute value", "kd", at._replace(to_light=-tilted)), 0.8)
    assert np.isclose(term("Blinn for Phong", "ks", at), np.cos(0.5 * np.arccos(0.8)) ** 3)
    assert np.isclose(term("R with the wrong sign", "ks", at), 0.0)
    assert np.isclose(term("R with the wrong sign", "ks", at._replace(to_eye=np.array([0.6, 0.0, -0.8]))), 1.0)
    assert np.isclose(term("R.V by absolute value", "ks", at._replace(to_eye=np.array([0.6, 0.0, -0.8]))), 1.0)
    assert np.isclose(term("highlight without gate", "ks", at._replace(to_light=-tilted, to_eye=-z)), 0.8**3)


def test_settings_that_are_not_modeled_are_refused():
    scene = builtin("course", resolution=(8, 8))
    with pytest.raises(InputError, match="expected one sample"):
        grade.right_of(scene, Settings.from_preset("course", samples=4))


# Searches


@pytest.mark.parametrize(
    "label",
    [
        "upside down",
        "half a pixel off (up)",
        "normals not renormalized",
        "V from the wrong point (toward the origin, -P)",
        "v flipped",
    ],
)
def test_a_planted_mistake_is_found(label):
    assert {label} in found_first(right(), drawn(right(), label))


def test_mistakes_beyond_1_are_found():
    for label in ("8-bit wrap", "light clipped before color", "divided by its maximum"):
        assert {label} in found_first(right(bright=True), drawn(right(bright=True), label))


@pytest.mark.long
def test_two_mistakes_are_found_together():
    pair = "a light missing (light 1)", "gamma (1/2.2)"
    assert set(pair) in found_first(right(), drawn(right(), *pair))


@pytest.mark.long
def test_what_no_mistake_explains_is_not_claimed():
    noise = np.random.default_rng(0).integers(0, 256, (SIZE, SIZE, 3)).astype(float)
    found = grade.graded(noise, right(), "noise")
    assert not found.right
    assert not (found.best and found.best.claimed)
    assert "None of the modeled mistakes" in "\n".join(tables.lines(found.facts()))


def test_the_color_of_a_wrong_background_is_found():
    empty = (right().linear == right().drawing.scene.background).all(axis=2)
    image = np.where(empty[..., None], [10.0, 200.0, 30.0], right().codes)
    assert {"wrong background (as it is)"} in found_first(right(), image)


def test_pixels_that_are_off_by_one_code_are_right():
    image = np.abs(right().codes - 1.0)
    assert grade.graded(image, right(), "image").differ == 0


@pytest.mark.long
def test_one_pixel_of_another_color_is_not_right():
    image = right().codes.copy()
    image[20, 20, 1] += 40.0 if image[20, 20, 1] < 200 else -40.0
    found = grade.graded(image, right(), "image")
    assert (found.differ, found.edges, found.right) == (1, 0, False)


@pytest.mark.parametrize("rounded", [np.rint, np.floor])
@pytest.mark.parametrize("shader", ["phong", "gouraud"])
def test_the_course_s_own_python_code_is_right(shader, rounded):
    scene = planted.scene_of("course, vertex colors", (80, 60))
    image = rounded(grade.as_codes(scanline.render(scene, shader)[::-1]))
    found = grade.graded(image, grade.right_of(scene, Settings.from_preset("course", shader=shader)), "scanline")
    assert found.right
    assert found.edges < 0.01 * 80 * 60


# How many are named


@pytest.mark.long
def test_every_mistake_shows_somewhere_and_is_found_alone():
    seen = set()
    lamps = (PointLight([0.0, 3.0, 4.0], 3.0),)
    scene = builtin("course", resolution=(SIZE, SIZE))
    lit = grade.right_of(replace(scene, lights=scene.lights + lamps), Settings.from_preset("course"))
    for given in (lit, right("gouraud"), right(bright=True)):
        for change in search.changes_of(given.drawing):
            image = drawn(given, change.label)
            if change.mistake.name not in seen and search.wrong(image, given.codes).sum() > 20:
                seen.add(change.mistake.name)
                assert {change.label} in found_first(given, image), change.label
    assert {each.name for each in MISTAKES} - seen <= {"the other interpolation"}


@pytest.mark.long
def test_most_planted_mistakes_are_named_first(capsys):
    assert planted.run(300, 100, 0)
