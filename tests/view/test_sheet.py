"""Sheets of views: what they show is where the facts say, and as large; and the files of `render --views` and crops."""

import json

import numpy as np
import pytest
from command_line import assert_refused, listing, needs_device, run, without_notices

import clshade
from clshade.errors import InputError
from clshade.images import marks, png
from clshade.pipeline.frame import Frame
from clshade.scene.adjust_camera import named_cameras
from clshade.scene.ground import with_ground
from clshade.scene.model import Mesh, Scene
from clshade.view import sheet as module
from clshade.view.sheet import draw_sheet, sheet_paths

pytestmark = needs_device

SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FAST = {"shader": "nolight", "tonemap": "none"}


def box(resolution=(120, 90)):
    """Return a closed box of 4 x 2 x 1 units about (7, 8, 9), each side of a gray of its own, over nothing."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (4.0, 2.0, 1.0) + (5.0, 7.0, 8.5)
    verts = np.concatenate([corners[list(side)] for side in SIDES])
    colors = np.repeat(np.linspace(0.4, 0.9, 6), 4)[:, None] * np.ones(3)
    faces = [(4 * k + a, 4 * k + b, 4 * k + c) for k in range(6) for a, b, c in ((0, 1, 2), (0, 2, 3))]
    camera = clshade.Camera.from_fov((7, 8, 29), (7, 8, 9), (0, 1, 0), 20.0, resolution)
    return Scene(Mesh(verts, faces, colors), camera, background=0.0, name="box")


@pytest.fixture(scope="module")
def sheet():
    return draw_sheet(box(), ("front", "back", "right", "top", "iso", "camera"), **FAST)


def views(sheet):
    return {fact["name"]: fact for fact in sheet.facts["views"]}


@pytest.mark.long
def test_a_box_of_known_size_spans_the_right_number_of_pixels(sheet):
    """In every parallel view, by the scale that the facts give; in the perspective one, at the focal distance."""
    by_name = views(sheet)
    for name, width, height in (("front", 4, 2), ("back", 4, 2), ("right", 1, 2), ("top", 4, 1)):
        x, y, columns, rows = by_name[name]["covered_box"]
        scale = by_name[name]["units_per_pixel"]
        assert abs(columns - width / scale) <= 1, name
        assert abs(rows - height / scale) <= 1, name
        assert abs(x + columns / 2 - 60) <= 1
        assert abs(y + rows / 2 - 45) <= 1
        assert by_name[name]["coverage"] == columns * rows / (120 * 90)
        assert by_name[name]["scale_holds"] == "everywhere"
    near = by_name["camera"]["units_per_pixel"] * 19.5 / 20.0  # the near side is half a unit nearer
    assert abs(by_name["camera"]["covered_box"][2] - 4 / near) <= 1
    assert by_name["camera"]["scale_holds"] == "at the distance of the focal point"


def test_the_bar_in_the_picture_has_the_length_that_the_box_has_there_and_titles_do_not_overlap(sheet):
    for view in sheet.facts["views"]:
        bar, (x, y, columns, rows) = view["scale_bar"], view["panel"]
        assert bar["pixels"] == pytest.approx(bar["length"] / view["units_per_pixel"], rel=1e-12)
        assert 0.1 * columns < bar["pixels"] <= 0.3 * columns
        left = x - (module._MIN_WIDTH - columns) // 2
        ink = (sheet.picture[y + rows + 2 :, left:][:40, :240] == marks.INK).all(axis=-1)
        longest = max(len(run) for line in ink for run in "".join(".#"[int(pixel)] for pixel in line).split("."))
        assert abs(longest - bar["pixels"]) <= 1
        # White pixels are between a title and the image below, and between panels.
        assert (sheet.picture[: y - 2, max(left - 8, 0) : left - 2][-18:] == 255).all()
        assert (sheet.picture[y - 4 : y - 1, left:][:, :240] == 255).all()
        assert sheet.picture[y - 24 : y - 4, left:][:, :240].min() < 100
    assert views(sheet)["front"]["scale_bar"]["length"] == 1.0


def test_the_panels_are_the_rendered_images(sheet):
    scene = box()
    for name, camera in named_cameras(scene, ("front", "iso")).items():
        view = views(sheet)[name]
        x, y, columns, rows = view["panel"]
        frame = clshade.render(Scene(scene.meshes, camera, background=0.0), shader="nolight", layers="id")
        assert (sheet.picture[y : y + rows, x : x + columns] == frame.to_png8("none")).all()
        assert view["visible_faces"] == len(np.unique(frame["id"])) - 1
        assert view["coverage"] == frame.alpha.mean(dtype=np.float64)


def test_facts(sheet):
    facts = json.loads(json.dumps(sheet.facts, allow_nan=False))
    assert facts["bounding_box"] == {"low": [5, 7, 8.5], "high": [9, 9, 9.5], "center": [7, 8, 9], "size": [4, 2, 1]}
    counts = facts["counts"]
    assert (counts["triangles"], counts["vertices"], counts["positions"], counts["shapes"]) == (12, 24, 8, 1)
    assert (facts["closed"], facts["surface_area"], counts["boundary_edges"]) == (True, 28.0, 0)
    by_name = views(sheet)
    faces = {name: view["visible_faces"] for name, view in by_name.items()}
    assert faces == {**dict.fromkeys(("front", "back", "right", "top", "camera"), 2), "iso": 6}
    again = Scene(box().meshes, clshade.Camera(**by_name["iso"]["camera"]))
    alpha = clshade.render(again, shader="nolight", layers="id").alpha
    assert alpha.mean(dtype=np.float64) == by_name["iso"]["coverage"]


def test_facts_leave_out_a_ground():
    scene = with_ground(box((4, 2)))
    ids = np.array([[0, 1, 7, 13], [13, 12, 200, 14]], np.uint32)
    rgba = np.ones((2, 4, 4), np.float32)
    rgba[0, 1, 3] = 0.5
    frame = Frame(rgba * (ids > 0)[..., None], {"id": ids}, scene, clshade.Settings(), lambda: {"visible": 5})
    facts = module.view_facts("front", frame)
    assert (facts["visible_faces"], facts["covered_box"], facts["coverage"]) == (3, [1, 0, 2, 2], 2.5 / 8)


def test_refused_arguments():
    for views, part in (((), "a sequence of names"), ("front", "a sequence of names"), (("side",), "one of front")):
        with pytest.raises(InputError, match=part):
            draw_sheet(box(), views)
    with pytest.raises(InputError, match="views have at most 268435456 pixels"):
        draw_sheet(box((16384, 16384)), ("front",))
    with pytest.raises(InputError, match="other formats are not written"):
        sheet_paths("sheet.jpg")
    assert [path.name for path in sheet_paths("a/b.c.JSON")] == ["b.c.png", "b.c.json"]


QUADS = ("render", "quads", "--resolution", "40,30", "--shader", "nolight", "--tonemap", "none")


@pytest.mark.long
def test_a_sheet_is_written(folder, capsys):
    code, out, err = run(capsys, *QUADS, "--sheet", "--views", "front,iso", "-o", "s.png")
    assert (code, without_notices("\n".join(err))) == (0, [])
    assert listing(folder) == ["s.json", "s.png"]
    facts = json.loads((folder / "s.json").read_text())
    assert [view["name"] for view in facts["views"]] == ["front", "iso"]
    assert (facts["image"], facts["size"]) == ("s.png", list(png.read("s.png").shape[1::-1]))
    assert out.splitlines()[-1] == "wrote   s.png, s.json"
    code, out, _ = run(capsys, *QUADS, "none.npy", "--sheet", "--views", "front", "--json", "-o", "new/")
    done, failed = json.loads(out)
    assert (code, done["scene"], done["name"], len(done["views"])) == (2, "quads", "quads", 1)
    assert "none.npy" in failed["error"]
    assert listing(folder / "new") == ["quads.json", "quads.png"]


def test_a_sheet_is_written_whole_or_not_at_all(folder, monkeypatch, capsys):
    (folder / "s.json").write_text("earlier")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.png, "encode", fail)
    assert_refused(run(capsys, *QUADS, "--sheet", "--views", "front", "-o", "s"), "s.png", "No space left on device")
    assert listing(folder) == ["s.json"]
    assert (folder / "s.json").read_text() == "earlier"
