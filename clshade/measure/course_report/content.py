"""What the page shows: the figures of one scene with their times, errors by cause, and comparisons."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from ...base import console
from ...base.arrays import Bytes
from ...base.atomic_files import shown
from ...base.progress_bar import Bar
from ...course import figures
from ...course.demo import TEXTURE, with_texture
from ...course.figures import Figure, Missing
from ...errors import InputError
from ...images.tonemap import tonemap
from ...pipeline.opencl.device import Device
from ...pipeline.programs import running_time
from ...pipeline.renderer import render
from ...scene.formats.course_npy import only_mesh
from ...scene.model import Edges, Scene, Settings
from ..report.decomposition import Decomposition, decompose
from ..report.model_errors import ModelErrors
from ..report.reference_image import Reference, reference
from ..report.study import machine
from ..report.variants import base_settings
from ..timing import Spread, spread
from .comparisons import Comparison, compare, detail_side
from .pictures import MOST, Part, part_with, reduced, reduced_size

LARGEST = 4096  # pixels a side of the image that a wireframe is cut from
LINE_WIDTH = 1.0  # pixels of a wireframe
ROUNDS = 5  # further calls of each figure, timed
DECOMPOSED = (8, 16, 17, 18)  # figures with all lights and terms


class Drawn(NamedTuple):
    """A figure as shown: pixels (h, w, 3) uint8, reduced if it is large; milliseconds of the first call, and of further ones
    with the scene kept on the device."""

    figure: Figure
    pixels: Bytes
    first: float
    again: Spread


@dataclass(frozen=True, eq=False)
class Content:
    """Everything on the page.

    part: of the figures, in pixels, the part that holds the object. measured: the scene as errors are measured, with at most
    MOST pixels a side; its part is measured_part. decompositions: by the number of the figure whose image it is about.
    references: of the scene without a texture, and with it if there is one. wireframe: the edges of the mesh within `part`,
    (h, w, 3) uint8; None on a device without float64.
    """

    scene: Scene
    device: str
    machine: str
    figures: tuple[Drawn, ...]
    missing: tuple[Missing, ...]
    part: Part
    measured: Scene
    measured_part: Part
    decompositions: dict[int, Decomposition]
    references: tuple[Reference, ...]
    comparisons: tuple[Comparison, ...]
    wireframe: Bytes | None

    @property
    def mapped(self) -> bool:
        """Whether the scene has a texture map."""
        return has_map(self.scene)


def has_map(scene: Scene) -> bool:
    mesh = scene.meshes[0]
    return mesh.material.texture is not None and mesh.uvs is not None


def with_texture_beside(scene: Scene, path: str) -> Scene:
    """Return a course scene with the course's texture, if the file `path` has none given but one lies beside it."""
    beside = Path(path).parent / TEXTURE
    if has_map(scene) or not os.path.isfile(path) or scene.meshes[0].uvs is None or not beside.is_file():
        return scene
    console.progress(f"texture: {shown(beside)}, which lies beside the scene")
    return with_texture(scene, str(beside))


def check(scene: Scene) -> None:
    """Raise InputError for a scene that the course's functions cannot draw."""
    if scene.preset != "course":
        found = f"{scene.name!r}, a mesh or another scene" if scene.name else "a mesh"
        raise InputError(
            f"report: --course: expected a course scene (.npy) or the built-in scene 'course', found {found}"
        )
    only_mesh(scene, "report: --course")


def gather(scene: Scene, device: Device) -> Content:
    """Draw and measure everything. device: the one that the course's functions use. Raises InputError, see `check`."""
    check(scene)
    drawable, missing = figures.possible(scene)
    figures.build_all(scene, drawable)
    covered = render(scene, preset="course", device=device).alpha > 0.0
    measured = replace(scene, camera=scene.camera.with_resolution(reduced_size(scene.camera.resolution)))
    object_there = render(measured, preset="course", device=device).alpha > 0.0
    measured_part = part_with(object_there)
    drawn = tuple(_draw(scene, drawable))
    decompositions: dict[int, Decomposition] = {}
    references: list[Reference] = []
    scenes = [with_texture(measured, None), *([measured] if has_map(scene) else [])]
    steps: list[Callable[[], object]] = []
    for each in scenes:
        steps.append(partial(_decompose, each, device, decompositions, references))
    comparisons: list[Comparison] = []
    steps.append(lambda: comparisons.extend(compare(scenes[-1], device, detail_side(measured_part))))
    with Bar(len(steps), "errors", clock=running_time, hidden=console.quiet() or None) as bar:
        for step in steps:
            step()
            bar.advance()
    return Content(
        scene=scene,
        device=device.title,
        machine=machine(),
        figures=drawn,
        missing=tuple(missing),
        part=part_with(covered),
        measured=measured,
        measured_part=measured_part,
        decompositions=decompositions,
        references=tuple(references),
        comparisons=tuple(comparisons),
        wireframe=_wireframe(scene, device, part_with(covered)) if device.has_fp64 else None,
    )


def _wireframe(scene: Scene, device: Device, part: Part) -> Bytes:
    """Return all edges that are not hidden within a part of the image, magnified to about MOST pixels, (h, w, 3) uint8."""
    longest = max(scene.camera.resolution)
    times = max(1, min(MOST // max(part.width, part.height), LARGEST // longest))
    columns, rows = scene.camera.resolution
    frame = render(
        with_texture(scene, None),
        preset="standard",
        shader="nolight",
        resolution=(columns * times, rows * times),
        samples=16,
        edges=Edges(width=LINE_WIDTH, only=True),
        device=device,
    )
    return Part(*(times * each for each in part)).of(tonemap(frame.rgb, "srgb"))


def _draw(scene: Scene, drawable: list[Figure]) -> Iterator[Drawn]:
    """Draw each figure and time further calls; keep the picture, which is smaller than the image."""
    with Bar(len(drawable), "figures", clock=running_time, hidden=console.quiet() or None) as bar:
        for each in drawable:
            (figure,) = figures.draw_all(scene, [replace(each)])
            pixels, first = reduced(figure.picture), figure.milliseconds
            again = spread([figures.milliseconds(scene, figure) for _ in range(ROUNDS)])
            yield Drawn(each, pixels, first, again)
            bar.advance()


def _decompose(
    scene: Scene, device: Device, decompositions: dict[int, Decomposition], references: list[Reference]
) -> None:
    converged = reference(scene, base_settings(scene), device)
    models = ModelErrors(scene, converged.settings, device)
    references.append(converged)
    for figure in figures.lit() + figures.mapped():
        if figure.number in DECOMPOSED and figure.mapped == has_map(scene):
            settings = Settings.from_preset("course", shader=figure.shader)
            decompositions[figure.number] = decompose(scene, settings, device, converged, models)
