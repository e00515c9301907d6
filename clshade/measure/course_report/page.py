"""The page: its sections, numbered figures and tables, from what was drawn and measured."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from importlib import resources
from typing import NamedTuple
from xml.etree.ElementTree import Element

from ...base.arrays import Bytes
from ...base.atomic_files import shown
from ...base.markup import Content as Markup
from ...base.markup import element, page
from ...course.figures import Missing
from ...scene.model import Scene
from . import pictures
from .comparisons import Comparison, Place
from .content import Content, Drawn
from .pictures import Part, data_uri
from .tables import causes, facts, lights, notes, times, vector, versions

COURSE = 19  # figures of the course; comparisons go on from there
PLATES = ((1, 9, "Gouraud shading"), (9, 17, "Phong shading"), (17, 20, "Texture map"))


class Section(NamedTuple):
    """A section with its subsections, by number and title."""

    title: str
    content: list[Markup]
    inner: tuple[str, ...] = ()


def html(content: Content, version: str) -> bytes:
    """Return the whole page, UTF-8. version: of clshade."""
    sections = [
        Section("The scene", _scene(content)),
        _figures(content),
        Section("Where the error comes from", _decomposition(content)),
        _comparisons(content),
        Section("Times", [times(content)]),
        Section("Settings and versions", [versions(content, version)]),
    ]
    title = f"Course report: {shown(content.scene.name) if content.scene.name else 'unnamed scene'}"
    day = datetime.date.today()
    body = element(
        "body",
        element(
            "header",
            element("h1", title),
            element("p", f"{_about(content.scene)}. {day.day} {day:%B %Y}.", class_="about"),
            element("p", _summary(content)),
            element("nav", _contents(sections), aria_label="Contents"),
        ),
        element("main", [_section(k + 1, each) for k, each in enumerate(sections)]),
        element("footer", "Made by clshade; the page holds all of its pictures and refers to nothing outside itself."),
        style=_part(content.scene.camera.resolution, content.part),
    )
    style = resources.files(__package__).joinpath("style.css").read_text(encoding="utf-8")
    return page(title, style, body)


def _about(scene: Scene) -> str:
    columns, rows = scene.camera.resolution
    count = len(scene.lights)
    return f"{scene.face_count:,} triangles, {count or 'no'} light{'s' * (count != 1)}, {columns} × {rows} pixels"


def _summary(content: Content) -> str:
    """Return two sentences: how long the figures took, and how far off the last one is."""
    number = max(n for n in content.decompositions if n != 17)
    found = content.decompositions[number]
    largest = sorted((part for part in found.parts if part.share), key=lambda part: -(part.share or 0.0))[:2]
    seconds = sum(each.first for each in content.figures) / 1e3
    said = f"{len(content.figures)} figures, drawn in {seconds:.2g} s."
    if not found.total:
        return f"{said} Figure {number} has no error."
    named = " and ".join(f"{part.cause} ({100.0 * (part.share or 0.0):.0f} %)" for part in largest)
    return (
        f"{said} Figure {number} is off by an RMSE of {found.total:.2g} (display white is 1) from the same scene drawn "
        f"without approximations; most of that comes from {named}."
    )


def _part(resolution: tuple[int, int], part: Part) -> str:
    """Return CSS variables: the image's size, and the part of it that is shown."""
    values = dict(zip(("w", "h", "x", "y", "pw", "ph"), (*resolution, *part), strict=True))
    return "; ".join(f"--{name}: {value}" for name, value in values.items())


# Sections


def _numbered(number: str, title: str) -> list[Markup]:
    return [element("span", number, class_="number"), title]


def _contents(sections: Sequence[Section]) -> Element:
    def line(number: str, title: str, inner: Markup = None) -> Element:
        return element("li", element("a", _numbered(number, title), href=f"#s{number}"), inner)

    items = []
    for k, each in enumerate(sections, start=1):
        inner = [line(f"{k}.{j}", title) for j, title in enumerate(each.inner, start=1)]
        items.append(line(str(k), each.title, element("ol", inner) if inner else None))
    return element("ol", items)


def _section(number: int, section: Section) -> Element:
    heading = element("h2", _numbered(str(number), section.title), id=f"s{number}")
    made = element("section", heading, section.content)
    for k, inner in enumerate(made.iter("h3"), start=1):
        title, inner.text = inner.text or "", None
        inner.set("id", f"s{number}.{k}")
        inner.append(element("span", f"{number}.{k}", class_="number"))
        inner[0].tail = title
    return made


def _scene(content: Content) -> list[Markup]:
    said = [element("p", f"{each}.") for each in _remarks(content.scene, content.missing)]
    return [facts(content.scene), lights(content.scene), said]


def _remarks(scene: Scene, missing: Sequence[Missing]) -> list[str]:
    """Return what the figures cannot show, as sentences without their ends."""
    found = [f"{_list(each.numbers)} left out: {each.why}" for each in missing]
    if scene.meshes[0].colors is None:
        found.append("The scene has no vertex colors: figures 1 to 16 show it white")
    if len(scene.lights) > 3:
        found.append("The course has figures for the first three lights; those of all lights show the others too")
    return found


def _list(numbers: Sequence[int]) -> str:
    """Return "Figure 7 is", "Figures 7 and 15 are", "Figures 17 to 19 are"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words = [f"{run[0]} to {run[-1]}" if len(run) > 2 else " and ".join(map(str, run)) for run in runs]
    named = words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
    return f"Figure {named} is" if len(numbers) == 1 else f"Figures {named} are"


# The course's figures


def _figures(content: Content) -> Section:
    columns, rows = content.scene.camera.resolution
    part = content.part
    whole = (part.width, part.height) == (columns, rows)
    said = [
        "The figures are what the course’s functions return, clamped to 1, with the preset of the course: painter’s order, "
        "affine interpolation, light seen from each triangle’s center of mass, textures looked up at the corners."
    ]
    if not whole:
        said.append(
            f" Shown are columns {part.left} to {part.left + part.width - 1} and rows {part.top} to "
            f"{part.top + part.height - 1} from the top; the rest of the {columns} × {rows} pixels is background."
        )
    if content.figures[0].pixels.shape[:2] != (rows, columns):
        said.append(f" Pictures are reduced to {content.figures[0].pixels.shape[1]} columns.")
    switch = element(
        "label", element("input", type="checkbox", id="whole"), "show the whole images", class_="whole", for_="whole"
    )
    plates: list[Markup] = []
    titles = []
    for first, end, title in PLATES:
        drawn = [each for each in content.figures if first <= each.figure.number < end]
        if not drawn:
            continue
        across = "three" if len(drawn) == 3 else "four"
        captioned = [_captioned(content.scene, each) for each in drawn]
        titles.append(title)
        plates += [
            element("h3", title),
            [element("div", captioned[k : k + 4], class_=f"row {across}") for k in range(0, len(drawn), 4)],
        ]
    return Section("Figures", [element("p", said), None if whole else element("p", switch), plates], tuple(titles))


def _captioned(scene: Scene, drawn: Drawn) -> Element:
    figure = drawn.figure
    what = f" {figure.what[0].upper()}{figure.what[1:]}"
    if figure.mapped:
        what = " Without light" if figure.shader == "nolight" else f" {figure.shader.capitalize()} shading"
    elif len(figure.lights) == 1 and "light" in figure.what and len(scene.lights) > 1:
        light = scene.lights[figure.lights[0]]
        what += f", at {vector(light.position)}"
    caption = element(
        "figcaption",
        element("b", f"Figure {figure.number}."),
        f"{what}. ",
        element("span", f"{drawn.first:.1f} ms", class_="soft"),
    )
    return element(
        "figure", _view(drawn.pixels, f"Figure {figure.number}: {figure.title}"), caption, id=f"f{figure.number}"
    )


def _view(pixels: Bytes, about: str, overlay: Markup = None) -> Element:
    """Return a picture of which the object's part is shown."""
    image = element("img", src=data_uri(pixels), alt=about)
    return element("div", element("div", image, overlay, class_="sheet"), class_="view")


# Errors


def _decomposition(content: Content) -> list[Markup]:
    said = [
        "Each cause is the difference of two images in which only that cause differs, from a converged reference to the "
        "figure, so that the differences add up to the total error in every pixel. RMSE is of the linear image, in which "
        "display white is 1; the share is of the total’s mean square, and negative where a cause makes up for others."
    ]
    return [element("p", said), causes(content), element("ul", [element("li", each) for each in notes(content)])]


def _comparisons(content: Content) -> Section:
    columns, rows = content.measured.camera.resolution
    said = (
        f"Each comparison is of the image of figure {18 if content.mapped else 16} with one setting changed, at "
        f"{columns} × {rows} pixels. Differences are of the values that a display shows, clamped to 1, in the channel that "
        "differs most; gray is the object where nothing differs. Blue squares are enlarged below, worst first. Columns, "
        "rows and triangles are counted from 0, rows from the top."
    )
    found = [_comparison(COURSE + 1 + k, each, content) for k, each in enumerate(content.comparisons)]
    titles = tuple(each.approximation.title for each in content.comparisons)
    return Section("What each approximation does", [element("p", said), found], titles)


def _comparison(number: int, found: Comparison, content: Content) -> list[Markup]:
    each = found.approximation
    resolution, part = content.measured.camera.resolution, content.measured_part
    colors = pictures.painted(found.difference, found.covered, found.dark)
    shown_images = (*found.images, colors)
    labels = (*each.names, "difference")
    sheets = [
        element(
            "div",
            element("p", f"{label[0].upper()}{label[1:]}", class_="label"),
            _view(
                image, f"{each.title}: {label}", _squares(found.places, resolution, part) if image is colors else None
            ),
        )
        for label, image in zip(labels, shown_images, strict=True)
    ]
    pixels = resolution[0] * resolution[1]
    measured = (
        f"RMSE {found.rmse:.2g}, largest difference {found.largest:.2g}; {found.changed:,} of {pixels:,} pixels have other "
        "8-bit colors."
    )
    scale = element(
        "div", "0", element("img", src=data_uri(pictures.scale()), alt=""), f"{found.dark:.2g} or more", class_="scale"
    )
    caption = element("figcaption", element("b", f"Figure {number}."), f" {each.title}. {measured}")
    return [
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
            style=_part(resolution, part),
        ),
    ]


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
            element("img", src=data_uri(pictures.enlarged(place.part.of(image))), alt=f"{label}, place {number}")
            for image, label in zip(images, labels, strict=True)
        ],
        element("div", element("b", f"{number}"), f" {place.said}", class_="place"),
        class_="details",
    )
