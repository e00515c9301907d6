"""`report SCENE --course`: one page of a course scene, its figures with their times and the causes of their errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from ...base import atomic_files, console
from ...base.arrays import Bytes, Floats
from ...base.progress_bar import Bar
from ...base.text_tables import digits
from ...course import figures
from ...course.demo import TEXTURE, with_texture
from ...course.figures import Figure
from ...errors import InputError
from ...images import png
from ...pipeline.opencl.device import Device, shared_device
from ...pipeline.programs import running_time
from ...scene.formats.course_npy import only_mesh
from ...scene.lights import plain_lights
from ...scene.model import Scene, Settings
from ..markup import data_uri, element
from ..report.decomposition import Decomposition, decompose
from ..report.model_errors import ModelErrors
from ..report.reference_image import reference
from ..report.study import machine
from ..report.variants import base_settings
from ..results import Column, Results, Table

LARGEST = 1024  # columns and rows of a picture on the page, and of an image whose errors are measured
ROUNDS = 5  # further calls of each figure, timed
DECOMPOSED = (8, 16, 17, 18)  # figures with all lights and terms
SETTINGS = ("visibility", "interpolation", "lighting_at", "texture_at", "ambient", "precision", "samples")
OTHERS = {
    ".pdf": ": a browser prints the page as PDF",
    **dict.fromkeys((".md", ".csv", ".json", ".png", ".exr", ".npy"), ""),
}
STYLE = """
.figures { display: grid; grid-template-columns: repeat(4, minmax(0, 1fr)); gap: 1rem; margin-top: 2rem }
figure { margin: 0; break-inside: avoid } figure img { width: 100%; border: 1px solid #ddd }
figcaption { font-size: .85rem }
"""


class Drawn(NamedTuple):
    """A figure: its picture, (h, w, 3) uint8 with at most LARGEST pixels a side; milliseconds of the first call, and the
    median of further ones, which find the scene on the device."""

    figure: Figure
    picture: Bytes
    first: float
    again: float


ERRORS_ABOUT = (
    "The RMSE of each cause (display white is 1), and its share of the total's mean square, which is negative where it "
    "makes up for others. A cause is the difference of two images in which only that cause differs, from a converged "
    "reference to the figure: the differences add up to the total error in every pixel."
)


def output_path(out: str | Path) -> Path:
    """Return the name of the page: `out`, with .html unless it ends so.

    Raises InputError for the extension of another format, OutputError for a file that cannot be written.
    """
    path = Path(out)
    if path.suffix.lower() in OTHERS:
        expected = "a name that ends in .html"
        raise InputError(f"--out: expected {expected}, found {atomic_files.shown(path)}{OTHERS[path.suffix.lower()]}")
    if path.suffix.lower() not in (".html", ".htm") and path.name not in ("", ".."):
        path = path.with_name(f"{path.name}.html")
    atomic_files.check(path)
    return path


def run(scene: Scene, source: str, out: str | Path, version: str) -> Path:
    """Write the page, and return its name.

    source: what the scene was loaded from; a texture of the course that lies beside it is used if the scene has none.
    out: see `output_path`. version: of clshade. The device is the environment's, see `open_device`, because the course's
    functions use that.
    Raises InputError for a scene that they cannot draw, DeviceError and OutputError.
    """
    path = output_path(out)
    _check(scene)
    scene = _with_texture_beside(scene, Path(source))
    device = shared_device()
    drawable, missing = figures.possible(scene)
    figures.build_all(scene, drawable)
    pictures_of_scene = list(_draw(scene, drawable))
    facts = _facts(scene, device, version)
    facts |= {f"no figure {', '.join(map(str, numbers))}": why for why, numbers in missing.items()}
    title = f"Course report: {atomic_files.shown(scene.name or 'unnamed scene')}"
    results = Results(title, facts, [_errors(scene, device)])
    pictures = element("div", [_figure(each) for each in pictures_of_scene], class_="figures")
    atomic_files.write_bytes(path, results.html(pictures, style=STYLE))
    return path


def _check(scene: Scene) -> None:
    if scene.preset != "course":
        described = f"{scene.name!r}, a mesh or another scene" if scene.name else "a mesh"
        raise InputError(
            f"report: --course: expected a course scene (.npy) or the built-in scene 'course', found {described}"
        )
    only_mesh(scene, "report: --course")


def _has_map(scene: Scene) -> bool:
    mesh = scene.meshes[0]
    return mesh.material.texture is not None and mesh.uvs is not None


def _with_texture_beside(scene: Scene, source: Path) -> Scene:
    beside = source.parent / TEXTURE
    if _has_map(scene) or not source.is_file() or scene.meshes[0].uvs is None or not beside.is_file():
        return scene
    console.progress(f"texture: {atomic_files.shown(beside)}, which lies beside the scene")
    return with_texture(scene, str(beside))


def _draw(scene: Scene, drawable: list[Figure]) -> Iterator[Drawn]:
    """Draw each figure and time further calls; keep the picture, which is smaller than the image."""
    from PIL import Image

    with Bar(len(drawable), "figures", clock=running_time, hidden=console.quiet() or None) as bar:
        for each in drawable:
            (figure,) = figures.draw_all(scene, [replace(each)])
            picture, first = Image.fromarray(figure.picture), figure.milliseconds
            picture.thumbnail((LARGEST, LARGEST), Image.Resampling.BOX)
            again = median(figures.milliseconds(scene, figure) for _ in range(ROUNDS))
            yield Drawn(each, np.array(picture), first, again)
            bar.advance()


def _figure(picture: Drawn) -> Element:
    figure = picture.figure
    image = element("img", src=data_uri("image/png", png.to_bytes(picture.picture, png.PAGE_LEVEL)), alt=figure.title)
    caption = element("figcaption", f"{figure.title.capitalize()}. {picture.first:.1f} ms, then {picture.again:.1f} ms")
    return element("figure", image, caption, id=f"f{figure.number}")


def _facts(scene: Scene, device: Device, version: str) -> dict[str, Any]:
    course, material = Settings.from_preset("course"), scene.meshes[0].material
    columns, rows = scene.camera.resolution
    lights = enumerate(plain_lights(scene.name, scene.lights), 1)
    return {
        "scene": f"{scene.face_count:,} triangles, {columns} x {rows} pixels",
        "material": f"ka {_vector(material.ka)}, kd {_vector(material.kd)}, ks {_vector(material.ks)}, n {material.n:g}",
        **{f"light {k}": f"at {_vector(light.position)}, intensity {_vector(light.intensity)}" for k, light in lights},
        "settings": ", ".join(f"{name} {getattr(course, name)}" for name in SETTINGS),
        "times": "of the first call of render_object or render_object_map, which uploads the scene, then the median of "
        f"{ROUNDS} more, which find it on the device; kernels were compiled before",
        "device": device.title,
        "machine": machine(),
        "software": f"clshade {version}, NumPy {np.__version__}",
    }


def _vector(values: Floats) -> str:
    return "(" + ", ".join(map(digits, values)) + ")"


# Errors


def _errors(scene: Scene, device: Device) -> Table:
    """Measure the errors of the figures that show all of the scene: a row for each cause, a column for each figure."""
    scale = min(1.0, LARGEST / max(scene.camera.resolution))
    columns, rows = (max(1, round(scale * side)) for side in scene.camera.resolution)
    measured = replace(scene, camera=scene.camera.with_resolution((columns, rows)))
    scenes = [with_texture(measured, None), *([measured] if _has_map(scene) else [])]
    errors: list[tuple[int, Decomposition]] = []
    with Bar(len(scenes), "errors", clock=running_time, hidden=console.quiet() or None) as bar:
        for each in scenes:
            errors += _decomposed(each, device)
            bar.advance()
    rmse = {number: _rmse(each) for number, each in errors}
    header = [
        Column("cause", "", str, str),
        *(Column(f"figure {number}", "", of.get, lambda text: text or "-") for number, of in rmse.items()),
    ]
    # The figure with the most causes has those of all others: Gouraud shading, with the texture map if there is one.
    causes = max(([*of] for of in rmse.values()), key=len)
    notes = [f"figure {number}: {line}" for number, each in errors for line in each.remarks()]
    return Table("Errors by cause", header, causes, f"{ERRORS_ABOUT} Measured at {columns} x {rows} pixels.", notes)


def _decomposed(scene: Scene, device: Device) -> Iterator[tuple[int, Decomposition]]:
    """Yield the errors of the figures of a scene with a texture map or without, after the figures' numbers."""
    converged = reference(scene, base_settings(scene), device)
    models = ModelErrors(scene, converged.settings, device)
    for figure in figures.lit() + figures.mapped():
        if figure.number in DECOMPOSED and figure.mapped == _has_map(scene):
            settings = Settings.from_preset("course", shader=figure.shader)
            yield figure.number, decompose(scene, settings, device, converged, models)


def _rmse(of: Decomposition) -> dict[str, str]:
    """Return the RMSE of each cause and of all, as people read them."""
    errors = {}
    for part in of.parts:
        share = "" if part.share is None else f" ({round(100.0 * part.share, 1) + 0.0} %)"  # 0.0 and not -0.0
        errors[part.cause] = f"{digits(part.rmse)}{share}" if part.rmse else "-"
    return {**errors, "total": digits(of.total), "total of the PNG": digits(of.png_total)}
