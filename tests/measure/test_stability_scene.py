"""`stability SCENE`: planted causes are named, kappa and errors are the oracle's, and the command's output and files."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from command_line import needs_device, run

from clshade import oracle
from clshade.images import exr, figures
from clshade.measure.stability import causes, scene_figure, scene_stability, scene_study
from clshade.measure.stability.cases import lit
from clshade.pipeline.frame import Frame
from clshade.pipeline.renderer import render
from clshade.scene.camera import Camera
from clshade.scene.model import DirectionalLight, Material, Mesh, PointLight, Scene, Settings, SpotLight, Texture

STANDARD = Settings.from_preset("standard")
CALM = Material(n=1.0)
TRIANGLE = [[-1, -1, 0], [1, -1, 0], [0, 1, 0]]


def sheet(material: Material = CALM, **fields) -> Mesh:
    return lit.patch(material=material, **fields)


def scene_of(mesh: Mesh, lamp=(3.0, 4.0, 5.0), eye=(0.0, 0.0, 5.0), lookat=(0.0, 0.0, 0.0), **fields) -> Scene:
    camera = Camera(eye, lookat, (0.0, 1.0, 0.0), 1.3, (1.0, 1.0), (61, 61))
    lights = (PointLight(np.array(lamp), np.ones(3)),)
    return Scene((mesh,), camera, **{"lights": lights, "name": "planted", **fields})


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
PLANTED = {
    "light on the surface": (lambda: LIGHT_ON_THE_SURFACE, "light", "light 0 is "),
    "eye at the surface": (
        lambda: scene_of(sheet(), eye=(0.01, 0.02, 0.152), lookat=(0.01, 0.02, 0.0)),
        "eye",
        "the eye is 0.0",
    ),
    "needle": (lambda: one([[-1, -1, 0], [1e4, 0, 0], [-1, 1, 0]]), "needle", "1e+04 away from the eye"),
    "opposite normals": (
        lambda: one(TRIANGLE, [[1, 0, 0.01], [-1, 0, 0.01], [0, 0, 1]]),
        "normals",
        "their mean has the length 0.0",
    ),
    "large exponent": (lambda: scene_of(sheet(Material(n=1e6))), "exponent", "n = 1e+06"),
    # The mirrored light is nearly perpendicular to the direction to the eye.
    "exponent below one": (
        lambda: scene_of(sheet(Material(n=0.25), bend=0.0), (1e3, 0.0, 0.1)),
        "steepness",
        "n = 0.25",
    ),
    "far texture": (far_texture, "texture", "1e+05, 4.1e+08 of the texture's 4096 texels"),
    "far away": (far_away, "origin", "1e+10 from the origin"),
    "placed far away": (
        lambda: far_away(change=lambda _: {"verts": sheet().verts, "instances": FAR[None]}),
        "origin",
        "1e+10 from the origin",
    ),
    "far away in float32": (
        lambda: far_away(1e5, lambda verts: {"verts": verts.astype(np.float32)}),
        "origin",
        "its float32 coordinates",
    ),
    # N.L is 0 exactly, and the highlight behind the gate is bright.
    "light in the plane": (
        lambda: scene_of(sheet(bend=0.0), (-20.0, 0.0, 0.0), eye=(3.0, 0.0, 1.0)),
        "grazing",
        "N.L or R.V",
    ),
}
assert {name for _, name, _ in PLANTED.values()} == set(causes.CAUSES)


@pytest.mark.sampled
@pytest.mark.parametrize("plant", PLANTED)
def test_a_planted_cause_is_named(device, plant):
    scene, name, part = PLANTED[plant]
    study = scene_study.study(scene(), STANDARD, device)
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


# The study


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
    """There kappa and the bound are infinite; it is the worst pixel, and the light's doing."""
    scene = one(TRIANGLE, lamp=(0.0, 0.0, 0.0), eye=(0.0, 0.0, 4.0))
    odd = replace(scene, camera=scene.camera.with_resolution((33, 25)))
    worst = scene_study.study(odd, STANDARD, device).worst[0]
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
    """Plant errors in pixels, by row and column."""

    def wrong(scene, **options):
        frame = render(scene, **options)
        rgba = frame.rgba.copy()
        for place, amount in amounts.items():
            rgba[(*place, 1)] += amount
        return changed(frame, rgba)

    monkeypatch.setattr(scene_study, "render", wrong)


def drawn(study: scene_study.SceneStudy, values: np.ndarray) -> np.ndarray:
    """Return the pixels of the map in the figure, (M, N, 4)."""
    image = scene_figure.draw_map(figures.blank(1, 1).add_subplot(), study, values, "magma", (1e-5, 1.0))
    return image.to_rgba(image.get_array(), bytes=True)


def test_a_planted_error_is_the_worst(device, monkeypatch):
    """The figure shows it in a color of its own, which no pixel has without an error beyond its bound. A pixel of NaN is
    infinitely wrong."""
    measured = partial(scene_study.study, scene_of(sheet()), STANDARD, device)
    right = measured()
    calm = (causes.NONE, "nothing amplifies rounding 4 times")
    assert {(pixel.cause, pixel.why) for pixel in right.worst} == {calm}
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


# The command


@pytest.fixture
def command(capsys, tmp_path, monkeypatch):
    """Return a function that runs the command on small images, with figures of few pixels."""
    blank = figures.blank
    monkeypatch.setattr(figures, "blank", lambda width, height: blank(width, height, dpi=40))
    return partial(run, capsys, "stability", "quads", "--out", tmp_path / "o", "--resolution")


@needs_device
def test_the_command(command, tmp_path, monkeypatch):
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
    """Nothing is visible, or one pixel."""
    away = ("--camera-position", "0,0,50", "--camera-focal-point", "0,0,100") if size == "8,6" else ()
    code, out, err = command(size, *away)
    assert code == 0, err
    assert ("nothing is visible" in out) == (size == "8,6")
    assert (tmp_path / "o" / "stability.csv").read_text().count("\n") == (1 if size == "8,6" else 2)
    assert (tmp_path / "o" / "stability.png").stat().st_size > 1000
