"""The page: its sections, numbered figures and tables, from what was drawn and measured."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from importlib import resources
from typing import NamedTuple
from xml.etree.ElementTree import Element

from ...base.atomic_files import shown
from ...base.markup import Content as Markup
from ...base.markup import element, page
from ...course.figures import Missing
from ...scene.model import Scene
from . import wording
from .content import Content
from .plates import captioned, comparison, shown_part, wireframe
from .tables import causes, facts, lights, notes, times, versions
from .wording import listed, percent, rounded

NEGLIGIBLE = 0.01  # shares of the error that a summary leaves out
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
        style=shown_part(content.scene.camera.resolution, content.part),
    )
    style = resources.files(__package__).joinpath("style.css").read_text(encoding="utf-8")
    return page(title, style, body)


def _about(scene: Scene) -> str:
    columns, rows = scene.camera.resolution
    count = len(scene.lights)
    return f"{scene.face_count:,} triangles, {count or 'no'} light{'s' * (count != 1)}, {columns} × {rows} pixels"


def _summary(content: Content) -> str:
    """Return how long the figures took, how far off the last one is, and mainly why."""
    number = max(n for n in content.decompositions if n != 17)
    found = content.decompositions[number]
    seconds = sum(each.first for each in content.figures) / 1e3
    said = f"{len(content.figures)} figures, drawn in {rounded(seconds, 2)} s."
    if not found.total:
        return f"{said} Figure {number} has no error."
    shares = sorted(((part.share or 0.0, part.cause) for part in found.parts), reverse=True)[:2]
    named = [f"{cause} ({percent(share)})" for share, cause in shares if share > NEGLIGIBLE]
    verb = "shares of its mean square are those" if len(named) > 1 else "share of its mean square is that"
    return (
        f"{said} Figure {number} is off by an RMSE of {rounded(found.total, 2)} (display white is 1) from the same scene "
        f"drawn without approximations. The largest {verb} of {listed(named)}."
    )


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
    found: list[Markup] = [facts(content.scene), lights(content.scene), said]
    return found if content.wireframe is None else [*found, wireframe(content.scene, content.wireframe)]


def _remarks(scene: Scene, missing: Sequence[Missing]) -> list[str]:
    """Return what the figures cannot show, as sentences without their ends."""
    found = [
        f"{wording.figures(each.numbers)} {'is' if len(each.numbers) == 1 else 'are'} left out: {each.why}"
        for each in missing
    ]
    if scene.meshes[0].colors is None:
        found.append("The scene has no vertex colors: figures 1 to 16 show it white")
    if len(scene.lights) > 3:
        found.append("The course has figures for the first three lights; those of all lights show the others too")
    return found


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
    switch = element("label", element("input", type="checkbox", id="whole"), "show the whole images", for_="whole")
    plates: list[Markup] = []
    titles = []
    for first, end, title in PLATES:
        drawn = [each for each in content.figures if first <= each.figure.number < end]
        if not drawn:
            continue
        across = "three" if len(drawn) == 3 else "four"
        plate = [captioned(content.scene, each) for each in drawn]
        titles.append(title)
        grid = [element("div", plate[k : k + 4], class_=f"row {across}") for k in range(0, len(plate), 4)]
        plates.append(element("article", element("h3", title), grid))
    return Section(
        "Figures", [element("p", said), None if whole else element("p", switch, class_="whole"), plates], tuple(titles)
    )


# Errors


def _decomposition(content: Content) -> list[Markup]:
    said = [
        "Each cause is the difference of two images in which only that cause differs, from a converged reference to the "
        "figure, so that the differences add up to the total error in every pixel. RMSE is of the linear image, in which "
        "display white is 1; the share is of the total’s mean square, and negative where a cause makes up for others."
    ]
    found = element("article", element("p", said), causes(content))
    return [found, element("ul", [element("li", each) for each in notes(content)])]


def _comparisons(content: Content) -> Section:
    columns, rows = content.measured.camera.resolution
    said = (
        f"Each comparison is of the image of figure {18 if content.mapped else 16} with one setting changed, at "
        f"{columns} × {rows} pixels. Differences are of the values that a display shows, clamped to 1, in the channel that "
        "differs most; gray is the object where nothing differs. Blue squares are enlarged below, worst first. Columns, "
        "rows and triangles are counted from 0, rows from the top."
    )
    found = [
        comparison(COURSE + 1 + k, each, content.measured.camera.resolution, content.measured_part)
        for k, each in enumerate(content.comparisons)
    ]
    titles = tuple(each.approximation.title for each in content.comparisons)
    return Section("What each approximation does", [element("p", said), found], titles)
