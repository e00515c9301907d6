"""`grade` names mistakes that are planted at random, on five scenes, beside noise. In closed form: test_grade.py."""

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from command_line import needs_device

from clshade.base.arrays import Floats
from clshade.measure.grade import grade, search
from clshade.measure.grade.drawing import Drawing, code_image
from clshade.pipeline.renderer import Renderer
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings, with_materials

SCENES = ("course", "course, vertex colors", "teapot", "icosphere", "quads")  # the first is textured
SHADERS = {"phong": (160, 120), "gouraud": (128, 128)}  # with the resolution
NOISE = 0.1  # share of codes that are off by one
LEAST = 20  # pixels that a planted mistake must change by more than one code


@cache
def right_of(name: str, shader: str) -> grade.Right:
    scene = builtin(name.split(",")[0], resolution=SHADERS[shader])
    if name != "course":
        scene = with_materials(scene, lambda material: replace(material, texture=None))
    return grade.right_of(scene, Settings.from_preset("course", shader=shader))


def drawn(right: Drawing, changes: Sequence[search.Change]) -> tuple[Floats, bool]:
    """Return the codes (M, N, 3) of an image with mistakes, not rounded, and whether the kernels drew it: where only the
    scene, its settings or what is shown of the image is wrong."""
    drawing = search.applied(right, changes)
    steps = {field.name for field in fields(Drawing)} - {"scene", "settings", "shown"}
    if any(getattr(drawing, step) is not getattr(right, step) for step in steps):
        return code_image(drawing), False
    with Renderer(drawing.scene, settings=drawing.settings) as renderer:
        return drawing.codes_of(np.asarray(renderer.render().rgb, np.float64)), True


def chosen(changes: Sequence[search.Change], count: int, random: np.random.Generator) -> list[search.Change]:
    """Choose mistakes at random, then one of their variants; those of the scene first."""
    picked = []
    for name in random.choice(list(dict.fromkeys(change.mistake.name for change in changes)), count, replace=False):
        variants = [change for change in changes if change.mistake.name == name]
        picked.append(variants[random.integers(len(variants))])
    return sorted(picked, key=lambda change: not change.mistake.early)


def missed(count: int, together: int) -> list[str]:
    """Plant mistakes, so many `together`, in `count` images, each of which shows beside the others. Return those that were
    not named first, in any order, and do not give the same image as what was."""
    random = np.random.default_rng((0, together))
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
    assert by_kernels > 0.1 * count
    return lines


@pytest.mark.long
@needs_device
@pytest.mark.parametrize(("count", "together"), [(15, 1), (4, 2)])
def test_planted_mistakes_are_named_first(count, together):
    assert missed(count, together) == []
