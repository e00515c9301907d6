"""`report --course`: the figures of the course, their errors and times on one page."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from command_line import assert_refused, listing, run
from pages import parsed, picture

from clshade import course
from clshade.course import figures as plan
from clshade.course.demo import TEXTURE
from clshade.images import png
from clshade.images.tonemap import tonemap
from clshade.measure.course_report import comparisons, content, page, pictures
from clshade.measure.course_report.pictures import Part
from clshade.measure.course_report.triangles import affine_shift, half_angle, measured
from clshade.measure.course_report.wording import coefficient, figures, listed, percent, rounded, vector
from clshade.measure.report.decomposition import Part as Cause
from clshade.pipeline.opencl.device import shared_device
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Texture

HOSTILE = "<script>alert(1)</script><img src=x onerror=x>'\"&\x1b[31m\u202e"


def small(**options):
    return builtin("course", **{"level": 2, "resolution": (48, 40), **options})


def with_texture(scene, texture):
    mesh = scene.meshes[0]
    return replace(scene, meshes=(replace(mesh, material=replace(mesh.material, texture=texture)),))


@pytest.fixture(scope="module")
def gathered(opened):
    """Return the content of a small page; of the figures with all lights only Phong's are decomposed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(content, "DECOMPOSED", (16, 18))
        return content.gather(small(), shared_device())


@pytest.fixture(scope="module")
def found(gathered):
    return parsed(page.html(gathered, "1.2.3"))


def named(found, name):
    (node,) = (each for each in found.all() if each.attributes.get("id") == name)
    return node


# The page


@pytest.mark.long
def test_the_figures_are_those_of_the_courses_functions(found):
    """Pixel by pixel: nothing is cut off what the page holds."""
    for number in range(1, 20):
        (image,) = named(found, f"f{number}").all("img")
        assert picture(image).shape == (40, 48, 3)
        assert named(found, f"f{number}").text.startswith(f"Figure {number}.")
    for number, shader in ((16, "phong"), (8, "gouraud")):
        drawn = course.render_object(shader, **course.arguments(small()))
        (image,) = named(found, f"f{number}").all("img")
        assert np.array_equal(picture(image), tonemap(drawn[::-1].astype(np.float32), "none"))
    drawn = course.render_object_map("nolight", **course.arguments(small(), textured=True))
    (image,) = named(found, "f19").all("img")
    assert np.array_equal(picture(image), tonemap(drawn[::-1].astype(np.float32), "none"))


@pytest.mark.long
def test_the_mesh_is_drawn_as_lines_on_white(found, gathered):
    """Magnified by a whole number, as part of the page; the lines are where the object is, or a pixel beside it."""
    (image,) = (each for each in found.all("img") if each.attributes["alt"] == "Edges of the mesh")
    lines, part = picture(image), gathered.part
    times = lines.shape[1] // part.width
    assert lines.shape == (times * part.height, times * part.width, 3)
    assert 8 <= times <= pictures.MOST // max(part.width, part.height)
    assert (lines[0, 0] == 255).all()
    drawn = (lines < 128).any(axis=2)
    assert 0.01 < drawn.mean() < 0.5
    frame = render(small(), preset="course", samples=16)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(part.of(frame.alpha), 1), (3, 3)).max(axis=(2, 3)) > 0.0
    assert not (drawn & ~np.kron(near, np.ones((times, times), bool))).any()


@pytest.mark.long
def test_the_page_refers_to_nothing_outside_itself(found):
    for node in found.all():
        assert node.tag not in ("script", "link", "iframe", "object", "base", "form")
        assert not [name for name in node.attributes if name.startswith("on")]
        for name, value in node.attributes.items():
            if name in ("src", "href"):
                assert value.startswith(("data:image/png;base64,", "#")), value[:40]
    (style,) = found.all("style")
    assert "url(" not in style.text
    assert "@import" not in style.text


@pytest.mark.long
def test_every_entry_of_the_contents_leads_to_a_heading(found):
    names = {node.attributes["id"] for node in found.all() if "id" in node.attributes}
    entries = [node.attributes["href"] for node in found.all("nav")[0].all("a")]
    assert {entry[1:] for entry in entries} <= names
    headings = [node for node in found.all() if node.tag in ("h2", "h3")]
    assert [f"#{node.attributes['id']}" for node in headings] == entries
    assert len(names) == sum("id" in node.attributes for node in found.all())


@pytest.mark.long
def test_the_tables_hold_what_was_measured(found, gathered):
    """The decompositions are those of `report`; times, settings and versions are there."""
    assert list(gathered.decompositions) == [16, 18]
    for number, each in gathered.decompositions.items():
        assert each.settings.shader == "phong", number
        assert sum(part.share for part in each.parts if part.share is not None) == pytest.approx(1.0)
    rows = {row.all("th")[0].text: [cell.text for cell in row.all("td")] for row in found.all("tr")}
    assert rows["total"][::2] == [rounded(each.total) for each in gathered.decompositions.values()]
    assert len(rows["painter’s order"]) == 4
    (times,) = (table for table in found.all("table") if table.attributes.get("class") == "times")
    assert len(times.all("tr")) == 20
    assert "clshade 1.2.3" in rows["Software"][0]
    assert "visibility painter" in rows["Figures"][0]


@pytest.mark.long
def test_the_parts_that_are_shown_hold_the_object(gathered):
    covered = render(gathered.scene, device=shared_device()).alpha > 0.0
    assert gathered.part.of(covered).sum() == covered.sum()


@pytest.mark.long
@pytest.mark.parametrize("word", [HOSTILE, "a" * 300])
def test_names_are_escaped(gathered, found, word):
    hostile = with_texture(replace(small(), name=word), replace(small().meshes[0].material.texture, name=word))
    tags = parsed(page.html(replace(gathered, scene=hostile), ""))
    assert [node.tag for node in tags.all()] == [node.tag for node in found.all()]
    assert not {"\x1b", "\u202e"} & set(tags.text)
    assert word[:8] in tags.all("h1")[0].text


def lacking(scene, lacks):
    return with_texture(scene, None) if lacks == "texture" else replace(scene, lights=())


LEFT_OUT = {
    "texture": ("Figures 17 to 19 are left out: the scene has no texture.", range(17, 20)),
    "lights": (
        "Figures 2, 3, 5 to 7, 10, 11 and 13 to 15 are left out: the scene has no lights.",
        (2, 3, 5, 6, 7, 10, 11, 13, 14, 15),
    ),
}


def assert_left_out(found, lacks):
    said, numbers = LEFT_OUT[lacks]
    assert said in found.text
    ids = {node.attributes.get("id") for node in found.all()}
    assert [number for number in range(1, 20) if f"f{number}" not in ids] == [*numbers]


@pytest.mark.long
@pytest.mark.parametrize("lacks", LEFT_OUT)
def test_what_a_scene_lacks_is_left_out_and_named(gathered, lacks):
    scene = lacking(gathered.scene, lacks)
    drawable, missing = plan.possible(scene)
    numbers = [each.number for each in drawable]
    drawn = tuple(each for each in gathered.figures if each.figure.number in numbers)
    changed = replace(gathered, scene=scene, figures=drawn, missing=tuple(missing), comparisons=())
    assert_left_out(parsed(page.html(changed, "")), lacks)


@pytest.mark.long
@pytest.mark.parametrize("lacks", LEFT_OUT)
def test_a_scene_that_lacks_something_is_measured(opened, lacks):
    gathered = content.gather(lacking(small(resolution=(8, 6)), lacks), shared_device())
    assert_left_out(parsed(page.html(gathered, "")), lacks)
    fields = [each.approximation.field for each in gathered.comparisons]
    assert ("texture_at" in fields) == (lacks != "texture")
    assert list(gathered.decompositions) == [8, 16] + [17, 18] * (lacks != "texture")
    assert [each.settings.shader for each in gathered.decompositions.values()][:2] == ["gouraud", "phong"]


@pytest.mark.long
@pytest.mark.parametrize("seen", ["nothing", "one pixel"])
def test_images_of_little(opened, monkeypatch, seen):
    monkeypatch.setattr(content, "DECOMPOSED", (16, 18))
    scene = small(resolution=(1, 1) if seen == "one pixel" else (8, 6))
    if seen == "nothing":
        camera = scene.camera
        scene = replace(scene, camera=replace(camera, lookat=2.0 * np.asarray(camera.eye) - camera.lookat))
    gathered = content.gather(scene, shared_device())
    found = parsed(page.html(gathered, ""))
    assert {f"f{number}" for number in range(1, 25)} <= {node.attributes.get("id") for node in found.all()}
    if seen == "nothing":
        assert all(not each.places and each.rmse == 0.0 for each in gathered.comparisons)
        assert found.text.count("No triangle is visible.") == len(gathered.comparisons) == 5


def test_other_scenes_are_refused():
    for scene, expected in (
        (builtin("teapot"), "expected a course scene"),
        (replace(small(), background=None), "a color"),
    ):
        with pytest.raises(ValueError, match=expected):
            content.check(scene)


@pytest.mark.long
def test_the_summary_names_causes_that_add_to_the_error(gathered):
    """Not one that makes up for others, nor one that is next to nothing."""
    whole = gathered.decompositions[18]

    def said(*shares):
        parts = [Cause(f"cause {k}", 0.1, share, share) for k, share in enumerate(shares)]
        return page._summary(replace(gathered, decompositions={18: replace(whole, parts=tuple(parts))}))

    assert said(1.2, -0.2).endswith("The largest share of its mean square is that of cause 0 (120 %).")
    assert said(0.004, 0.996).endswith("that of cause 1 (100 %).")
    assert said(0.3, 0.2, 0.5).endswith(
        "The largest shares of its mean square are those of cause 2 (50 %) and cause 0 (30 %)."
    )


# Comparisons


@pytest.mark.long
def test_a_triangle_that_painters_order_shows_wrongly(opened, monkeypatch):
    """A long triangle leans away: its mean depth is less than that of a small one, which is nearer where both are."""
    long = [[-3.0, -1.0, 8.0], [-3.0, 1.0, 8.0], [3.0, 0.0, -4.0]]
    short = [[1.6, -0.4, 0.0], [1.6, 0.4, 0.0], [2.4, 0.0, 0.0]]
    corners, texture = np.arange(6).reshape(2, 3), Texture(np.eye(3)[None, :2], lookup="course")
    material = replace(small().meshes[0].material, texture=texture)
    uvs, normals = np.repeat([[0.0, 0.0], [1.0, 0.0]], 3, axis=0), np.tile([0.0, 0.0, 1.0], (6, 1))
    mesh = Mesh(np.array(long + short), corners, normals=normals, uvs=uvs, material=material)
    camera = Camera((0.0, 0.0, 12.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (0.8, 0.8), (96, 96))
    scene = replace(small(), meshes=(mesh,), camera=camera)
    wrong, right = (
        render(scene, preset="course", visibility=visibility, layers=("id", "Z"), device=shared_device())["id"]
        for visibility in ("painter", "depth")
    )
    apart = (wrong != right).sum()
    assert set(wrong[wrong != right]) == {1}
    monkeypatch.setattr(comparisons, "APPROXIMATIONS", comparisons.APPROXIMATIONS[:1])
    (found,) = comparisons.compare(scene, shared_device(), 16)
    assert (found.difference > 0.0).sum() == apart > 0
    assert found.why.startswith(f"Here {apart} of the {(right > 0).sum():,} pixels")
    assert "triangle 0, of mean depth 8.00000, covers triangle 1, of mean depth 12.0000" in found.places[0].said
    assert sum(place.part.of(found.difference > 0.0).sum() for place in found.places) == apart


DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")


def tonemapped_apart(each):
    """Return what two images are apart, to within 8 bits."""
    return each.images[0] / 255.0 - each.images[1] / 255.0


@pytest.mark.long
def test_comparisons_change_one_setting(gathered):
    for each in gathered.comparisons:
        for value, image in zip(each.approximation.values, each.images, strict=True):
            changed = {each.approximation.field: value, "layers": ("id", "Z")}
            frame = render(small(), preset="course", device=shared_device(), **changed)
            assert np.array_equal(image, tonemap(frame.rgb, "none"))
        assert each.changed == (each.images[0] != each.images[1]).any(axis=2).sum()
        assert each.largest <= 1.0
        off = tonemapped_apart(each)
        assert each.rmse == pytest.approx(np.sqrt(np.square(off).mean()), abs=0.003)
        for place in each.places:  # the RMSE of all channels, as of the whole, by which they are ordered
            said = float(place.said.partition("RMSE ")[2].partition(",")[0].replace(" × 10⁻", "e-").translate(DIGITS))
            assert said == pytest.approx(np.sqrt(np.square(place.part.of(off)).mean()), abs=0.004)


def test_what_is_measured_of_triangles(opened):
    """A square seen from the front, whose corners' normals are the same; texels by its texture coordinates."""
    verts = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    uvs = (verts[:, :2] + 1.0) / 4.0
    texture = Texture(np.ones((8, 16, 3)), lookup="course")
    mesh = Mesh(verts, np.array([[0, 1, 2], [0, 2, 3]]), uvs=uvs, material=Material(texture=texture))
    camera = replace(small().camera, eye=(0.0, 0.0, 4.0), lookat=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    scene = replace(small(), meshes=(mesh,), camera=camera, lights=())
    found = measured(scene, np.array([[1, 2, 0]], np.uint32))
    assert np.allclose(found.depths, 4.0)
    assert np.allclose(found.mean_depths, 4.0)
    assert (found.turns == 0.0).all()
    assert np.allclose(found.texels, 0.5 * (16 / 2) * (8 / 2))
    center, corner = np.array([1.0, -1.0, 0.0]) / 3.0, np.array([-1.0, -1.0, 0.0])
    to = [camera.eye - each for each in (center, corner)]
    angle = math.degrees(math.acos(to[0] @ to[1] / math.sqrt((to[0] @ to[0]) * (to[1] @ to[1]))))
    assert found.light_turns == pytest.approx([angle, angle])


@pytest.mark.parametrize("ratio", [1.0, 1.01, 1.5, 4.0])
def test_the_shift_of_affine_interpolation(ratio):
    t = np.linspace(0.0, 1.0, 100_001)
    assert affine_shift(ratio) == pytest.approx(np.abs(t - t / (t + ratio * (1.0 - t))).max(), abs=1e-9)


def test_the_half_angle_of_a_highlight():
    assert half_angle(1.0) == pytest.approx(60.0)
    assert math.cos(math.radians(half_angle(20.0))) ** 20 == pytest.approx(0.5)


# Pictures


def test_the_worst_parts():
    error = np.zeros((60, 80))
    error[10:14, 20:24] = 1.0
    error[40:44, 60:64] = 2.0
    error[43, 50] = 0.5
    assert pictures.worst_parts(error, 8, 3) == [Part(58, 38, 8, 8), Part(18, 8, 8, 8), Part(46, 40, 8, 8)]
    assert len(pictures.worst_parts(error, 8, 2)) == 2
    assert pictures.worst_parts(np.zeros((4, 4)), 8, 3) == []
    assert pictures.worst_parts(error[:3, 50:51] + 1.0, 8, 3) == [Part(0, 0, 1, 3)]
    crowded = pictures.worst_parts(np.random.default_rng(0).random((30, 30)), 10, 6)
    shown = np.zeros((30, 30), int)
    for part in crowded:
        part.of(shown)[...] += 1
    assert shown.max() == 1


def test_the_part_with_the_object():
    covered = np.zeros((200, 100), bool)
    covered[50:100, 40:45] = True
    part = pictures.part_with(covered)
    assert part.of(covered).sum() == 250
    assert (part.width, part.height) == (33, 54)
    covered[:] = True
    assert pictures.part_with(covered) == Part(0, 0, 100, 200)
    assert pictures.part_with(np.zeros((3, 2), bool)) == Part(0, 0, 2, 3)
    edge = np.zeros((100, 100), bool)
    edge[:3, 97:] = True
    part = pictures.part_with(edge)
    assert part.of(edge).all() or part.of(edge).sum() == 9
    assert part.left + part.width == 100


def test_colors_of_differences():
    difference = np.array([[0.0, 0.0, 0.1, 1.0, 2.0]])
    colors = pictures.painted(difference, np.array([[False, True, True, True, True]]), 1.0).astype(int)
    assert (colors[0, 0] == 255).all()
    assert (colors[0, 1] == pictures.OBJECT).all()
    assert colors[0, 2].sum() > colors[0, 3].sum()
    assert (colors[0, 3] == colors[0, 4]).all()


def test_large_pictures_are_reduced():
    assert pictures.reduced_size((4096, 1024)) == (1024, 256)
    assert pictures.reduced_size((512, 300)) == (512, 300)
    assert pictures.reduced(np.zeros((16, 2048, 3), np.uint8)).shape == (8, 1024, 3)
    assert pictures.enlarged(np.zeros((30, 20, 3), np.uint8)).shape == (390, 260, 3)


# Words


def test_numbers_as_people_write_them():
    assert [rounded(value) for value in (0.0238, 1.234e-5, 0.5)] == ["0.0238", "1.23 × 10⁻⁵", "0.5"]
    assert [rounded(value, 2) for value in (123.4, -987.0, 2.5e7)] == ["120", "-990", "2.5 × 10⁷"]
    assert [percent(value) for value in (0.4123, 1.0, 12.34, 0.0712, -0.25)] == [
        "41 %",
        "100 %",
        "1234 %",
        "7.1 %",
        "-25 %",
    ]
    assert vector(np.array([-7.0, 0.5, 0.0])) == "(−7, 0.5, 0)"
    assert (coefficient(np.full(3, 0.2)), coefficient(np.array([0.1, 0.2, 0.3]))) == ("0.2", "(0.1, 0.2, 0.3)")
    assert [listed("abc"[:count]) for count in range(4)] == ["", "a", "a and b", "a, b and c"]
    assert figures((7,)) == "Figure 7"
    assert figures((2, 3, 5, 6, 7, 17)) == "Figures 2, 3, 5 to 7 and 17"


# The command


@pytest.fixture
def saved(tmp_path):
    """Return a course file without a texture, and with one beside it."""
    scene = small(resolution=(16, 12))
    course.save(with_texture(scene, None), tmp_path / "h3.npy")
    png.write(tmp_path / TEXTURE, tonemap(scene.meshes[0].material.texture.image, "none"))
    return tmp_path / "h3.npy"


@pytest.mark.long
def test_the_command(opened, saved, capsys, monkeypatch):
    """The texture of the course that lies beside the scene is used."""
    monkeypatch.setattr(content, "DECOMPOSED", (16, 18))
    out = saved.parent / "made"
    code, said, told = run(capsys, "report", saved, "--course", "-o", out)
    assert (code, said) == (0, f"wrote {out}.html\n")
    assert any(TEXTURE in line for line in told)
    found = parsed((saved.parent / "made.html").read_bytes())
    assert named(found, "f17").all("img")
    assert "h3" in found.all("title")[0].text
    assert listing(saved.parent) == [TEXTURE, "h3.npy", "made.html"]


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("teapot", "--course"), "--course: expected a course scene"),
        (("course", "--course", "-o", "a.pdf"), "a browser prints the page as PDF"),
        (("course", "--course", "-o", "no/a.html"), "there is no folder"),
        (("course", "--course", "-o", "."), "a folder"),
        (("course", "--course", "--only", "fast"), "--only: cannot go with --course"),
        (("course", "--course", "--budget", "5ms"), "--budget: cannot go with --course"),
        (("course", "--course", "--no-shadows"), "--no-shadows: cannot go with --course"),
        (("course", "--course", "--light-samples", "4"), "--light-samples: cannot go with --course"),
        (("missing.npy", "--course"), "missing.npy"),
    ],
)
def test_bad_input_is_one_line(capsys, tmp_path, monkeypatch, words, part):
    monkeypatch.chdir(tmp_path)
    assert_refused(run(capsys, "report", *words), part)
    assert listing(tmp_path) == []


@pytest.mark.long
def test_a_course_scene_of_people(opened, data_folder, tmp_path, capsys):
    """The whole page at the scene's own size."""
    out = tmp_path / "cat.html"
    assert run(capsys, "report", data_folder / "cat.npy", "--course", "-o", out)[0] == 0
    found = parsed(out.read_bytes())
    assert {f"f{number}" for number in range(1, 25)} <= {node.attributes.get("id") for node in found.all()}
    assert picture(named(found, "f18").all("img")[0]).shape == (512, 512, 3)
    assert out.stat().st_size < 4_000_000
