"""How many mistakes are named that were planted at random."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...base import text_tables
from ...base.arrays import Array, Floats
from ...base.progress_bar import Bar
from ...course.arguments import Shader
from ...pipeline.programs import rewriting
from ...pipeline.renderer import Renderer
from ...scene.builtin.scenes import builtin
from ...scene.model import Scene, Settings, with_materials
from .drawing import Drawing, code_image
from .grade import Right, graded, right_of
from .search import Change, Explanation, applied, changes_of, wrong
from .wrong_kernels import IMAGES, KERNELS, rewritten

SCENES = {
    "course, textured": ("course", True),
    "course, vertex colors": ("course", False),
    "teapot": ("teapot", False),
    "icosphere": ("icosphere", False),
    "quads": ("quads", False),
}
SHADERS: dict[Shader, tuple[int, int]] = {"phong": (160, 120), "gouraud": (128, 128)}  # with the resolution
SINGLES_BAR, PAIRS_BAR = 0.9, 0.75  # shares that must be named
_NOISE = 0.1  # share of codes that are off by one
_LEAST = 20  # pixels that a planted mistake must change by more than one code


@dataclass(frozen=True, eq=False)
class Planted:
    """What was planted and what was found; found is empty if nothing was claimed. named: whether it, or what gives the same
    image, comes first. by: what drew the image, the OpenCL kernels or the oracle."""

    scene: str
    planted: str
    found: str
    named: bool
    by: str


def scene_of(name: str, resolution: tuple[int, int]) -> Scene:
    """Return a scene of SCENES, with the textures that it is to have."""
    built, textured = SCENES[name]
    scene = builtin(built, resolution=resolution)
    return scene if textured else with_materials(scene, lambda material: replace(material, texture=None))


def _rights() -> dict[str, Right]:
    """Return the right images of all scenes and shaders, by name."""
    return {
        f"{name}, {shader}": right_of(scene_of(name, size), Settings.from_preset("course", shader=shader))
        for name in SCENES
        for shader, size in SHADERS.items()
    }


def drawn(right: Drawing, changes: Sequence[Change]) -> tuple[Floats, str]:
    """Return the codes (M, N, 3) of an image with mistakes, not rounded, and what drew them: the OpenCL kernels where they
    can make these mistakes, else the oracle."""
    in_kernels = [change.label for change in changes if change.label in KERNELS]
    moves = [IMAGES[change.label] for change in changes if change.label in IMAGES]
    drawing = applied(right, [change for change in changes if change.label not in {*KERNELS, *IMAGES}])
    if len(in_kernels) > 1 or not replace(drawing, shown=()).of_scene:
        return code_image(applied(right, changes)), "oracle"
    wrong_light = rewriting(partial(rewritten, in_kernels[0])) if in_kernels else contextlib.nullcontext()
    with wrong_light, Renderer(drawing.scene, settings=drawing.settings) as renderer:
        image = np.asarray(renderer.render().rgb, np.float64)
    for move in moves:
        image = move(image)
    return drawing.codes_of(image), "OpenCL"


def _noisy(codes: Array, generator: np.random.Generator) -> Floats:
    """Return codes rounded, some of them off by one."""
    off = generator.integers(-1, 2, codes.shape) * (generator.random(codes.shape) < _NOISE)
    return np.clip(np.rint(codes) + off, 0.0, 255.0)


def _chosen(right: Right, count: int, generator: np.random.Generator) -> tuple[Change, ...]:
    """Choose mistakes at random, then one of their variants; those of the scene first."""
    changes = changes_of(right.drawing)
    names = list(dict.fromkeys(change.mistake.name for change in changes))
    picked = []
    for name in generator.choice(names, count, replace=False):
        variants = [change for change in changes if change.mistake.name == name]
        picked.append(variants[generator.integers(len(variants))])
    return tuple(sorted(picked, key=lambda change: not change.mistake.early))


def plant(count: int, mistakes: int, seed: int) -> Iterator[Planted]:
    """Plant `mistakes` at a time, 1 or 2, in `count` images, and grade these. Each must show, and of two each beside the
    other."""
    generator = np.random.default_rng((seed, mistakes))
    rights = _rights()
    done = 0
    while done < count:
        scene = str(generator.choice(list(rights)))
        right = rights[scene]
        changes = _chosen(right, mistakes, generator)
        codes, by = drawn(right.drawing, changes)
        without = [drawn(right.drawing, [c for c in changes if c is not left])[0] for left in changes]
        if min(wrong(np.rint(codes), np.rint(other)).sum() for other in without) < _LEAST:
            continue
        done += 1
        found = graded(_noisy(codes, generator), right, scene)
        label = " + ".join(change.label for change in changes)
        yield Planted(scene, label, found.best.label if found.best else "", _is_named(changes, found.best), by)


def _is_named(changes: tuple[Change, ...], found: Explanation | None) -> bool:
    """Return whether the mistakes, in any order, are found first, or give the same image as what is."""
    if found is None or not found.claimed:
        return False
    wanted = {change.label for change in changes}
    return any({change.label for change in each} == wanted for each in (found.changes, *found.same))


def run(singles: int, pairs: int, seed: int) -> bool:
    """Plant mistakes, print what was named, and return whether both shares reach their bars."""
    passed = True
    for what, count, mistakes, bar in (("single mistakes", singles, 1, SINGLES_BAR), ("pairs", pairs, 2, PAIRS_BAR)):
        if not count:
            continue
        found = []
        with Bar(count, what, clock=time.time) as progress:
            for each in plant(count, mistakes, seed):
                found.append(each)
                progress.advance()
        named = sum(each.named for each in found)
        by = sum(each.by == "OpenCL" for each in found)
        share = 100.0 * named / count
        print(f"{what}: {named} of {count} named first, {share:.1f} %; {by} drawn by OpenCL, the others by the oracle")
        missed = [(each.planted, each.found or "nothing", each.scene) for each in found if not each.named]
        if missed:
            print("\n".join(text_tables.as_lines(("planted", "found", "scene"), missed, 3)))
        passed = passed and named >= bar * count
    return passed
