"""`report --course`: the figures of the course, their times and the causes of their errors on one page."""

import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import listing, run
from pages import parsed, picture

from clshade import course
from clshade.course.demo import TEXTURE, with_texture
from clshade.images import png
from clshade.images.tonemap import tonemap
from clshade.measure.course_report import course_report
from clshade.scene.builtin.scenes import builtin


def small(resolution):
    return builtin("course", level=2, resolution=resolution)


def images(page):
    return {node.attributes["id"]: picture(node.all("img")[0]) for node in page.all("figure")}


def rows(page):
    return {row.all("th")[0].text: [cell.text for cell in row.all("td")] for row in page.all("tr")}


@pytest.mark.long
def test_the_page(opened, capsys, tmp_path):
    scene = small((48, 40))
    path = tmp_path / "h3.npy"
    course.save(with_texture(scene, None), path)
    png.write(tmp_path / TEXTURE, tonemap(scene.meshes[0].material.texture.image, "none"))
    code, said, messages = run(capsys, "report", path, "--course", "-o", tmp_path / "made")
    assert (code, said) == (0, f"wrote {tmp_path / 'made.html'}\n")
    assert any(TEXTURE in line for line in messages)
    assert listing(tmp_path) == [TEXTURE, "h3.npy", "made.html"]
    page = parsed((tmp_path / "made.html").read_bytes())
    shown = images(page)
    assert list(shown) == [f"f{number}" for number in range(1, 20)]
    textured = with_texture(scene, str(tmp_path / TEXTURE))
    for number, shader in ((8, "gouraud"), (16, "phong"), (17, "gouraud"), (19, "nolight")):
        draw = course.render_object_map if number > 16 else course.render_object
        drawn = draw(shader, **course.arguments(textured, textured=number > 16))
        assert np.array_equal(shown[f"f{number}"], tonemap(drawn[::-1].astype(np.float32), "none"))
    errors = rows(page)
    assert [cell.text for cell in page.all("th")[1:5]] == ["figure 8", "figure 16", "figure 17", "figure 18"]
    assert list(errors)[-2:] == ["total", "total of the PNG"]
    assert [text == "-" for text in errors["Gouraud shading"]] == [False, True, False, True]
    assert [text == "-" for text in errors["texture at vertices"]] == [True, True, False, False]
    shares = [float(row[3].partition("(")[2].partition(" %")[0]) for row in errors.values() if "(" in "".join(row[3:])]
    assert sum(shares) == pytest.approx(100.0, abs=0.5)
    assert re.fullmatch(r"Figure 5: gouraud, light 1 only. [\d.]+ ms, then [\d.]+ ms", page.all("figure")[4].text)


@pytest.mark.long
@pytest.mark.parametrize(("lacks", "size", "missing", "columns", "shape"), [
    ("texture", (32, 24), range(17, 20), 2, (12, 16, 3)),
    ("lights", (1, 1), (2, 3, 5, 6, 7, 10, 11, 13, 14, 15), 4, (1, 1, 3)),
])  # fmt: skip
def test_what_a_scene_lacks_is_left_out_and_named(opened, tmp_path, monkeypatch, lacks, size, missing, columns, shape):
    monkeypatch.setattr(course_report, "LARGEST", 16)
    hostile = "<script>alert(1)</script>\x1b\u202e"
    scene = replace(small(size), name=hostile)
    scene = with_texture(scene, None) if lacks == "texture" else replace(scene, lights=())
    page = parsed(course_report.run(scene, hostile, tmp_path / "a.html", "1.2.3").read_bytes())
    assert list(images(page)) == [f"f{number}" for number in range(1, 20) if number not in missing]
    assert {image.shape for image in images(page).values()} == {shape}
    terms = {term.text: value.text for term, value in zip(page.all("dt"), page.all("dd"), strict=True)}
    assert terms[f"no figure {', '.join(map(str, missing))}"] == f"the scene has no {lacks}"
    assert "clshade 1.2.3" in terms["software"]
    assert len(page.all("table")[0].all("th")) - len(rows(page)) == columns
    assert not page.all("script")
    assert not {"\x1b", "\u202e"} & set(page.text)


def test_scenes_that_the_course_cannot_draw_are_refused(tmp_path):
    with pytest.raises(ValueError, match="a color"):
        course_report.run(replace(small((8, 6)), background=None), "course", tmp_path / "a", "")
