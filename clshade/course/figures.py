"""Figures 1 to 19 of the course: what each shows, which of them a scene can show, and their images."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..base import console
from ..scene.model import Scene
from .arguments import Shader

LIGHTS = 3  # of a scene of the course
TERMS = ("ambient", "diffuse", "specular")
LIT: tuple[Shader, Shader] = ("gouraud", "phong")


@dataclass
class Figure:
    """One figure: what part of the scene it shows and, once drawn, its image."""

    number: int
    shader: Shader
    what: str
    terms: tuple[str, ...] = TERMS  # of the light, that are shown
    lights: tuple[int, ...] = (0, 1, 2)  # indices
    mapped: bool = False  # whether the texture is applied
    image: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3)))  # (M, N, 3), row 0 at the bottom
    milliseconds: float = 0.0  # that drawing took

    @cached_property
    def linear(self) -> np.ndarray:
        """The image as written to the EXR: (M, N, 3) float32, row 0 at the top."""
        return np.ascontiguousarray(self.image[::-1], dtype=np.float32)

    @cached_property
    def picture(self) -> np.ndarray:
        """The image as shown: clamped, (M, N, 3) uint8, row 0 at the top."""
        from ..images.tonemap import tonemap

        return tonemap(self.linear, "none")

    @property
    def title(self) -> str:
        return f"figure {self.number}: {self.shader}, {self.what}"

    @property
    def stem(self) -> str:
        return f"figure{self.number:02d}-{self.shader}-{self.what.replace(' ', '-')}"


# The plan


def lit(lights: int = LIGHTS) -> list[Figure]:
    """Return figures 1 to 16, with vertex colors: 1 to 8 gouraud and 9 to 16 phong, in both ambient, diffuse and specular
    light, all three; the first, second and third light, all of them. lights: number of lights of the scene."""
    every = tuple(range(lights))
    contents = [
        *((f"{term} only", (term,), every) for term in TERMS),
        ("all terms", TERMS, every),
        *((f"light {k + 1} only", TERMS, (k,)) for k in range(LIGHTS)),
        ("all lights", TERMS, every),
    ]
    shaded = [(shader, *content) for shader in LIT for content in contents]
    return [Figure(number, *figure) for number, figure in enumerate(shaded, 1)]


def mapped(lights: int = LIGHTS) -> list[Figure]:
    """Return figures 17 to 19, with the texture map: gouraud, phong and without light."""
    every = tuple(range(lights))
    return [Figure(17 + k, shader, "map", lights=every, mapped=True) for k, shader in enumerate((*LIT, "nolight"))]


def pairs(figures: Sequence[Figure]) -> list[tuple[Figure, Figure]]:
    """Return the pairs (gouraud, phong) of each combination of terms; of several such figures the first."""
    first: dict[tuple[Shader, tuple[str, ...]], Figure] = {}
    for figure in figures:
        first.setdefault((figure.shader, figure.terms), figure)
    return [(figure, first["phong", terms]) for (shader, terms), figure in first.items() if shader == "gouraud"]


def possible(scene: Scene) -> tuple[list[Figure], dict[str, tuple[int, ...]]]:
    """Return the figures that the scene can show, and the numbers of those that it cannot by the reason.

    Figures of all lights show all that the scene has, also more than three.
    """
    count, mesh = len(scene.lights), scene.meshes[0]
    lights = f"the scene has {count or 'no'} light{'s' * (count != 1)}"

    def reason(figure: Figure) -> str:
        unlit = not count and not figure.mapped and "ambient" not in figure.terms
        if unlit or max(figure.lights, default=-1) >= count:
            return lights
        if figure.mapped and mesh.uvs is None:
            return "the scene has no texture coordinates"
        return "the scene has no texture" if figure.mapped and mesh.material.texture is None else ""

    by_reason: dict[str, list[Figure]] = {"": []}
    for figure in lit(count) + mapped(count):
        by_reason.setdefault(reason(figure), []).append(figure)
    drawable = by_reason.pop("")
    return drawable, {why: tuple(figure.number for figure in figures) for why, figures in by_reason.items()}


# Drawing


def draw(scene: Scene, figure: Figure) -> np.ndarray:
    """Draw the figure with one call of `render_object` or `render_object_map`."""
    from .. import course

    arguments = course.arguments(scene, textured=figure.mapped)
    for term, name in (("ambient", "k_a"), ("diffuse", "k_d"), ("specular", "k_s")):
        if term not in figure.terms:
            arguments[name] = 0.0
    for name in ("l_pos", "l_int"):
        arguments[name] = arguments[name][list(figure.lights)]
    return (course.render_object_map if figure.mapped else course.render_object)(figure.shader, **arguments)


def build_all(scene: Scene, figures: Sequence[Figure]) -> None:
    """Build the programs of all figures by drawing one figure with each; the first time each takes seconds."""
    from ..base.progress_bar import Bar
    from ..pipeline.opencl.device import shared_device

    shared_device()  # its errors come before the progress bar
    needed = {(figure.shader, figure.terms, figure.mapped): figure for figure in figures}
    with Bar(len(needed), "programs", clock=None, hidden=console.quiet()) as bar:
        for figure in needed.values():
            draw(scene, figure)
            bar.advance()


def draw_all(scene: Scene, figures: Iterable[Figure]) -> Iterator[Figure]:
    """Draw and time each figure as if it were the first of its scene."""
    from .. import course

    for figure in figures:
        course.release()
        figure.milliseconds = milliseconds(scene, figure)
        yield figure


def milliseconds(scene: Scene, figure: Figure) -> float:
    """Draw the figure, keep its image, and return the time of the call."""
    start = time.perf_counter()
    figure.image = draw(scene, figure)
    return (time.perf_counter() - start) * 1e3
