"""`report`: errors and times of variants, what the reference is worth, tables, figure, limits of `render`."""

from __future__ import annotations

import argparse
import csv
import io
import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_cli import assert_refused, run

from clshade import exr, png, sampling
from clshade.camera import Camera
from clshade.checks import labels, report, report_figure, report_tables, selecting, study, tables, timing, variants
from clshade.checks import reference as reference_module
from clshade.checks.formats import formats
from clshade.checks.image_errors import rmse
from clshade.checks.labels import Box, placed
from clshade.checks.measuring import measure
from clshade.checks.reference import STEPS, _fits, averaged, reference, tiles
from clshade.checks.selecting import Candidate, select
from clshade.checks.tessellation import loglog_slope, tessellation
from clshade.checks.variants import BASE, base_settings, named, possible, variants_for
from clshade.errors import InputError
from clshade.renderer import render, settle
from clshade.scene import Material, Mesh, Scene, Settings
from clshade.scenes import builtin

SMALL = (64, 48)


def sphere(level: int = 2) -> Scene:
    return builtin("icosphere", level=level, resolution=SMALL)


def triangle() -> Scene:
    """White, unlit, over black; covers 0.4 * 0.7 / 2 of the image, no edge along the pixels."""
    verts = np.array([[-0.2, -0.35, -1.0], [0.2, -0.31, -1.0], [-0.17, 0.35, -1.0]])
    camera = Camera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0), (40, 40))
    material = Material(ka=1.0, kd=0.0, ks=0.0, n=1.0)
    mesh = Mesh(verts, np.array([[0, 1, 2]]), material=material)
    return Scene((mesh,), camera, (), np.ones(3), np.zeros(3), name="triangle")


def area(scene: Scene) -> float:
    """Of the triangle, as a share of the image: its plane is one unit away and one unit wide."""
    (ax, ay, _), (bx, by, _), (cx, cy, _) = scene.meshes[0].verts
    return abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2.0


# The reference


def test_the_reference_approaches_the_covered_area(device):
    scene = triangle()
    found = reference(scene, base_settings(scene), device)
    assert found.rgb.shape == (40, 40, 3)
    assert found.samples == 256
    # About 60 pixels hold an edge; 1/256 px is what vertices are snapped to, and 1/256 a pixel's coverage.
    assert found.rgb.mean() == pytest.approx(area(scene), abs=60 / 40**2 / 256)
    assert 0.0 < found.error < 0.02


def test_more_samples_are_nearer_to_the_reference(device):
    """Points of low discrepancy cover an edge's pixel right to about samples^-0.75: 1/23 from 1 to 64."""
    scene = triangle()
    base = base_settings(scene)
    chosen = named(variants_for(scene, base_settings(scene), device), [BASE, *(f"samples-{n}" for n in (4, 16, 64))])
    measured = measure(scene, chosen, base, device, reference(scene, base, device), frames=1)
    errors = [each.error for each in measured]
    assert all(later < earlier for earlier, later in itertools.pairwise(errors))
    assert loglog_slope((1, 4, 16, 64), errors) == pytest.approx(-0.75, abs=0.2)
    assert errors[0] > 12 * errors[-1]
    assert all(each.arithmetic.passed for each in measured)


def test_the_mean_of_a_larger_image_is_the_mean_of_samples_on_a_grid(device):
    scene = triangle()
    base = base_settings(scene)
    found = averaged(scene, device, base, 4, 1)
    large = render(scene, settings=base, device=device, resolution=(160, 160)).rgb
    assert found[17, 12] == pytest.approx(large[68:72, 48:52].mean(axis=(0, 1)), rel=1e-6)
    assert rmse(found, reference(scene, base, device).rgb) < 0.05


def test_tiles_make_the_same_image(device, monkeypatch):
    """A moved principal point and a smaller plane: only the rounding of vertices to 1/256 px may differ, which moves edges,
    and by so little that none passes a sample's place here."""
    scene = triangle()
    scene = replace(scene, camera=replace(scene.camera, principal=(0.45, 0.6), plane=(1.1, 0.9)))
    whole = averaged(scene, device, base_settings(scene), 2, 4)
    monkeypatch.setattr(reference_module, "TILE", 32)
    assert len(list(tiles(scene.camera, 2))) == 9
    assert whole.std() > 0.1
    assert averaged(scene, device, base_settings(scene), 2, 4) == pytest.approx(whole, abs=1e-12)


def places(scale: int, samples: int) -> set[tuple[float, float]]:
    """Where in a pixel the samples lie of scale x scale pixels in its place."""
    cells = itertools.product(range(scale), repeat=2)
    own = sampling.positions(samples) / 256.0
    return {((i + x) / scale, (j + y) / scale) for i, j in cells for x, y in own.tolist()}


def test_the_reference_samples_where_no_variant_does():
    of_variants = set().union(*(places(1, each.changes.get("samples", 1)) for each in variants.VARIANTS))
    assert len(of_variants) == 1 + 4 + 16 + 64
    for step in STEPS[:-1]:
        assert len(places(*step)) == step[0] ** 2 * step[1]
        assert not places(*step) & of_variants
    assert places(*STEPS[-1]) <= of_variants  # only the last step's error is estimated by it


def test_images_too_large_for_many_samples_have_few():
    """Of the largest image that there is, 4 samples; of a screen's, 64 and more."""

    def steps(resolution):
        scene = builtin("quads", resolution=resolution)
        return [_fits(scene, *step) for step in STEPS[:-1]]

    assert steps((640, 480)) == [True] * 4
    assert steps((1920, 1080)) == [False, True, True, True]
    assert steps((4096, 4096)) == [False, False, False, True]
    assert not any(steps((16384, 16384)))


def test_the_reference_keeps_what_belongs_to_the_scene(device):
    base = Settings.from_preset("course", shader="nolight", cull=True, near=0.5)
    found = reference_module.best_settings(base, device)
    assert (found.ambient, found.shader, found.cull, found.near) == ("plain", "nolight", True, 0.5)
    assert (found.visibility, found.interpolation, found.texture_at) == ("depth", "perspective", "pixel")


# Variants


def test_every_variant_is_another_way_and_names_are_unique():
    names = [each.name for each in variants.VARIANTS]
    assert len(set(names)) == len(names)
    changes = [tuple(sorted(each.changes.items())) for each in variants.VARIANTS]
    assert len(set(changes)) == len(changes)
    assert set(variants.SHORT) <= set(names)


def test_variants_are_those_that_change_something(device):
    plain, textured = (
        {each.name for each in variants_for(builtin(name, resolution=SMALL), Settings(), device)}
        for name in ("quads", "course")
    )
    assert {BASE, "gouraud", "painter", "affine", "course"} <= plain
    assert textured - plain == {"vertex-texture", "trilinear", "trilinear-4", "trilinear-16"}


def test_what_settings_or_device_refuse_is_left_out(device):
    assert possible({"shader": "gouraud"}, Settings(), device)
    assert not possible({"texture_filter": "trilinear"}, Settings(texture_at="vertex"), device)
    assert not possible({"shader": "flat"}, Settings(), device)
    assert not possible({"precision": "float64"}, Settings(), replace(device, has_fp64=False))


def test_the_base_keeps_the_ambient_term():
    assert base_settings(builtin("course")).ambient == "plain"
    assert base_settings(builtin("quads")) == Settings()


def test_unknown_variants(device):
    known = variants_for(sphere(), Settings(), device)
    assert named(known, []) == known
    assert [each.name for each in named(known, ["gouraud", BASE, "gouraud"])] == ["gouraud", BASE]
    with pytest.raises(InputError, match=r"--only: expected names of standard, .*gouraud.* found 'guro'$"):
        named(known, ["guro"])
    with pytest.raises(InputError, match=r"--only: .*found 'vertex-texture', which changes nothing of this scene"):
        named(known, ["vertex-texture"])
    without = variants_for(sphere(), Settings(), replace(device, has_fp64=False))
    with pytest.raises(InputError, match=r"--only: .*found 'float64', which needs a device with float64"):
        named(without, ["float64"])


# Measuring


def test_measured_errors_are_those_of_the_images(device):
    """A planted error in the reference is found, the image's own arithmetic is not blamed for it."""
    scene = sphere()
    base = base_settings(scene)
    own = render(scene, settings=base, device=device).rgb.astype(np.float64)
    planted = replace(reference(scene, base, device), rgb=own + 0.125)
    chosen = named(variants_for(scene, base_settings(scene), device), [BASE, "gouraud"])
    standard, gouraud = measure(scene, chosen, base, device, planted, frames=3)
    assert standard.error == pytest.approx(0.125, rel=1e-6)
    assert gouraud.error != standard.error
    for each in (standard, gouraud):
        assert each.arithmetic.wrong == 0
        assert 0.0 < each.arithmetic.rms < each.arithmetic.error < 1e-5
        assert each.frame_ms.low > 0.0
        assert each.upload_ms > 0.0
    assert (standard.settings, gouraud.settings) == (base, replace(base, shader="gouraud"))


def test_the_root_mean_square_of_the_arithmetic():
    """Not above the largest, and it counts the pixels without error."""
    from clshade import check

    frame = render(sphere())
    found = check(frame, "all")
    assert 0.0 < found.rms < found.error / 2


def test_turns_alternate_and_end():
    seen: list[tuple[str, int]] = []
    draws = [lambda k, name=name: seen.append((name, k)) or k for name in "ab"]
    assert timing.in_turns(draws, 3, seconds=60.0) == [(0, 0), (1, 1), (2, 2)]
    assert seen == [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("a", 2), ("b", 2)]
    assert len(timing.in_turns(draws, 100, seconds=0.0)) == timing.FEWEST
    assert timing.spread([4.0, 1.0, 2.0, 3.0, 5.0]) == (2.0, 3.0, 4.0)


def test_power_laws():
    x = np.array([1.0, 10.0, 40.0, 1000.0])
    assert loglog_slope(x, 7.0 * x**-1.5) == pytest.approx(-1.5)


def test_tessellation(device):
    """Both shadings are of second order in the edge's length, so of first order in the number of triangles, once the
    sphere's highlight, about 20 degrees wide, holds some of them."""
    found = tessellation(device, SMALL)
    gouraud, phong = found.errors["gouraud"], found.errors["phong"]
    assert found.triangles == tuple(20 * 4**level for level in range(7))
    assert found.finest == 20 * 4**7
    assert all(p < g for p, g in zip(phong, gouraud, strict=True))
    assert all(b < a for each in (gouraud, phong) for a, b in itertools.pairwise(each))
    assert loglog_slope(found.triangles[3:], phong[3:]) == pytest.approx(-1.0, abs=0.25)
    assert found.slope("gouraud") == pytest.approx(-0.9, abs=0.25)


def test_formats(device):
    frame = render(sphere(), device=device)
    found = {each.name: each for each in formats(frame)}
    brightest = float(frame.rgb.max())
    assert (found["EXR float"].rmse, found["EXR float"].largest) == (0.0, 0.0)
    assert 0.0 < found["EXR half"].largest <= brightest * 2.0**-11  # half a unit in the last of 11 bits
    assert 0.0 < found["EXR pxr24"].largest <= brightest * 2.0**-16  # 15 bits are kept after the first
    for name in ("EXR half b44", "EXR half dwaa"):
        assert found["EXR half"].rmse < found[name].rmse < 0.1
    # A step of the sRGB curve is at most 2.4/1.055 / 255 wide at white; above it all is lost.
    assert found["PNG 8 bit srgb"].largest <= max(brightest - 1.0 + 0.005, 0.005)
    assert all(each.bytes > 100 and each.write_ms.median > 0.0 for each in found.values())


# Tables and the figure


def test_tables():
    header, rows = ("name", "n"), [("a", "10"), ("long|er", "5")]
    assert tables.as_lines(header, rows) == ["name      n", "a        10", "long|er   5"]
    assert tables.as_markdown(header, rows)[1:] == ["| --- | --- |", "| a | 10 |", "| long\\|er | 5 |"]
    assert list(csv.reader(io.StringIO(tables.as_csv(header, [("a,b", '"')])))) == [["name", "n"], ["a,b", '"']]
    assert (tables.digits(0.00123456), tables.digits(None)) == ("0.00123", "-")


def test_labels_lie_apart():
    """Eighteen names, six of them of points that nearly coincide, with a line through the middle."""
    rng = np.random.default_rng(2)
    points = [*rng.uniform([40, 40], [560, 410], (12, 2)), *(np.array([300.0, 200.0]) + rng.uniform(-6, 6, (6, 2)))]
    sizes = [(w, 11.0) for w in rng.uniform(30, 90, 18)]
    frame, line = Box(0, 0, 600, 450), Box(0, 224, 600, 226)
    boxes = placed([tuple(p) for p in points], sizes, frame, [line])
    dots = [Box(x, y, x + 1e-9, y + 1e-9) for x, y in points]
    for box, size in zip(boxes, sizes, strict=True):
        assert (box.right - box.left, box.top - box.bottom) == pytest.approx(size)
        assert box.overlap(frame) == pytest.approx(box.area)
        assert not box.overlap(line)
        assert not any(box.overlap(dot) for dot in dots)
    assert not any(a.overlap(b) for a, b in itertools.combinations(boxes, 2))


def test_labels_where_there_is_no_room():
    boxes = placed([(5.0, 5.0)] * 3, [(50.0, 50.0)] * 3, Box(0, 0, 10, 10))
    assert len(boxes) == 3


def made_up(found: study.Study, costs: list[tuple[float, float]]) -> study.Study:
    """The study with so many variants of these times and errors."""
    one = found.measured[0]
    error = one.approximation
    measured = [
        replace(
            one,
            variant=replace(one.variant, name=f"variant-{k}"),
            frame_ms=timing.Spread(0.9 * cost, cost, 1.2 * cost),
            approximation=replace(error, rmse=rmse_of),
        )
        for k, (cost, rmse_of) in enumerate(costs)
    ]
    return replace(found, measured=tuple(measured))


@pytest.fixture(scope="session")
def found(device) -> study.Study:
    """A small study; of the sphere's levels only three."""
    scene = sphere()
    chosen = named(variants_for(scene, base_settings(scene), device), [BASE, "gouraud"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "tessellation", lambda device: tessellation(device, SMALL, levels=range(3), finest=4))
        return study.study(scene, device, chosen, 3)


def test_pictures_are_the_ends_of_the_front_and_the_worst(found):
    several = made_up(found, [(5.0, 0.1), (1.0, 0.2), (9.0, 0.01), (2.0, 0.9), (6.0, 0.05), (7.0, 0.4)])
    assert [each.cost for each in several.front] == [1.0, 5.0, 6.0, 9.0]
    names = [each.name for each in study.worth_showing(several.measured)]
    assert names == ["variant-1", "variant-0", "variant-4", "variant-2"]


def test_pictures_are_those_of_the_variants(found):
    scene = sphere()
    for each in found.measured:
        drawn = render(scene, settings=each.settings).rgb
        assert rmse(found.pictures[each.name], found.reference.rgb) == each.error
        assert (found.pictures[each.name] == drawn).all()
    off = report_figure.difference(found.reference.rgb + [0.0, 0.25, -0.5], found.reference.rgb)
    assert off == pytest.approx(np.full(SMALL[::-1], 0.5))


def test_the_slope_of_sampling_is_of_errors_that_the_reference_is_good_enough_for(found):
    known = found.reference.error
    errors = {1: 64.0 * known, 4: 16.0 * known, 16: 4.0 * known, 64: 0.9 * known}
    made = made_up(found, [(float(count), error) for count, error in errors.items()])
    names = [BASE, *(f"samples-{count}" for count in errors if count > 1)]
    measured = tuple(
        replace(each, variant=replace(each.variant, name=name, changes={"samples": count}))
        for each, name, count in zip(made.measured, names, errors, strict=True)
    )
    slope, gain = replace(made, measured=measured).sampling()["samples"]
    assert (slope, gain) == (pytest.approx(-1.0), pytest.approx(16.0))
    assert replace(made, measured=measured[2:]).sampling() == {}


def test_the_figure_names_every_point(found, tmp_path, monkeypatch):
    several = made_up(found, [(1.0 + k, 0.5 / (1 + k)) for k in range(9)] + [(3.0, 0.0)])
    written: list[str] = []
    original = labels.label_points
    monkeypatch.setattr(
        report_figure,
        "label_points",
        lambda axes, x, y, names, lines: written.extend(names) or original(axes, x, y, names, lines),
    )
    report_figure.plot(several, tmp_path / "a.png")
    assert written == [f"variant-{k}" for k in range(10)]
    assert png.read(tmp_path / "a.png").std() > 20.0


# The command


def no_constants(text: str) -> float:
    raise AssertionError(f"{text} is no JSON")


def test_run_writes_all(found, device, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "study", lambda *arguments: found)
    text = io.StringIO()
    options = {"out": tmp_path / "new" / "folder", "stream": text, "budget": 1e6}
    assert report.run(sphere(), device.index, **options)
    folder = tmp_path / "new" / "folder"
    assert {path.name for path in folder.iterdir()} == {"report.csv", "report.json", "report.md", "report.png"}
    figures = json.loads((folder / "report.json").read_text(), parse_constant=no_constants)
    assert [each["variant"] for each in figures["variants"]] == [BASE, "gouraud"]
    assert figures["variants"][0]["approximation"]["rmse"] == found.measured[0].error
    assert figures["use"] == min(found.measured, key=lambda each: each.error).name
    assert figures["machine"] == study.machine()
    rows = list(csv.DictReader((folder / "report.csv").open()))
    assert [row["name"] for row in rows if row["study"] == "variant"] == [BASE, "gouraud"]
    assert float(rows[0]["rmse"]) == found.measured[0].error
    assert {row["study"] for row in rows} == {"variant", "format", "tessellation"}
    shown = text.getvalue()
    for part in (found.device, found.machine, f"use {figures['use']}: ", "PNG 8 bit srgb", "5,120"):
        assert part in shown
        assert part in (folder / "report.md").read_text()


@pytest.fixture
def no_figure(monkeypatch):
    """Drawing it takes seconds."""
    monkeypatch.setattr(report_figure, "plot", lambda study, path: path.touch())


@pytest.mark.parametrize("name", ["course", "teapot", "quads"])
def test_the_options_named_draw_what_was_measured(device, name):
    """Whatever the preset that `render` would take for the scene."""
    from clshade.commands import render as command

    own = builtin(name)
    scene = replace(own, camera=own.camera.with_resolution((48, 36)))
    base = base_settings(scene)
    parser = argparse.ArgumentParser()
    command.add_options(parser)
    for each in variants_for(scene, base, device):
        options = report_tables.render_options(each.settings(base), scene)
        arguments = parser.parse_args([name, *options])
        kept = command._render_options(arguments)
        kept.pop("device")
        again, settings = settle(own, **kept)
        assert settings == each.settings(base), each.name
        assert again.camera.resolution == (48, 36)
    standard = [] if own.preset == "standard" else ["--preset", "standard"]
    assert report_tables.render_options(Settings(), scene)[2:] == standard


@pytest.mark.usefixtures("no_figure")
def test_a_limit_that_nothing_keeps(found, device, tmp_path, monkeypatch):
    """What was measured is there all the same."""
    monkeypatch.setattr(report, "study", lambda *arguments: found)
    with pytest.raises(InputError, match=r"--tolerance: .*reference is good to \(the best, .* has .*\), found 1e-12"):
        report.run(sphere(), device.index, out=tmp_path, tolerance=1e-12, stream=io.StringIO())
    assert (tmp_path / "report.png").exists()
    assert json.loads((tmp_path / "report.json").read_text())["use"] is None


@pytest.mark.usefixtures("no_figure")
def test_wrong_coverage_fails(found, device, tmp_path, monkeypatch):
    one = found.measured[0]
    spoiled = replace(one, arithmetic=replace(one.arithmetic, wrong=1))
    monkeypatch.setattr(report, "study", lambda *arguments: replace(found, measured=(spoiled,)))
    assert not report.run(sphere(), device.index, out=tmp_path, stream=io.StringIO())


@pytest.mark.usefixtures("no_figure")
def test_the_command_line(found, device, capsys, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(report, "study", lambda *arguments: given.append(arguments) or found)
    command = ("report", "icosphere", "--device", device.index, "--out", tmp_path, "--only", BASE, "--frames", "2")
    code, out, err = run(capsys, *command, "--budget", "1000s")
    assert (code, err) == (0, [])
    assert "use " in out
    scene, _, chosen, frames = given[0]
    assert (scene.camera.resolution, [each.name for each in chosen], frames) == ((320, 240), [BASE], 2)
    code, out, err = run(capsys, "report", "--list")
    assert (code, err, out.count("\n")) == (0, [], len(variants.VARIANTS))


REFUSED = [
    (("--only", "guro"), ("--only", "standard", "'guro'")),
    (("--frames", "0"), ("--frames", "0")),
    (("--budget", "0ms"), ("--budget", "'0ms'")),
    (("--budget", "-3"), ("--budget", "'-3'")),
    (("--tolerance", "0"), ("--tolerance", "'0'")),
    (("--budget", "5ms", "--tolerance", "1e-3"), ("--tolerance", "not allowed with", "--budget")),
    (("--resolution", "0,5"), ("resolution", "0")),
    (("--out", "file/x"), ("file/x", "--out")),
]


@pytest.mark.parametrize(("options", "parts"), REFUSED, ids=[" ".join(options) for options, _ in REFUSED])
def test_refused(device, capsys, tmp_path, monkeypatch, options, parts):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    monkeypatch.setattr(report, "study", lambda *arguments: pytest.fail("something was measured"))
    assert_refused(run(capsys, "report", "icosphere", "--device", device.index, *options), *parts)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


# Limits of `render`


@pytest.fixture
def quick(monkeypatch):
    """Three variants, and a reference of 16 samples."""
    monkeypatch.setattr(selecting, "SHORT", (BASE, "samples-4", "gouraud"))
    monkeypatch.setattr(reference_module, "STEPS", ((2, 4), (2, 1), (1, 1)))
    monkeypatch.setattr(selecting, "FRAMES", 2)


@pytest.mark.usefixtures("quick")
def test_render_obeys(device, capsys, tmp_path):
    """The settings that a limit chooses are those of the image that is written."""
    command = ("render", "icosphere", "--device", device.index, "--resolution", "48,36", "-o", tmp_path / "a")
    code, out, err = run(capsys, *command, "--tolerance", "1000", "--stats", "--deterministic")
    assert (code, err) == (0, [])
    chosen = json.loads(out)["chosen"]
    settings = exr.read(tmp_path / "a.exr")[1]["settings"]
    for name, value in chosen["settings"].items():
        assert f"{name}={value}" in settings
    code, out, err = run(capsys, *command, "--budget", "100s", "--near", "0.25")
    assert (code, err) == (0, [])
    assert "\nchosen  samples-4 (samples=4): " in out
    assert "kept as they are: near=0.25\n" in out
    assert "of 3 ways tried" in out
    assert "RMSE" in out


@pytest.mark.long
def test_a_real_study_chooses(device):
    """All of SHORT, a reference of 256 samples; no budget can be kept so surely that it could be asserted."""
    scene = builtin("icosphere", level=2)
    best = select(scene, budget=1e6, device=device, resolution=(48, 36))
    assert set(best.tried) == {"unchanged", *selecting.SHORT} - {BASE, "vertex-texture", "trilinear", "trilinear-4"}
    assert best.used.name == "shaded-16"
    tolerance = 2.0 * best.used.error
    kept = select(scene, tolerance=tolerance, device=device, resolution=(48, 36))
    drawn = render(scene, settings=kept.settings, resolution=(48, 36), device=device)
    assert rmse(drawn.rgb, kept.reference.rgb) == kept.used.error <= tolerance


@pytest.fixture
def unmeasured(monkeypatch, found):
    """Every variant costs and errs the same; the reference's settings are kept."""
    monkeypatch.setattr(selecting, "_tried", lambda scene, each, *_: Candidate(each, 1.0, 0.5))
    monkeypatch.setattr(selecting, "_timed", lambda scene, tried, *_: tried)

    def reference_of(scene, base, device, fixed):
        return replace(found.reference, settings=reference_module.best_settings(base, device, fixed))

    monkeypatch.setattr(selecting, "reference", reference_of)


@pytest.mark.usefixtures("unmeasured")
def test_settings_that_are_given_stay(device):
    chosen = select(sphere(), budget=1e6, device=device, shader="gouraud", samples=2)
    assert (chosen.settings.shader, chosen.settings.samples) == ("gouraud", 2)
    assert (chosen.reference.settings.shader, chosen.reference.settings.samples) == ("gouraud", 1)
    assert chosen.kept == ("samples", "shader")
    assert not any(name.startswith(("gouraud", "samples")) for name in chosen.tried)


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("given", [{"scene": sphere(), "preset": "course"}, {"scene": builtin("course")}])
def test_a_preset_stays(device, given):
    """Whether it is asked for or the scene's own: what is chosen and the reference are drawn as the course says."""
    chosen = select(**given, budget=1e6, device=device, near=0.25)
    course = Settings.from_preset("course", near=0.25)
    assert chosen.settings == chosen.used.variant.settings(course)
    for name in selecting.preset_fields():
        assert getattr(chosen.settings, name) == getattr(chosen.reference.settings, name) == getattr(course, name)
    assert selecting.preset_fields() == {"visibility", "lighting_at", "interpolation", "texture_at", "ambient"}
    assert set(chosen.kept) == {*selecting.preset_fields(), "near"}
    assert "unchanged" in chosen.tried
    assert "gouraud" in chosen.tried
    assert not {"course", "vertex-texture", BASE} & set(chosen.tried)


def test_only_what_may_be_chosen_is_timed(found):
    one = found.measured[0].variant
    tried = [Candidate(one, *each) for each in ((2.0, 0.5), (5.0, 0.1), (9.0, 0.02), (100.0, 0.01))]
    assert selecting.worth_timing(tried, 5.0, None) == tried[:3]
    assert selecting.worth_timing(tried, 0.1, None) == tried[:1]
    assert selecting.worth_timing(tried, None, 0.1) == tried[1:3]
    assert selecting.worth_timing(tried, None, 0.001) == tried[3:]


@pytest.mark.usefixtures("quick")
def test_render_refuses_what_nothing_keeps(device, capsys, tmp_path):
    command = ("render", "icosphere", "--device", device.index, "--resolution", "48,36", "-o", tmp_path / "a")
    assert_refused(run(capsys, *command, "--tolerance", "1e-30"), "--tolerance", "the best, ", "found 1e-30")
    assert_refused(run(capsys, *command, "--budget", "1us"), "--budget", "the fastest, ", "found 0.001 ms")
    assert not list(tmp_path.iterdir())
