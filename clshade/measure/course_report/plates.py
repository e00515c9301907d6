"""Pictures with their captions: the figures of the course, and comparisons with their details."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element

from ...base.arrays import Bytes
from ...base.markup import Content as Markup
from ...base.markup import element
from ...images import png
from ...scene.lights import plain_lights
from ...scene.model import Scene
from . import pictures
from .comparisons import Comparison, Place
from .content import Drawn
from .pictures import Part
from .wording import rounded, sentence, vector


def shown_part(resolution: tuple[int, int], part: Part) -> str:
    """Return CSS variables: the image's size, and the part of it that is shown."""
    values = dict(zip(("w", "h", "x", "y", "pw", "ph"), (*resolution, *part), strict=True))
    return "; ".join(f"--{name}: {value}" for name, value in values.items())


def captioned(scene: Scene, drawn: Drawn) -> Element:
    figure = drawn.figure
    what: Markup = f" {sentence(figure.what)}"
    if figure.mapped:
        what = " Without light" if figure.shader == "nolight" else f" {figure.shader.capitalize()} shading"
    elif len(figure.lights) == 1 and "light" in figure.what and len(scene.lights) > 1:
        at = element(
            "span", vector(plain_lights(scene.name, scene.lights)[figure.lights[0]].position), class_="unbroken"
        )
        what = [f" {sentence(figure.what)}, at ", at]
    took = element("span", f"{drawn.first:.1f} ms", class_="soft unbroken")
    caption = element("figcaption", element("b", f"Figure {figure.number}."), what, ". ", took)
    return element(
        "figure", view(drawn.pixels, f"Figure {figure.number}: {figure.title}"), caption, id=f"f{figure.number}"
    )


def view(pixels: Bytes, about: str, overlay: Markup = None) -> Element:
    """Return a picture of which the object's part is shown."""
    image = element("img", src=png.as_uri(pixels), alt=about)
    return element("div", element("div", image, overlay, class_="sheet"), class_="view")


def wireframe(scene: Scene, pixels: Bytes) -> Element:
    """Return the picture of the mesh's edges."""
    caption = element(
        "figcaption",
        element("b", "The mesh."),
        f" The edges of its {scene.face_count:,} triangles, without those that other triangles hide.",
    )
    return element("figure", element("img", src=png.as_uri(pixels), alt="Edges of the mesh"), caption, class_="mesh")


def comparison(number: int, found: Comparison, resolution: tuple[int, int], part: Part) -> Element:
    """Return a comparison with a heading of its own. resolution: of its images, of which a part is shown."""
    each = found.approximation
    colors = pictures.painted(found.difference, found.covered, found.dark)
    shown_images = (*found.images, colors)
    labels = (*each.names, "difference")
    sheets = [
        element(
            "div",
            element("p", sentence(label), class_="label"),
            view(
                image, f"{each.title}: {label}", _squares(found.places, resolution, part) if image is colors else None
            ),
        )
        for label, image in zip(labels, shown_images, strict=True)
    ]
    pixels = resolution[0] * resolution[1]
    measured = (
        f"RMSE {rounded(found.rmse, 2)}, largest difference {rounded(found.largest, 2)}; {found.changed:,} of {pixels:,} "
        "pixels have other colors in a PNG."
    )
    scale = element(
        "div",
        "0",
        element("img", src=png.as_uri(pictures.scale()), alt=""),
        f"{rounded(found.dark, 2)} or more",
        class_="scale",
    )
    caption = element("figcaption", element("b", f"Figure {number}."), f" {each.title}. {measured}")
    return element(
        "article",
        element("h3", each.title),
        element("p", f"{each.about} {found.why}"),
        element(
            "figure",
            element("div", sheets, class_="row three"),
            scale if found.places else None,
            [_detail(k + 1, place, shown_images, labels) for k, place in enumerate(found.places)],
            caption,
            class_="wide",
            id=f"f{number}",
            style=shown_part(resolution, part),
        ),
    )


def _squares(places: Sequence[Place], resolution: tuple[int, int], part: Part) -> Element:
    """Return numbered squares over a picture, as SVG in pixels of the image."""
    columns, rows = resolution
    size = max(part.width, part.height) / 22.0
    marks = []
    for k, (place, _) in enumerate(places, start=1):
        x, y = place.left + place.width + 0.2 * size, place.top + 0.8 * size
        if x + 0.6 * size > part.left + part.width:
            x = place.left - 0.8 * size
        marks += [
            element("rect", x=str(place.left), y=str(place.top), width=str(place.width), height=str(place.height)),
            element("text", str(k), x=f"{x:.1f}", y=f"{y:.1f}", style=f"font-size: {size:.1f}px"),
        ]
    return element("svg", marks, viewBox=f"0 0 {columns} {rows}", aria_hidden="true")


def _detail(number: int, place: Place, images: Sequence[Bytes], labels: Sequence[str]) -> Element:
    return element(
        "div",
        [
            element("img", src=png.as_uri(pictures.enlarged(place.part.of(image))), alt=f"{label}, place {number}")
            for image, label in zip(images, labels, strict=True)
        ],
        element("div", element("b", f"{number}"), f" {place.said}", class_="place"),
        class_="details",
    )
