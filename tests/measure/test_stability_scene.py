"""`stability SCENE`: planted causes are named, kappa and errors are the oracle's, and the command's output and files."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import assert_refused, needs_device, run

from clshade import oracle
from clshade.images import exr, figures
from clshade.measure.stability import causes, scene_figure, scene_stability, scene_study, scene_tables
from clshade.measure.stability.cases import lit
from clshade.oracle import shade
from clshade.pipeline.frame import Frame
from clshade.pipeline.renderer import render
from clshade.scene.camera import Camera
from clshade.scene.model import DirectionalLight, Material, Mesh, PointLight, Scene, Settings, SpotLight, Texture

STANDARD = Settings.from_preset("standard")
CALM = Material(n=1.0)
COLORS = [[0.9, 0.8, 0.7]] * 3  # a sheet has some too: the scenes share their programs
LAMP = PointLight(np.array([3.0, 4.0, 5.0]), np.ones(3))


def camera(eye, lookat=(0.0, 0.0, 0.0)) -> Camera:
    return Camera(np.array(eye), np.array(lookat), np.array([0.0, 1.0, 0.0]), 1.3, (1.0, 1.0), (61, 61))


def scene_of(*meshes: Mesh, lamp: PointLight = LAMP, eye=(0.0, 0.0, 5.0), lookat=(0.0, 0.0, 0.0)) -> Scene:
    return Scene(meshes, camera(eye, lookat), lights=(lamp,), name="planted")


def sheet(material: Material = CALM, **fields) -> Mesh:
    return lit.patch(material=material, **fields)


def flat(material: Material) -> Mesh:
    return sheet(material, bend=0.0)


def light_on_the_surface() -> Scene:
    return scene_of(sheet(), lamp=replace(LAMP, position=np.array([0.1, 0.1, 0.1487])))


def eye_at_the_surface() -> Scene:
    return scene_of(sheet(), eye=(0.01, 0.02, 0.152), lookat=(0.01, 0.02, 0.0))


def needle() -> Scene:
    return scene_of(Mesh([[-1, -1, 0], [1e4, 0, 0], [-1, 1, 0]], [[0, 1, 2]], COLORS, material=CALM))


def opposite_normals() -> Scene:
    verts, normals = [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[1, 0, 0.01], [-1, 0, 0.01], [0, 0, 1]]
    return scene_of(Mesh(verts, [[0, 1, 2]], COLORS, normals=normals, material=CALM))


def large_exponent() -> Scene:
    return scene_of(sheet(Material(n=1e6)))


def exponent_below_one() -> Scene:
    """The mirrored light is nearly perpendicular to the direction to the eye."""
    return scene_of(flat(Material(n=0.25)), lamp=replace(LAMP, position=np.array([1e3, 0.0, 0.1])))


def far_texture() -> Scene:
    image = np.random.default_rng(3).uniform(0.2, 1.0, (2, 4096, 3)).astype(np.float32)
    mesh = flat(Material(n=1.0, texture=Texture(image)))
    return scene_of(replace(mesh, uvs=mesh.verts[:, :2] + 1e5))


def far_away() -> Scene:
    return lit.shifted(scene_of(sheet()), 1.0, 1e10)


def far_away_in_float32() -> Scene:
    scene = lit.shifted(scene_of(sheet()), 1.0, 1e5)
    return replace(scene, meshes=tuple(replace(mesh, verts=mesh.verts.astype(np.float32)) for mesh in scene.meshes))


def placed_far_away() -> Scene:
    """The mesh's own coordinates are small."""
    scene = far_away()
    moved = np.eye(4)
    moved[:3, 3] = 1e10
    return replace(scene, meshes=(replace(sheet(), instances=moved[None]),))


def light_in_the_plane() -> Scene:
    """N.L is 0 exactly, and the highlight behind the gate is bright."""
    return scene_of(flat(CALM), lamp=replace(LAMP, position=np.array([-20.0, 0.0, 0.0])), eye=(3.0, 0.0, 1.0))


PLANTED = {
    light_on_the_surface: ("light", "light 0 is "),
    eye_at_the_surface: ("eye", "the eye is 0.0"),
    needle: ("needle", "1e+04 away from the eye"),
    opposite_normals: ("normals", "their mean has the length 0.0"),
    large_exponent: ("exponent", "n = 1e+06"),
    exponent_below_one: ("steepness", "n = 0.25"),
    far_texture: ("texture", "1e+05, 4.1e+08 of the texture's 4096 texels"),
    far_away: ("origin", "1e+10 from the origin"),
    placed_far_away: ("origin", "1e+10 from the origin"),
    far_away_in_float32: ("origin", "its float32 coordinates"),
    light_in_the_plane: ("grazing", "N.L or R.V"),
}


LONG = (large_exponent, exponent_below_one, far_texture)  # they need programs of their own


@pytest.mark.sampled
@pytest.mark.parametrize(
    "plant",
    [pytest.param(plant, marks=pytest.mark.long) if plant in LONG else plant for plant in PLANTED],
    ids=lambda plant: plant.__name__,
)
def test_a_planted_cause_is_named(device, plant):
    name, part = PLANTED[plant]
    found = scene_study.study(plant(), STANDARD, device)
    assert found.passed
    worst = found.worst[0]
    assert worst.cause == name, worst.factors
    assert part in worst.why
    assert set(worst.factors) == set(causes.CAUSES)
    assert worst.found <= worst.expected
    assert found.frame["id"][worst.row, worst.column] == worst.face + 1
    assert np.allclose(worst.point, found.frame["P"][worst.row, worst.column])


def test_a_calm_scene_has_no_cause(device):
    found = scene_study.study(scene_of(sheet()), STANDARD, device)
    assert {each.cause for each in found.worst} == {causes.NONE}
    assert {each.why for each in found.worst} == {"nothing amplifies rounding four times"}


def test_the_figure_shows_the_causes_that_the_table_names():
    assert causes.bits_lost([1.0, 3.9, 4.0, 32.0, np.inf]).tolist() == [0.0, 0.0, 2.0, 5.0, 64.0]
    for factor in (3.9, 4.0):
        of = dict.fromkeys(causes.CAUSES, 1.0) | {"normals": factor}
        assert (causes.cause_of(of) == causes.NONE) == (causes.bits_lost([of["normals"]]) == 0.0)


def test_every_cause_is_planted_and_has_a_sentence():
    assert {name for name, _ in PLANTED.values()} == set(causes.CAUSES)
    assert set(causes._SENTENCES) == {*causes.CAUSES, causes.NONE}


def test_the_terms_of_kappa():
    point, eye, lights = np.array([[0.0, 0, -4.5]]), np.zeros(3), np.array([[0.0, 0, -4], [0, 0, -9]])
    terms = shade.conditions(point, np.array([5.0]), np.array([0.5]), eye, lights, steepness=3.0)
    assert np.allclose(terms, [[2.0, 5 / 4.5, 10.0, 3.0]])
    assert np.allclose(shade.condition_number(terms), 30.0)
    terms = shade.conditions(point, np.array([5.0]), np.array([0.5]), eye, lights[:0], parallel=True)
    assert np.allclose(terms, [[2.0, 0.0, 0.0, 1.0]])


def replace_settings(frame: Frame, settings: Settings) -> Frame:
    layers = {name: frame[name] for name in frame.layers}
    return Frame(frame.rgba, layers, frame.scene, settings, lambda: frame.stats)


@pytest.fixture(scope="module")
def calm_frame(device):
    scene = scene_of(sheet(Material(n=30.0)), sheet(Material(n=3e4), bend=0.9))
    return render(scene, settings=replace(STANDARD, layers=("Z", "id")), device=device)


@pytest.mark.sampled
@pytest.mark.parametrize("shader", ["phong", "gouraud"])
@pytest.mark.parametrize("precision", ["float32", "fast", "float64"])
def test_the_factors_make_the_bound(calm_frame, shader, precision):
    """Their product, without what is in no bound, is the bound: that of the settings, whatever was drawn."""
    frame = replace_settings(calm_frame, replace(calm_frame.settings, shader=shader, precision=precision))
    scene = frame.scene
    found = scene_study.compare(frame, np.arange(frame.alpha.size))
    of = causes.factors(found, scene_study._seen(found), scene, frame.settings)
    assert all((each >= 1.0).all() for each in of.values())
    assert not np.allclose(of["exponent"], 1.0)
    covered = found.oracle.id > 0
    unit = found.allowed * (1e-12 if precision == "float64" else 2.0**-24)
    bound = causes.amplification(of) / of["origin"] * unit
    assert np.allclose(bound[covered], found.expected[covered], rtol=1e-12)
    assert np.allclose(causes.amplification(of)[~covered], 1.0)


# The study


def test_the_maps_are_those_of_the_oracle(device):
    scene = scene_of(sheet(), lamp=replace(LAMP, position=np.array([0.1, 0.1, 0.2])))
    found = scene_study.study(scene, STANDARD, device)
    expected = oracle.render(scene, STANDARD)
    covered = expected.id > 0
    assert found.kappa.shape == found.found.shape == found.expected.shape == (61, 61)
    assert 0.1 < covered.mean() < 0.9
    assert (found.kappa[~covered] == 0.0).all()
    assert (found.kappa[covered] >= 1.0).all()
    assert np.allclose(found.kappa[covered], expected.kappa[covered], rtol=1e-6)
    error = np.abs(found.frame.rgb - expected.rgb)[covered] / expected.budget[covered]
    assert np.allclose(found.found[covered], error.max(axis=1), rtol=1e-6)
    assert (found.share <= 1.0).all()
    largest = found.share * found.check.allowed
    assert largest.max() == pytest.approx(found.check.bounds, rel=1e-6)
    known = np.sort(expected.kappa[covered])
    assert found.quantiles()["max"] == pytest.approx(known[-1], rel=1e-6)
    assert found.quantiles()["median"] == pytest.approx(np.median(known), rel=1e-6)
    assert known[-1] == pytest.approx(found.worst[0].kappa)


@pytest.mark.long
def test_a_light_exactly_at_a_visible_point(device):
    """There kappa and what is expected are infinite; it is the worst pixel, and the light's doing."""
    mesh = Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]], material=CALM)
    scene = scene_of(mesh, lamp=replace(LAMP, position=np.zeros(3)), eye=(0.0, 0.0, 4.0), lookat=(0.0, 0.0, 0.0))
    odd = replace(scene, camera=scene.camera.with_resolution((33, 25)))
    found = scene_study.study(odd, STANDARD, device)
    worst = found.worst[0]
    assert (worst.row, worst.column) == (12, 16)
    assert np.isinf([worst.kappa, worst.expected]).all()
    assert worst.cause == "light"


def test_no_light_is_another_picture(device):
    """Not an approximation that another setting would better."""
    found, _ = scene_study.alternatives(replace(STANDARD, shader="nolight"), device)
    assert "standard" not in found
    found, _ = scene_study.alternatives(replace(STANDARD, shader="gouraud"), device)
    assert found["standard"].shader == "phong"


def test_the_worst_pixels_are_spread(device):
    found = scene_study.study(light_on_the_surface(), STANDARD, device)
    assert len(found.worst) == scene_study.WORST
    at = np.array([(each.row, each.column) for each in found.worst])
    apart = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) + np.eye(len(at)) * 1e3
    drawn = np.nonzero(found.kappa)
    assert apart.min() > max(map(np.ptp, drawn)) / scene_study.SPREAD > 3.0
    amplified = [each.expected for each in found.worst]
    assert amplified == sorted(amplified, reverse=True)


def spoiled(monkeypatch, row: int, column: int, amount: float) -> None:
    """Plant an error in one pixel of float32 frames."""

    def wrong(scene, **options):
        frame = render(scene, **options)
        if frame.settings.precision == "float64":
            return frame
        rgba = frame.rgba.copy()
        rgba[row, column, 1] += amount
        layers = {name: frame[name] for name in frame.layers}
        return Frame(rgba, layers, frame.scene, frame.settings, lambda: frame.stats)

    monkeypatch.setattr(scene_study, "render", wrong)


@pytest.fixture
def no_figures(monkeypatch):
    """Skip the figures, which take a second each."""
    for name in ("plot", "plot_kappa"):
        monkeypatch.setattr(scene_figure, name, lambda study, path: path.touch())


@pytest.fixture
def coarse_figures(monkeypatch):
    """Draw the figures with few pixels."""
    blank = figures.blank
    monkeypatch.setattr(figures, "blank", lambda width, height: blank(width, height, dpi=40))


@pytest.mark.usefixtures("no_figures")
def test_a_planted_error_is_the_worst(device, monkeypatch, tmp_path):
    spoiled(monkeypatch, 20, 33, 1e-3)
    found = scene_study.study(scene_of(sheet()), STANDARD, device)
    assert not found.passed
    assert 0.9 < found.within < 1.0
    worst = found.worst[0]
    assert (worst.row, worst.column) == (20, 33)
    assert worst.found > worst.expected
    assert worst.others["float64"][0] < 1e-12
    assert found.share[20, 33] == found.share.max() > 1.0
    assert "FAILED: largest error" in scene_tables.lines(found)[-1]
    assert not scene_stability.run(scene_of(sheet()), STANDARD, device.index, out=tmp_path, stream=io.StringIO())


def test_wrong_pixels_are_infinitely_wrong(device, monkeypatch):
    spoiled(monkeypatch, 0, 0, np.nan)
    found = scene_study.study(scene_of(sheet()), STANDARD, device)
    assert (found.worst[0].row, found.worst[0].column, found.worst[0].face) == (0, 0, -1)
    assert np.isposinf(found.found[0, 0])
    assert found.stats()["worst"][0]["found"] is None


def test_a_large_image_is_sampled(device, monkeypatch):
    """And the tiles where the sample found the most are looked at completely."""
    scene = light_on_the_surface()
    whole = scene_study.study(scene, STANDARD, device)
    for name, value in (("EVERY", 100), ("SAMPLED", 900), ("TILE", 8), ("TILES", 2)):
        monkeypatch.setattr(scene_study, name, value)
    found = scene_study.study(scene, STANDARD, device)
    assert 900 < found.check.pixels < 900 + 2 * 64 + 1
    assert "a sample, and where it found" in "\n".join(scene_tables.lines(found))
    unknown = np.isnan(found.kappa)
    assert (~unknown).sum() >= found.check.pixels
    assert (found.frame.alpha[unknown] == 1.0).all()
    assert np.array_equal(found.kappa[~unknown], np.where(unknown, 0, whole.kappa)[~unknown])
    worst = found.worst[0]
    assert worst.kappa == whole.worst[0].kappa
    row, column = worst.row // 8 * 8, worst.column // 8 * 8
    assert not unknown[row : row + 8, column : column + 8].any()


def test_other_settings_are_those_that_may_help(device):
    with_double, without = SimpleNamespace(has_fp64=True), SimpleNamespace(has_fp64=False)
    assert list(scene_study.alternatives(STANDARD, with_double)[0]) == ["float64"]
    others, notes = scene_study.alternatives(Settings.from_preset("course", precision="fast"), without)
    assert list(others) == ["float32", "standard"]
    assert (others["float32"].precision, others["standard"].lighting_at) == ("float32", "position")
    assert notes == ("float64 was not drawn: the device has none",)
    assert scene_study.alternatives(replace(STANDARD, precision="float64"), with_double) == ({}, ())


def test_float64_gains_digits(device):
    if not device.has_fp64:
        pytest.skip("no float64")
    found = scene_study.study(light_on_the_surface(), STANDARD, device)
    for each in found.worst:
        error, expected = each.others["float64"]
        assert error <= expected < 1e-4 * each.expected
    lines = "\n".join(scene_tables.lines(found))
    assert "float64: largest error there" in lines


# Files and figures


@pytest.mark.long
@pytest.mark.usefixtures("coarse_figures")
def test_files(device, tmp_path):
    text = io.StringIO()
    assert scene_stability.run(light_on_the_surface(), STANDARD, device.index, out=tmp_path / "new", stream=text)
    names = {"stability.csv", "stability.json", "stability.md", "stability.png", "kappa.png", "stability.exr"}
    assert {path.name for path in (tmp_path / "new").iterdir()} == names
    shown = text.getvalue()
    assert all(f"new/{name}" in shown for name in names)
    assert "light near the surface" in shown
    assert max(map(len, shown.splitlines()[:-6])) <= 100
    found = json.loads((tmp_path / "new" / "stability.json").read_text())
    assert found["passed"] is True
    assert (found["scene"], found["resolution"], found["within"]) == ("planted", [61, 61], 1.0)
    assert found["pixels"]["checked"] == found["pixels"]["of"] == 61 * 61
    assert found["kappa"]["max"] > 100.0 > found["kappa"]["median"] > 1.0
    assert found["worst"][0]["cause"] == "light"
    rows = list(csv.DictReader((tmp_path / "new" / "stability.csv").open()))
    assert [float(row["kappa"]) for row in rows] == [each["kappa"] for each in found["worst"]]
    assert (tmp_path / "new" / "stability.md").read_text().count("light near the surface") >= 1
    channels, _ = exr.read(tmp_path / "new" / "stability.exr")
    assert channels["kappa"].shape == (61, 61)
    assert channels["kappa"].max() == pytest.approx(found["kappa"]["max"])
    assert (channels["kappa"][channels["A"] == 0.0] == 0.0).all()
    assert (channels["found"] <= channels["expected"]).all()


def test_figures_keep_the_worst_of_reduced_pixels():
    values = np.full((5, 8), np.nan)
    values[0, 1], values[4, 7], values[2, 2], values[3, 3] = 3.0, 7.0, 1.0, 2.0
    found = scene_figure.reduced(values, 2)
    assert found.shape == (3, 4)
    assert (found[0, 0], found[2, 3], found[1, 1]) == (3.0, 7.0, 2.0)
    assert np.isnan(found[0, 3])
    assert np.array_equal(scene_figure.reduced(values, 1), values, equal_nan=True)


def test_the_figure_shows_errors_beyond_the_bound(device, monkeypatch):
    """In a color of their own."""
    drawn = []
    for amount in (0.0, 1.0):
        with monkeypatch.context() as patch:
            spoiled(patch, 20, 33, amount)
            found = scene_study.study(scene_of(sheet()), STANDARD, device)
        image = scene_figure._share(figures.blank(1.0, 1.0).add_subplot(), found)
        colors = image.to_rgba(image.get_array(), bytes=True)
        drawn.append(np.argwhere((colors[..., :3] == (255, 32, 32)).all(axis=-1)).tolist())
    assert drawn == [[], [[20, 33]]]


# The command


@needs_device
@pytest.mark.usefixtures("no_figures")
def test_the_command(capsys, tmp_path):
    code, out, err = run(capsys, "stability", "quads", "--resolution", "32x24", "--out", tmp_path / "o")
    assert code == 0, err
    assert "quads, 64 triangles, 32x24" in out
    assert "768 of 768 pixels: all" in out
    assert json.loads((tmp_path / "o" / "stability.json").read_text())["settings"]["precision"] == "float32"


@pytest.mark.long
@needs_device
@pytest.mark.usefixtures("coarse_figures")
def test_nothing_visible(capsys, tmp_path):
    away = ("--camera-position", "0,0,50", "--camera-focal-point", "0,0,100")
    code, out, err = run(capsys, "stability", "quads", "--resolution", "8,6", *away, "--out", tmp_path)
    assert code == 0, err
    assert "nothing is visible" in out
    assert json.loads((tmp_path / "stability.json").read_text())["worst"] == []
    assert (tmp_path / "stability.csv").read_text().count("\n") == 1
    assert (tmp_path / "stability.png").stat().st_size > 1000


@pytest.mark.long
@needs_device
@pytest.mark.usefixtures("coarse_figures")
def test_an_image_of_one_pixel(capsys, tmp_path):
    code, _, err = run(capsys, "stability", "quads", "--resolution", "1,1", "--out", tmp_path)
    assert code == 0, err
    assert len(json.loads((tmp_path / "stability.json").read_text())["worst"]) == 1


@pytest.mark.long
@pytest.mark.usefixtures("no_figures")
def test_an_exit_code_for_errors_beyond_the_bound(capsys, tmp_path, monkeypatch, device):
    spoiled(monkeypatch, 3, 3, 1.0)
    arguments = "stability", "quads", "--resolution", "8,6", "--device", device.index, "--out", tmp_path
    code, out, err = run(capsys, *arguments)
    assert code == 1, err
    assert "FAILED" in out


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("no_such_scene",), ("SCENE: expected a file or one of teapot", "'no_such_scene'")),
        (("none.obj",), ("none.obj",)),
        (("teapt",), ("did you mean 'teapot'",)),
        (("quads", "--resolution", "0,5"), ("resolution",)),
        (("quads", "--case", "slivers"), ("--case: is for the cases, and cannot go with 'quads'",)),
        (("quads", "--list"), ("--list: is for the cases",)),
        (("quads", "--triangles", "7"), ("--triangles: is for the cases",)),
        (("--resolution", "8,6"), ("--resolution: needs a SCENE",)),
        (("--precision", "fast"), ("--precision: needs a SCENE",)),
        (("quads", "--samples", "99"), ("samples",)),
        (("quads", "teapot"), ("SCENE alone", "'teapot'")),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_bad_input(capsys, tmp_path, monkeypatch, arguments, parts):
    monkeypatch.chdir(tmp_path)
    assert_refused(run(capsys, "stability", *arguments), *parts)
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_cone_is_named_with_its_light(device):
    """The edge of a cone without width amplifies by 2000; a light from infinitely far is nobody's cause."""
    scene = light_on_the_surface()
    lamp = SpotLight((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), (1, 1, 1), 5.0, 5.0)
    scene = replace(scene, lights=(DirectionalLight((0, 0, -1)), lamp))
    worst = scene_study.study(scene, STANDARD, device).worst[0]
    assert worst.cause == "light"
    assert worst.why.startswith("light 1 is ")
    assert "cone and attenuation amplify that " in worst.why
