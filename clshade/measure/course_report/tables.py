"""The tables of the page, and the notes below them."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib import metadata
from xml.etree.ElementTree import Element

from ...base.atomic_files import shown
from ...base.markup import Content as Markup
from ...base.markup import element, table
from ...scene.lights import plain_lights
from ...scene.model import Scene, Settings
from ..report.decomposition import Decomposition
from .content import ROUNDS, Content
from .wording import coefficient, figures, rounded, sentence, vector

PACKAGES = ("numpy", "pyopencl", "Pillow", "matplotlib")
COURSE = ("visibility", "interpolation", "lighting_at", "texture_at", "ambient", "precision", "samples")


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
            "Image": f"{columns} × {rows} pixels; plane {rounded(width, 4)} × {rounded(height, 4)} at focal "
            f"length {rounded(camera.focal, 4)}",
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
    points = plain_lights(scene.name, scene.lights)
    rows = [(str(k), vector(each.position), vector(each.intensity)) for k, each in enumerate(points, start=1)]
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
        [element("td", rounded(each.total)), element("td", "100 %" if each.total else "–")] for each in found.values()
    ]
    png = [[element("td", rounded(each.png_total)), element("td", "–")] for each in found.values()]
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
        cells += [element("td", rounded(part.rmse)), element("td", share)]
    return element("tr", element("th", name.replace("'", "’"), scope="row"), cells)


def notes(content: Content) -> list[str]:
    """Return what the decompositions say beside their parts: each sentence once, with the figures that it is about."""
    said: dict[str, list[int]] = {}
    for figure, each in content.decompositions.items():
        for line in (each.relation(), *each.remarks()):
            said.setdefault(line, []).append(figure)
    lines = []
    for line, numbers in said.items():
        every = len(numbers) == len(content.decompositions)
        lines.append(f"{sentence(line)}." if every else f"{figures(numbers)}: {line}.")
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
