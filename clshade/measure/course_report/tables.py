"""The tables of the page, and the notes below them."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib import metadata
from xml.etree.ElementTree import Element

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import shown
from ...base.markup import Content as Markup
from ...base.markup import element, table
from ...base.text_tables import digits
from ...scene.model import Scene, Settings
from ..report.decomposition import Decomposition
from .content import ROUNDS, Content

PACKAGES = ("numpy", "pyopencl", "Pillow", "matplotlib")
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
COURSE = ("visibility", "interpolation", "lighting_at", "texture_at", "ambient", "precision", "samples")


def vector(values: Array) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in values).replace("-", "−") + ")"


def coefficient(values: Array) -> str:
    """Return one number for three equal ones."""
    return f"{values[0]:.3g}" if np.ptp(values) == 0.0 else vector(values)


def number(value: float) -> str:
    """Return three digits, with a power of ten as people write it."""
    mantissa, _, exponent = digits(value).partition("e")
    return f"{mantissa} × 10{str(int(exponent)).translate(SUPERSCRIPTS)}" if exponent else mantissa


def _facts(rows: Mapping[str, Markup]) -> Element:
    body = [element("tr", element("th", name, scope="row"), element("td", value)) for name, value in rows.items()]
    return element("table", element("tbody", body), class_="facts")


def facts(scene: Scene) -> Element:
    mesh, camera = scene.meshes[0], scene.camera
    material, texture = mesh.material, mesh.material.texture
    columns, rows = camera.resolution
    height, width = camera.plane
    colors = ["vertex colors"] if mesh.colors is not None else []
    if texture is not None:
        size = f"{texture.image.shape[1]} × {texture.image.shape[0]} texels"
        colors.append(f"texture map {shown(texture.name)}, {size}" if texture.name else f"texture map, {size}")
    background = scene.background
    return _facts(
        {
            "Scene": shown(scene.name) if scene.name else "unnamed",
            "Mesh": f"{len(mesh.verts):,} vertices, {scene.face_count:,} triangles; {' and '.join(colors) or 'white'}",
            "Camera": f"at {vector(camera.eye)}, looking at {vector(camera.lookat)}, up {vector(camera.up)}",
            "Image": f"{columns} × {rows} pixels; plane {width:.4g} × {height:.4g} at focal length {camera.focal:.4g}",
            "Material": f"ka {coefficient(material.ka)}, kd {coefficient(material.kd)}, ks {coefficient(material.ks)}, "
            f"exponent n = {material.n:g}",
            "Ambient light": vector(scene.ambient),
            "Background": "none" if background is None else vector(background),
        }
    )


def lights(scene: Scene) -> Element | None:
    """Return a table of the lights, None without any."""
    if not scene.lights:
        return None
    rows = [(str(k), vector(each.position), vector(each.intensity)) for k, each in enumerate(scene.lights, start=1)]
    return table(("Light", "position", "intensity"), rows, class_="lights")


# Errors


def causes(content: Content) -> Element:
    """Return a table of the causes, two columns for each figure: RMSE and share."""
    found = content.decompositions
    names = list(dict.fromkeys(part.cause for each in found.values() for part in each.parts))
    top = element("tr", element("td"), [element("th", f"Figure {n}", colspan="2", scope="colgroup") for n in found])
    head = element(
        "tr",
        element("th", "Cause", scope="col"),
        [[element("th", each, scope="col") for each in ("RMSE", "share")] for _ in found],
    )
    body = [_cause(name, found) for name in names]
    totals = [
        [element("td", number(each.total)), element("td", "100 %" if each.total else "–")] for each in found.values()
    ]
    png = [[element("td", number(each.png_total)), element("td", "–")] for each in found.values()]
    body.insert(len(body) - 1, element("tr", element("th", "total", scope="row"), totals, class_="sum"))
    body.append(element("tr", element("th", "total of the PNG", scope="row"), png, class_="sum"))
    made = element("table", element("thead", top, head), element("tbody", body), class_="causes")
    return element("div", made, class_="scroll")


def _cause(name: str, found: Mapping[int, Decomposition]) -> Element:
    cells: list[Markup] = []
    for each in found.values():
        part = next((part for part in each.parts if part.cause == name), None)
        if part is None or not part.rmse:
            cells += [element("td", "–"), element("td", "–")]
            continue
        share = "–" if part.share is None else f"{round(100.0 * part.share, 1) + 0.0:.1f} %".replace("-", "−")
        cells += [element("td", number(part.rmse)), element("td", share)]
    return element("tr", element("th", name.replace("'", "’"), scope="row"), cells)


def notes(content: Content) -> list[str]:
    """Return what the decompositions say beside their parts: each sentence once, with the figures that it is about."""
    said: dict[str, list[int]] = {}
    for number, each in content.decompositions.items():
        total, *others = each.lines()
        for line in (total.partition("; ")[2], *others):  # the table has the totals
            said.setdefault(line, []).append(number)
    lines = []
    for line, numbers in said.items():
        every = len(numbers) == len(content.decompositions)
        about = "" if every else f"Figure{'s' * (len(numbers) > 1)} {' and '.join(map(str, numbers))}: "
        lines.append(f"{about}{line[0].upper() if every else line[0]}{line[1:]}.")
    columns, rows = content.measured.camera.resolution
    kinds = ("", ", with the texture map")
    references = [
        f"The reference{kind}: {each.about()}." for kind, each in zip(kinds, content.references, strict=False)
    ]
    return [*lines, f"All of this is measured at {columns} × {rows} pixels.", *references]


# Times and versions


def times(content: Content) -> list[Markup]:
    rows = [
        (
            f"{each.figure.number}  {each.figure.shader}, {each.figure.what}",
            f"{each.first:.1f}",
            f"{each.again.median:.1f}",
            f"{each.again.low:.1f} to {each.again.high:.1f}",
        )
        for each in content.figures
    ]
    said = (
        "Milliseconds of a call of render_object or render_object_map: of the first, which uploads the scene, and the "
        f"median and the middle half of {ROUNDS} more, which find it on the device. Kernels were compiled before."
    )
    made = table(("Figure", "first call", "further calls", "middle half"), rows, class_="times")
    return [element("p", said), element("div", made, class_="scroll")]


def versions(content: Content, version: str) -> Element:
    course = Settings.from_preset("course")
    best = content.references[0].settings
    return _facts(
        {
            "Figures": ", ".join(f"{name} {getattr(course, name)}" for name in COURSE),
            "Reference": ", ".join(f"{name} {getattr(best, name)}" for name in ("shader", *COURSE[:-1]))
            + f", samples {content.references[0].samples}",
            "Device": shown(content.device),
            "Machine": shown(content.machine),
            "Software": ", ".join(
                [f"clshade {version}", *map(_version, PACKAGES), f"Python {platform.python_version()}"]
            ),
        }
    )


def _version(package: str) -> str:
    try:
        return f"{package} {metadata.version(package)}"
    except metadata.PackageNotFoundError:
        return f"{package}, version not known"
