"""The figures of the course: which they are, and which of them a scene can show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.course import figures
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Material, PointLight

STEMS = [
    *("figure01-gouraud-ambient-only", "figure02-gouraud-diffuse-only", "figure03-gouraud-specular-only"),
    *("figure04-gouraud-all-terms", "figure05-gouraud-light-1-only", "figure06-gouraud-light-2-only"),
    *("figure07-gouraud-light-3-only", "figure08-gouraud-all-lights", "figure09-phong-ambient-only"),
    *("figure10-phong-diffuse-only", "figure11-phong-specular-only", "figure12-phong-all-terms"),
    *("figure13-phong-light-1-only", "figure14-phong-light-2-only", "figure15-phong-light-3-only"),
    *("figure16-phong-all-lights", "figure17-gouraud-map", "figure18-phong-map", "figure19-nolight-map"),
]


def scene(lights=3, **changes):
    course = builtin("course", level=2, resolution=(8, 6))
    light = PointLight(np.zeros(3), np.ones(3))
    return replace(course, lights=(*course.lights, light, light)[:lights], **changes)


def numbers(selection):
    return [figure.number for figure in selection]


def test_the_files_of_the_demos_keep_their_names():
    assert [figure.stem for figure in figures.lit() + figures.mapped()] == STEMS


def test_what_each_figure_shows():
    every = (0, 1, 2)
    for first, shader in ((0, "gouraud"), (8, "phong")):
        for k, figure in enumerate(figures.lit()[first : first + 8]):
            assert figure.shader == shader
            assert figure.terms == ((figures.TERMS[k],) if k < 3 else figures.TERMS)
            assert figure.lights == ((k - 4,) if 4 <= k < 7 else every)
            assert not figure.mapped
    assert all(figure.mapped and figure.lights == every for figure in figures.mapped())


def test_the_pairs_of_the_contact_sheets():
    assert [(a.number, b.number) for a, b in figures.pairs(figures.lit())] == [(1, 9), (2, 10), (3, 11), (4, 12)]
    assert [(a.number, b.number) for a, b in figures.pairs(figures.mapped())] == [(17, 18)]


def test_a_scene_of_the_course_shows_all():
    drawn, missing = figures.possible(scene())
    assert numbers(drawn) == list(range(1, 20))
    assert missing == {}


@pytest.mark.parametrize(
    ("lights", "left_out", "why"),
    [
        (0, (2, 3, 5, 6, 7, 10, 11, 13, 14, 15), "the scene has no lights"),
        (1, (6, 7, 14, 15), "the scene has 1 light"),
        (2, (7, 15), "the scene has 2 lights"),
    ],
)
def test_figures_that_lack_a_light_are_named(lights, left_out, why):
    drawn, missing = figures.possible(scene(lights))
    assert missing == {why: left_out}
    assert sorted([*numbers(drawn), *left_out]) == list(range(1, 20))


def test_figures_of_all_lights_show_more_than_three():
    drawn, missing = figures.possible(scene(5))
    assert missing == {}
    assert [figure.lights for figure in drawn if figure.number in (4, 5, 8, 18)] == [
        tuple(range(5)),
        (0,),
        *2 * [tuple(range(5))],
    ]


@pytest.mark.parametrize("lacks", ["texture", "texture coordinates"])
def test_figures_that_lack_a_texture_are_named(lacks):
    full_scene = scene()
    mesh = full_scene.meshes[0]
    bare = replace(mesh, material=Material()) if lacks == "texture" else replace(mesh, uvs=None, uv_faces=None)
    drawn, missing = figures.possible(replace(full_scene, meshes=(bare,)))
    assert missing == {f"the scene has no {lacks}": (17, 18, 19)}
    assert numbers(drawn) == list(range(1, 17))
