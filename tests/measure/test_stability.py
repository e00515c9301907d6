"""`stability`: every case passes and can fail; curves of scenes that grow stiff; causes of a scene's errors; the command."""

import csv
import itertools
import json
from dataclasses import replace
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest
from command_line import needs_device, run

from clshade import oracle
from clshade.images import exr, figures
from clshade.measure.stability import causes, curves, scene_figure, scene_stability, scene_study, stability
from clshade.measure.stability.cases import Bench, Case, Outcome, all_cases, lit
from clshade.measure.stability.cases.light import exact_highlights, in_the_lobe
from clshade.measure.stability.curves import AXES, PLAIN
from clshade.oracle import shade
from clshade.pipeline.frame import Frame
from clshade.pipeline.renderer import render
from clshade.scene.camera import Camera
from clshade.scene.model import DirectionalLight, Material, Mesh, PointLight, Scene, Settings, SpotLight, Texture

CASES = {case.name: case for case in all_cases()}
EXPONENT = AXES[0]


class Spoiled(Bench):
    """A bench with an error planted in all its results, a different one in every call."""

    calls = 0

    def draw(self, scene, **options):
        frame = super().draw(scene, **options)
        self.calls += 1
        rgba, layers = frame.rgba.copy(), {name: frame[name].copy() for name in frame.layers}
        rows, columns = layers["id"].shape
        at = (self.calls * 7) % rows, (self.calls * 11) % columns
        rgba[at] = 7.0, 7.0, 7.0, 1.0 - rgba[at][3]
        layers["id"][at] += 1
        return Frame(rgba, layers, frame.scene, frame.settings, lambda: frame.stats)

    def highlights(self, *arguments):
        return super().highlights(*arguments) * np.float32(1.25) + np.float32(1e-3)


every_case = pytest.mark.parametrize(
    "case", [pytest.param(case, id=name, marks=[pytest.mark.long] * case.slow) for name, case in CASES.items()]
)


@pytest.mark.long
@every_case
def test_every_case_passes(device, case):
    outcome = case.run(Bench(device, triangles=2000))
    assert outcome.passed, outcome


@pytest.mark.sampled
@every_case
def test_every_case_can_fail(device, case, tmp_path):
    """An image wrong in one pixel, light off by a quarter: found by the cases affected, and drawn."""
    outcome = case.run(Spoiled(device, triangles=2000))
    assert not outcome.passed
    written = stability.write_pictures(stability.Result(case, device.index, outcome, 0.0), tmp_path)
    assert len(written) == (3 if outcome.pictures else 0)


@pytest.mark.long
def test_errors_are_as_in_theory(device, monkeypatch):
    monkeypatch.setattr(curves, "SIDE", 48)
    monkeypatch.setattr(curves, "FRAMES", 2)
    some = [replace(axis, values=(1.0, 1e3, 1e6)) for axis in AXES]
    rows = [curves.measure(axis, value, device) for axis in some for value in axis.values]
    for row in rows:
        assert set(row.ms) == set(row.rms) - {PLAIN}
        assert all(row.wrong[way] == 0 and row.ms[way] > 0.0 for way in row.ms)
        assert row.rms.get("float64", 0.0) < row.axis.own_error(row.value)
    errors = {axis.name: [row.rms for row in rows if row.axis is axis] for axis in some}
    first, _, last = (rms["standard"] for rms in errors["exponent"])
    assert 100.0 < last / first < 1e4  # sqrt(n) is 1000
    assert last < 1e-4
    distances = [rms["standard"] for rms in errors["distance"]]
    assert distances == pytest.approx(distances[:1] * 3, rel=0.05)
    assert errors["exponent"][2][PLAIN] > 0.02  # no digit is left
    assert errors["distance"][2][PLAIN] > 1e3 * errors["distance"][0][PLAIN]
    assert errors["aspect"][2][PLAIN] > 2.0 * errors["aspect"][2]["standard"] > 1e-5
    assert errors["nearness"][2]["standard"] > 1e4 * errors["nearness"][0]["standard"]
    tables = curves.results(rows, "$device$")
    assert max(map(len, "\n".join(tables.lines()).splitlines())) <= 100
    assert len(tables.tables[0].csv().splitlines()) == 13
    low, high = curves.figure(rows, "$device$").axes[0].get_ylim()
    assert low < high


@pytest.mark.parametrize("n", [1.0, 1e4, 1e9])
def test_the_oracle_s_own_error_of_a_highlight(n):
    pytest.importorskip("mpmath")
    points, normals, light = in_the_lobe(n, 60)
    values = shade.specular(shade.Directions.at(points, normals, np.zeros(3), light), np.float64(n))
    assert np.abs(values - exact_highlights(points, normals, light, n)).max() < EXPONENT.own_error(n)


def made_up(name: str, **outcome) -> Case:
    return Case("1", name, "nothing", "all is well", Mock(**outcome))


def test_a_failing_case_shows_pictures_and_why(monkeypatch, device, capsys, tmp_path):
    rgb = np.random.default_rng(1).uniform(0, 1e3, (5, 7, 3))
    nan = np.where(np.arange(7)[None, :, None] == 3, np.nan, rgb)
    ids = np.arange(35).reshape(5, 7)
    shown = (
        made_up("good", return_value=[Outcome()]),
        made_up("colors", return_value=[Outcome(0, 40.0, 32.0, "bounds", pictures=(nan, rgb))]),
        made_up("ids", return_value=[Outcome(2, pictures=(ids, ids * 0))]),
        made_up("broken", side_effect=ValueError("two\nlines")),
    )
    monkeypatch.setattr(stability, "all_cases", lambda: shown)
    monkeypatch.setattr(stability, "devices", lambda name: [device, device])
    monkeypatch.setattr(stability.importlib.util, "find_spec", lambda name: None)
    assert not stability.run(out=tmp_path / "new", names=[case.name for case in shown])
    out = capsys.readouterr().out
    assert "8 of 4 cases: 2 passed, 6 failed" in out
    assert "40 of 32 bounds" in out
    assert "broken: expected of nothing: all is well; ValueError: two lines" in out
    assert "mpmath is not installed (pip install" in out
    written = {(path.stem.split("-")[0], path.stem.split("-")[-1]) for path in (tmp_path / "new").glob("*.png")}
    assert written == set(itertools.product(("colors", "ids"), ("rendered", "expected", "difference")))
    rows = list(csv.DictReader((tmp_path / "new" / "stability.csv").open()))
    assert [row["verdict"] for row in rows] == 2 * ["pass", "FAIL", "FAIL", "FAIL"]
    assert rows[1]["stressed"] == "nothing"


@pytest.mark.long
def test_the_command_line(monkeypatch, capsys, tmp_path, device):
    assert run(capsys, "stability", "--list")[1].count("\n") == len(CASES)
    chosen = ["stability", "--device", device.index, "--out", tmp_path / "out", "--case", "equal-depth", "22b"]
    code, out, _ = run(capsys, *chosen)
    assert (code, "2 of 2 cases: 2 passed" in out) == (0, True)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {f"stability.{x}" for x in ("csv", "json", "md")}
    monkeypatch.setattr(stability, "Bench", Spoiled)
    assert run(capsys, *chosen)[0] == 1
    assert len(list((tmp_path / "out").glob("equal-depth-*.png"))) == 3


@pytest.mark.long
def test_the_whole_command(tmp_path, device, monkeypatch):
    monkeypatch.setattr(curves, "FRAMES", 1)
    monkeypatch.setattr(stability, "all_cases", lambda: (CASES["equal-depth"],))
    assert stability.run(device.index, out=tmp_path, formats=("png", "pdf"))
    assert (tmp_path / "curves.png").stat().st_size > 50_000
    assert (tmp_path / "curves.pdf").read_bytes().startswith(b"%PDF")
    assert len(json.loads((tmp_path / "stability.json").read_text())["cases"]) == 1


# Causes of the errors of a scene

STANDARD = Settings.from_preset("standard")
CALM = Material(n=1.0)
TRIANGLE = [[-1, -1, 0], [1, -1, 0], [0, 1, 0]]


def sheet(material: Material = CALM, **fields) -> Mesh:
    return lit.patch(material=material, **fields)


def scene_of(mesh: Mesh, lamp=(3.0, 4.0, 5.0), eye=(0.0, 0.0, 5.0), lookat=(0.0, 0.0, 0.0), **fields) -> Scene:
    camera = Camera(eye, lookat, (0.0, 1.0, 0.0), 1.3, (1.0, 1.0), (61, 61))
    return Scene((mesh,), camera, **{"lights": (PointLight(np.array(lamp), np.ones(3)),), "name": "planted", **fields})


def one(verts, normals=None, **fields) -> Scene:
    """Return a triangle; a sheet has colors, too: the scenes share their programs."""
    return scene_of(Mesh(verts, [[0, 1, 2]], [[0.9, 0.8, 0.7]] * 3, normals=normals, material=CALM), **fields)


def far_texture() -> Scene:
    image = np.random.default_rng(3).uniform(0.2, 1.0, (2, 4096, 3)).astype(np.float32)
    mesh = sheet(Material(n=1.0, texture=Texture(image)), bend=0.0)
    return scene_of(replace(mesh, uvs=mesh.verts[:, :2] + 1e5))


def far_away(distance: float = 1e10, change=lambda verts: {}) -> Scene:
    """Return a sheet, the eye and the light away from the origin. change: returns fields of the mesh."""
    scene = lit.shifted(scene_of(sheet()), 1.0, distance)
    (mesh,) = scene.meshes
    return replace(scene, meshes=(replace(mesh, **change(mesh.verts)),))


FAR = np.eye(4)
FAR[:3, 3] = 1e10
LIGHT_ON_THE_SURFACE = scene_of(sheet(), (0.1, 0.1, 0.1487))
PLANTED = [  # cause, part of why, scene
    ("light", "light 0 is ", LIGHT_ON_THE_SURFACE),
    ("eye", "the eye is 0.0", scene_of(sheet(), eye=(0.01, 0.02, 0.152), lookat=(0.01, 0.02, 0.0))),
    ("needle", "1e+04 away from the eye", one([[-1, -1, 0], [1e4, 0, 0], [-1, 1, 0]])),
    ("normals", "their mean has the length 0.0", one(TRIANGLE, [[1, 0, 0.01], [-1, 0, 0.01], [0, 0, 1]])),
    ("exponent", "n = 1e+06", scene_of(sheet(Material(n=1e6)))),
    # The mirrored light is nearly perpendicular to the direction to the eye.
    ("steepness", "n = 0.25", scene_of(sheet(Material(n=0.25), bend=0.0), (1e3, 0.0, 0.1))),
    ("texture", "1e+05, 4.1e+08 of the texture's 4096 texels", far_texture()),
    ("origin", "1e+10 from the origin", far_away()),
    ("origin", "1e+10 from the origin", far_away(change=lambda _: {"verts": sheet().verts, "instances": FAR[None]})),
    ("origin", "its float32 coordinates", far_away(1e5, lambda verts: {"verts": verts.astype(np.float32)})),
    # N.L is 0 exactly, and the highlight behind the gate is bright.
    ("grazing", "N.L or R.V", scene_of(sheet(bend=0.0), (-20.0, 0.0, 0.0), eye=(3.0, 0.0, 1.0))),
]
assert {row[0] for row in PLANTED} == set(causes.CAUSES)


@pytest.mark.sampled
@pytest.mark.parametrize(("name", "part", "scene"), PLANTED)
def test_a_planted_cause_is_named(device, name, part, scene):
    study = scene_study.study(scene, STANDARD, device)
    assert study.check.passed
    worst = study.worst[0]
    assert worst.cause == name, worst.factors
    assert part in worst.why
    assert set(worst.factors) == set(causes.CAUSES)
    assert worst.error <= worst.bound
    assert study.frame["id"][worst.row, worst.column] == worst.face + 1
    assert np.allclose(worst.point, study.frame["P"][worst.row, worst.column])


@pytest.mark.long
def test_a_cone_is_named_with_its_light(device):
    """The edge of a cone without width amplifies by 2000; a light from infinitely far is nobody's cause, nor a dark one."""
    lamp = SpotLight((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), (1, 1, 1), 5.0, 5.0)
    dark = PointLight((0.1, 0.1, 0.15), np.zeros(3))
    scene = replace(LIGHT_ON_THE_SURFACE, lights=(dark, DirectionalLight((0, 0, -1)), lamp))
    worst = scene_study.study(scene, STANDARD, device).worst[0]
    assert worst.cause == "light"
    assert worst.why.startswith("light 2 is ")
    assert "cone and attenuation amplify that " in worst.why


def changed(frame: Frame, rgba=None, **settings) -> Frame:
    layers = {name: frame[name] for name in frame.layers}
    pixels = frame.rgba if rgba is None else rgba
    return Frame(pixels, layers, frame.scene, replace(frame.settings, **settings), lambda: frame.stats)


@pytest.fixture(scope="module")
def calm_frame(device):
    scene = scene_of(sheet(Material(n=30.0)))
    scene = replace(scene, meshes=(*scene.meshes, sheet(Material(n=3e4), bend=0.9)))
    return render(scene, settings=replace(STANDARD, layers=("Z", "id")), device=device)


@pytest.mark.parametrize("shader", ["phong", "gouraud"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_factors_make_the_bound(calm_frame, shader, precision):
    """Their product, without what is in no bound, is the bound: that of the settings, whatever was drawn."""
    frame = changed(calm_frame, shader=shader, precision=precision)
    compared = scene_study.compare(frame, np.arange(frame.alpha.size))
    of = causes.factors(compared, causes.visible_faces(compared))
    assert all((factor >= 1.0).all() for factor in of.values())
    assert not np.allclose(of["exponent"], 1.0)
    covered = compared.oracle.id > 0
    unit = compared.allowed * (1e-12 if precision == "float64" else 2.0**-24)
    bound = causes.amplification(of) / of["origin"] * unit
    assert np.allclose(bound[covered], compared.expected[covered], rtol=1e-12)
    assert np.allclose(causes.amplification(of)[~covered], 1.0)


def test_the_maps_are_those_of_the_oracle(device):
    scene = scene_of(sheet(), (0.1, 0.1, 0.2))
    study = scene_study.study(scene, STANDARD, device)
    expected = oracle.render(scene, STANDARD)
    covered = expected.id > 0
    assert 0.1 < covered.mean() < 0.9
    assert (study.kappa[~covered] == 0.0).all()
    assert np.allclose(study.kappa[covered], expected.kappa[covered], rtol=1e-6)
    error = np.abs(study.frame.rgb - expected.rgb)[covered] / expected.budget[covered]
    assert np.allclose(study.error[covered], error.max(axis=1), rtol=1e-6)
    assert (study.share * study.check.allowed).max() == pytest.approx(study.check.bounds, rel=1e-6)
    largest, half = expected.kappa[covered].max(), (expected.kappa[covered] <= study.quantiles()["median"] * (1 + 1e-6))
    assert study.quantiles()["max"] == pytest.approx(largest, rel=1e-6)
    assert half.mean() == pytest.approx(0.5, abs=1e-3)
    assert study.worst[0].kappa == pytest.approx(largest)


@pytest.mark.long
def test_a_light_exactly_at_a_visible_point(device):
    scene = one(TRIANGLE, lamp=(0.0, 0.0, 0.0), eye=(0.0, 0.0, 4.0))
    worst = scene_study.study(replace(scene, camera=scene.camera.with_resolution((33, 25))), STANDARD, device).worst[0]
    assert (worst.row, worst.column, worst.cause) == (12, 16, "light")
    assert np.isinf([worst.kappa, worst.bound]).all()


def test_the_worst_pixels_are_spread_and_a_large_image_is_sampled(device, monkeypatch):
    full = scene_study.study(LIGHT_ON_THE_SURFACE, STANDARD, device)
    assert [pixel.number for pixel in full.worst] == [*range(1, scene_study.WORST + 1)]
    at = np.array([(pixel.row, pixel.column) for pixel in full.worst])
    apart = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) + np.eye(len(at)) * 1e3
    assert apart.min() > max(map(np.ptp, np.nonzero(full.kappa))) / scene_study.SPREAD > 3.0
    amplified = [pixel.bound for pixel in full.worst]
    assert amplified == sorted(amplified, reverse=True)
    monkeypatch.setattr(scene_study, "EVERY", 100)
    monkeypatch.setattr(scene_study, "SAMPLED", 900)
    study = scene_study.study(LIGHT_ON_THE_SURFACE, STANDARD, device)
    assert study.check.pixels == 900
    assert "900 of 3,721 pixels: a sample" in "\n".join(scene_stability.summarize(study, "").lines())
    unknown = np.isnan(study.kappa)
    assert (~unknown).sum() >= 900
    assert (study.frame.alpha[unknown] == 1.0).all()
    assert np.array_equal(study.kappa[~unknown], full.kappa[~unknown])


def spoiled(monkeypatch, amounts: dict[tuple[int, int], float]) -> None:
    def wrong(scene, **options):
        frame = render(scene, **options)
        rgba = frame.rgba.copy()
        for place, amount in amounts.items():
            rgba[(*place, 1)] += amount
        return changed(frame, rgba)

    monkeypatch.setattr(scene_study, "render", wrong)


def drawn(study: scene_study.SceneStudy, values: np.ndarray) -> np.ndarray:
    image = scene_figure.draw_map(figures.blank(1, 1).add_subplot(), study, values, "magma", (1e-5, 1.0))
    return image.to_rgba(image.get_array(), bytes=True)


def test_a_planted_error_is_the_worst(device, monkeypatch):
    """The figure shows it in a color of its own, which no pixel has without an error beyond its bound. A pixel of NaN is
    infinitely wrong."""
    measured = partial(scene_study.study, scene_of(sheet()), STANDARD, device)
    right = measured()
    assert {(pixel.cause, pixel.why) for pixel in right.worst} == {(causes.NONE, "nothing amplifies rounding 4 times")}
    spoiled(monkeypatch, {(20, 33): 1e-3})
    study = measured()
    marked = [(drawn(case, case.share)[..., :3] == (255, 32, 32)).all(axis=-1) for case in (right, study)]
    assert not marked[0].any()
    assert np.argwhere(marked[1]).tolist() == [[20, 33]]
    assert np.array_equal(drawn(right, 0.0 * right.kappa)[..., 3] == 255, right.kappa > 0.0)  # also without any error
    worst = study.worst[0]
    assert 0.9 < study.within < right.within == 1.0
    assert (worst.row, worst.column) == (20, 33)
    assert worst.error > worst.bound
    assert study.share[20, 33] == study.share.max() > 1.0
    assert scene_stability.summarize(study, "").facts["result"].startswith("FAILED: largest error")
    spoiled(monkeypatch, {(20, 33): 1e-3, (0, 0): np.nan})
    study = measured()
    worst = study.worst[0]
    assert (worst.row, worst.column, worst.face, worst.why) == (0, 0, -1, "nothing belongs here")
    assert np.isposinf(study.error[0, 0])
    assert json.loads(scene_stability.summarize(study, "").json())["worst_pixels"][0]["error"] is None


def test_figures_keep_the_worst_of_reduced_pixels():
    values = np.full((5, 8), np.nan)
    values[0, 1], values[4, 7], values[2, 2], values[3, 3] = 3.0, 7.0, 1.0, 2.0
    reduced = scene_figure.reduced(values, 2)
    assert reduced.shape == (3, 4)
    assert (reduced[0, 0], reduced[2, 3], reduced[1, 1]) == (3.0, 7.0, 2.0)
    assert np.isnan(reduced[0, 3])
    assert np.array_equal(scene_figure.reduced(values, 1), values, equal_nan=True)


@pytest.fixture
def command(capsys, tmp_path, monkeypatch):
    blank = figures.blank
    monkeypatch.setattr(figures, "blank", lambda width, height: blank(width, height, dpi=40))
    return partial(run, capsys, "stability", "quads", "--out", tmp_path / "o", "--resolution")


@needs_device
@pytest.mark.long
def test_the_command_of_a_scene(command, tmp_path, monkeypatch):
    code, out, err = command("32x24")
    assert code == 0, err
    assert "quads, 64 triangles, 32x24" in out
    assert "768 of 768 pixels: all" in out
    assert max(map(len, out.splitlines()[:-5])) <= 100
    folder = tmp_path / "o"
    written = {f"stability.{kind}" for kind in ("csv", "json", "md", "png", "exr")}
    assert {path.name for path in folder.iterdir()} == written
    assert all(f"o/{name}" in out for name in written)
    data = json.loads((folder / "stability.json").read_text())
    assert (data["passed"], data["within"], data["settings"]["precision"]) == (True, 1.0, "float32")
    rows = list(csv.DictReader((folder / "stability.csv").open()))
    assert [float(row["kappa"]) for row in rows] == [pixel["kappa"] for pixel in data["worst_pixels"]]
    reasons = {(row["cause"], row["n"], float(row["exponent_factor"])) for row in rows}
    assert reasons == {("exponent", "20.0", np.sqrt(20.0))}
    channels, _ = exr.read(folder / "stability.exr")
    assert channels["kappa"].max() == pytest.approx(data["kappa"]["max"])
    assert (channels["relativeError"] <= channels["relativeBound"]).all()
    spoiled(monkeypatch, {(3, 3): 1.0})
    code, out, err = command("32x24")
    assert (code, "FAILED" in out) == (1, True), err


@pytest.mark.long
@needs_device
@pytest.mark.parametrize("size", ["8,6", "1,1"])
def test_images_of_little(command, tmp_path, size):
    away = ("--camera-position", "0,0,50", "--camera-focal-point", "0,0,100") if size == "8,6" else ()
    code, out, err = command(size, *away)
    assert code == 0, err
    assert ("nothing is visible" in out) == (size == "8,6")
    assert (tmp_path / "o" / "stability.csv").read_text().count("\n") == (1 if size == "8,6" else 2)
    assert (tmp_path / "o" / "stability.png").stat().st_size > 1000
