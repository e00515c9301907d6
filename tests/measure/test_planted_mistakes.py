"""`grade` names mistakes that are planted at random; the kernels draw the images where they can make these mistakes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache, partial
from unittest import mock

import numpy as np
import pytest
from command_line import needs_device

from clshade.base.arrays import Floats
from clshade.measure.grade import grade, search
from clshade.measure.grade.drawing import Drawing, code_image
from clshade.pipeline import programs
from clshade.pipeline.renderer import Renderer
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings, with_materials

SCENES = ("course", "course, vertex colors", "teapot", "icosphere", "quads")  # the first is textured
SHADERS = {"phong": (160, 120), "gouraud": (128, 128)}  # with the resolution
NOISE = 0.1  # share of codes that are off by one
LEAST = 20  # pixels that a planted mistake must change by more than one code

GATE = "seen[k] = (cosine[k] > 0.0f) & (t[k] < 1.0f);"
DARK = "    if (!any_lane(some))\n        return;\n"
LAMBERT = "reals lambert = cosine[k] > 0.0f ? cosine[k] : (reals)(0.0f);"
APART = "fma(twice, normal.{0}, -(l.{0} + view[k].{0}))"
# Texts of kernels/phong_terms.clh and what stands in their place, by the mistake's label.
KERNELS = {
    "N.L not clamped": [(DARK, ""), (LAMBERT, "reals lambert = cosine[k];")],
    "N.L by absolute value": [(DARK, ""), (LAMBERT, "reals lambert = fabs(cosine[k]);")],
    "highlight without gate": [(DARK, ""), (GATE, "seen[k] = t[k] < 1.0f;")],
    "R with the wrong sign": [
        (APART.format(axis), f"-fma(twice, normal.{axis}, view[k].{axis} - l.{axis})") for axis in "xyz"
    ],
    "R.V by absolute value": [(GATE, "t[k] = t[k] < 1.0f ? t[k] : 2.0f - t[k]; seen[k] = cosine[k] > 0.0f;")],
    "R without its factor 2": [(GATE, f"t[k] = 1.0f - (cosine[k] * dot3(normal, view[k]) - dot3(l, view[k])); {GATE}")],
}
PLACES = {
    "upside down": lambda image: image[::-1],
    "mirrored": lambda image: image[:, ::-1],
    "turned by 180 degrees": lambda image: image[::-1, ::-1],
    "axes swapped (about the diagonal from the top left)": lambda image: image.swapaxes(0, 1),
}


@cache
def right_of(name: str, shader: str) -> grade.Right:
    scene = builtin(name.split(",")[0], resolution=SHADERS[shader])
    if name != "course":
        scene = with_materials(scene, lambda material: replace(material, texture=None))
    return grade.right_of(scene, Settings.from_preset("course", shader=shader))


flatten = programs.flatten


def with_mistake(label: str, names: tuple[str, ...]) -> str:
    """Return the kernels' source as `programs.flatten` does, with the mistake, if it has such light."""
    source = wrong = flatten(names)
    for here, there in KERNELS[label]:
        if here not in source:
            return source
        wrong = wrong.replace(here, there)
    return wrong


def drawn(right: Drawing, changes: Sequence[search.Change]) -> tuple[Floats, bool]:
    """Return the codes (M, N, 3) of an image with mistakes, not rounded, and whether the kernels drew it, not the oracle."""
    in_kernels = [change.label for change in changes if change.label in KERNELS]
    places = [PLACES[change.label] for change in changes if change.label in PLACES]
    drawing = search.applied(right, [change for change in changes if change.label not in {*KERNELS, *PLACES}])
    steps = {field.name for field in fields(Drawing)} - {"scene", "settings", "shown"}
    if len(in_kernels) > 1 or any(getattr(drawing, step) is not getattr(right, step) for step in steps):
        return code_image(search.applied(right, changes)), False
    wrong = partial(with_mistake, in_kernels[0]) if in_kernels else flatten
    with mock.patch.object(programs, "flatten", wrong), Renderer(drawing.scene, settings=drawing.settings) as renderer:
        image = np.asarray(renderer.render().rgb, np.float64)
    for place in places:
        image = place(image)
    return drawing.codes_of(image), True


def chosen(changes: Sequence[search.Change], count: int, random: np.random.Generator) -> list[search.Change]:
    """Choose mistakes at random, then one of their variants; those of the scene first."""
    names = list(dict.fromkeys(change.mistake.name for change in changes))
    picked = []
    for name in random.choice(names, count, replace=False):
        variants = [change for change in changes if change.mistake.name == name]
        picked.append(variants[random.integers(len(variants))])
    return sorted(picked, key=lambda change: not change.mistake.early)


def missed(count: int, together: int, seed: int) -> list[str]:
    """Plant mistakes, so many `together`, in `count` images, each of which shows beside the others. Return those that were
    not named first, in any order, and do not give the same image as what was."""
    random = np.random.default_rng((seed, together))
    names = [(name, shader) for name in SCENES for shader in SHADERS]
    done, by_kernels, lines = 0, 0, []
    while done < count:
        where = names[random.integers(len(names))]
        right = right_of(*where)
        changes = chosen(search.changes_of(right.drawing), together, random)
        codes, in_kernels = drawn(right.drawing, changes)
        without = [drawn(right.drawing, [c for c in changes if c is not one])[0] for one in changes]
        if min(search.wrong(np.rint(codes), np.rint(reduced)).sum() for reduced in without) < LEAST:
            continue
        off = random.integers(-1, 2, codes.shape) * (random.random(codes.shape) < NOISE)
        grading = grade.graded(np.clip(np.rint(codes) + off, 0.0, 255.0), right, "image")
        if grading.right:  # another rule for edges draws it as well
            continue
        done, by_kernels, best = done + 1, by_kernels + in_kernels, grading.best
        answers = [best.changes, *best.same] if best and best.claimed else []
        planted = {change.label for change in changes}
        if planted not in [{change.label for change in answer} for answer in answers]:
            lines.append(f"{' + '.join(sorted(planted))} in {where}: {best.label if best else 'nothing'}")
    assert by_kernels > 0.2 * count
    return lines


@needs_device
def test_a_few_planted_mistakes_are_named_first():
    assert missed(3, 1, seed=1) == []


@pytest.mark.long
@needs_device
def test_of_300_planted_mistakes_299_are_named_first():
    lines = missed(300, 1, seed=0)
    assert len(lines) <= 1, lines


@pytest.mark.long
@needs_device
def test_of_40_planted_pairs_30_are_named_first():
    lines = missed(40, 2, seed=0)
    assert len(lines) <= 10, lines
