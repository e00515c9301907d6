"""`bench`: workloads, counts, tables, the command; and OpenGL's image, which must agree before times are compared."""

import csv
import json
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, run

from clshade.errors import ClshadeError, DeviceError, InputError
from clshade.measure.bench import bench, device_peaks, tables, workloads
from clshade.measure.bench.agreement import TEXTURED, TOLERANCE, Agreement, agreement
from clshade.measure.bench.frame_timing import LIGHT_FLOPS, PIXEL_FLOPS, Compared, FrameTiming, time_frames
from clshade.measure.bench.opengl import MissingOpenGL, OpenGL, check_drawn, open_context
from clshade.measure.bench.workloads import Workload, full_screen, knot, thing
from clshade.measure.timing import Spread
from clshade.pipeline.renderer import Renderer, render
from clshade.scene.model import Mesh, Scene

SMALL = {
    "object": lambda: thing(128, level=3),
    "knot": lambda: knot(300, (192, 144)),
    "quads": lambda: full_screen(4, (48, 32)),
    "lights": lambda: thing(128, level=2, lights=8),
}
WORKLOADS = tuple(Workload(name, f"small {name}", make) for name, make in SMALL.items())


def drawn(scene, device, frames=1, **options):
    with Renderer(scene, device=device, **options) as renderer:
        return time_frames("it", renderer, frames)


def test_stages_bytes_and_flops(opened):
    """For two sizes the bytes differ by the images', 16 per pixel; for two scenes by their triangles'."""
    small, large = (drawn(thing(size, level=2), opened, 3) for size in (32, 64))
    assert small.frames == 3
    assert {"setup", "phong", "sort", "host"} <= set(small.stages)
    assert not {"frame", "pack", "build"} & set(small.stages)
    assert large.bytes - small.bytes == 16 * (64**2 - 32**2)
    assert large.flops == large.covered * (PIXEL_FLOPS + 3 * LIGHT_FLOPS)
    frame = render(thing(64, level=2), device=opened)
    assert (large.covered, large.held) == (np.count_nonzero(frame.alpha), frame.stats["bytes"])
    few, many = (drawn(knot(n, (32, 32)), opened) for n in (200, 2000))
    corners = 2000 // 2 - 200 // 2  # a closed surface of this kind has half as many vertices as triangles
    assert many.bytes - few.bytes >= (2000 - 200) * 12 + corners * 24
    timing = drawn(thing(16, level=2), opened, shader="gouraud")
    assert timing.flops is None
    assert timing.floor_ms(device_peaks.Peaks(flops=1e-9, fill=2e3)) == pytest.approx(timing.bytes / 2.0)


def timed(name: str, same: bool = True, flops: int | None = 10**7) -> FrameTiming:
    agreement = Agreement(0.5, 1e-5 if same else 0.5, TOLERANCE, 1.0)
    compared = Compared("llvmpipe 1", 2.0, 12.0, 5, (2.0, 9.0), agreement)
    stages, held = {"host": 1.0, "phong": 1.0}, {"scene": 900_000, "image": 100_000, "owners": 1 << 20}
    return FrameTiming(name, (10, 10), 100, 100, 5, Spread(1.8, 2.0, 2.2), stages, held, flops, compared)


def test_the_tables_hold_what_was_measured(tmp_path):
    peaks, measured = device_peaks.Peaks(flops=1e10, fill=5e8), (timed("w"), timed("v", same=False, flops=None))
    timings = tables.results("a device", peaks, measured, {"x": "too large"})
    lines = timings.lines()
    # 100 triangles and pixels in 2 ms; 1e6 bytes take as long at the fill's 5e8; 1e7 operations half of that at 1e10;
    # 2^20 and 1e6 bytes are 1.95 MiB.
    first, second, *_ = (" ".join(line.split()[1:]) for line in lines if line.startswith("w  "))
    assert f"{first} {second}".startswith("10x10 100 100 2.00 1.8 2.2 5 0.05 0.05 0.5 5 2 1 1.95 12.00 2.00 5 6 2 9 ")
    assert any("x: too large" in line for line in lines)
    assert sum("NO" in line for line in lines) == 1
    timings.write(tmp_path / "b")
    rows = list(csv.DictReader((tmp_path / "b.csv").open()))
    columns = ("name", "ratio", "same", "gflops")
    assert [[row[name] for name in columns] for row in rows] == [["w", "6.0", "True", "5.0"], ["v", "", "False", ""]]
    assert [rows[0][name] for name in ("gb_s", "floor_ms", "held_bytes")] == ["0.5", "2.0", "2048576"]


@pytest.mark.long
def test_the_command_times_scenes_of_the_user_beside_workloads(opened, capsys, folder, monkeypatch):
    for module in (workloads, bench):
        monkeypatch.setattr(module, "WORKLOADS", WORKLOADS)
    Path("own.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    command = ("bench", "own.obj", "teapot", "--device", opened.index, "--frames", "2")
    code, out, _ = run(capsys, *command, "--resolution", "48,32", "--look", "plain", "--samples", "4", "-o", "b")
    assert code == 0
    figures = json.loads(Path("b.json").read_text())
    assert [figure["name"] for figure in figures["frames"]] == ["own.obj", "teapot"]
    assert {(figure["image"], figure["frames"]) for figure in figures["frames"]} == {("48x32", 2)}
    own, teapot = figures["bytes_held"]
    assert teapot["scene"] > own["scene"] > 0
    assert own["image"] == 48 * 32 * 16
    code, out, err = run(capsys, "bench", "--list")
    assert (code, err) == (0, [])
    assert [line.split()[0] for line in out.splitlines() if not line.startswith(" ")] == [w.name for w in WORKLOADS]


def test_what_cannot_be_measured_does_not_end_the_rest(opened, capsys, monkeypatch):
    monkeypatch.setattr(bench, "open_device", lambda *_, **__: replace(opened, max_allocation=1 << 12))
    with pytest.raises(DeviceError, match="the device allows 4096"):
        bench.run([Workload("large", "", lambda: thing(64, level=2))], None, frames=1)

    def fail():
        raise ClshadeError("no such scene")

    monkeypatch.setattr(bench, "open_device", lambda *_, **__: opened)
    assert not bench.run([Workload("bad", "", fail), WORKLOADS[2]], None, frames=1)
    out = capsys.readouterr().out
    assert "failed   bad: no such scene" in out
    assert "quads" in out


@pytest.fixture
def context():
    try:
        return open_context("llvmpipe")
    except MissingOpenGL as error:
        pytest.skip(str(error))


def two_meshes() -> Scene:
    """A quad before another, seen from behind, whose material is lit on both sides."""
    scene = full_screen(1, (48, 32))
    (mesh,) = scene.meshes
    material = replace(mesh.material, two_sided=True, color=(1.0, 0.2, 0.1))
    turned = replace(mesh, faces=mesh.faces[:, ::-1], normals=-mesh.normals, material=material)
    return replace(scene, meshes=(mesh, replace(turned, verts=0.5 * mesh.verts + [0.0, 0.0, -0.5])))


PICTURES = {**SMALL, "two-sided": two_meshes, "textured": lambda: thing(96, level=3, textured=True)}


@pytest.mark.sampled
@pytest.mark.parametrize("name", PICTURES)
def test_opengl_draws_the_same_picture(opened, context, name):
    scene, tolerance = PICTURES[name](), TEXTURED if name == "textured" else TOLERANCE
    with closing(OpenGL(context, scene)) as reference:
        frame, image = render(scene, device=opened, layers=("id",)), reference.draw(scene.camera)
    comparison = agreement(frame.rgb, frame["id"], image, tolerance)
    assert comparison.same
    assert comparison.interior > 0.05
    assert (image[..., 3] == frame.alpha).mean() > 0.99
    if name == "textured":
        plain = replace(scene, meshes=tuple(map(workloads.phong_mesh, scene.meshes)))
        assert not agreement(render(plain, device=opened).rgb, frame["id"], image, tolerance).same


PLAIN = thing(8, level=2)
PLACED = Mesh(np.eye(3), [[0, 1, 2]], instances=np.diag([2.0, 1.0, 1.0, 1.0])[None])
BEHIND = replace(PLAIN.camera, eye=np.zeros(3), lookat=np.ones(3))
NOT_DRAWN = [
    ({}, {"shader": "nolight"}, ("no phong", "no lighting")),
    ({}, {"shadows": True}, ("casters", "shadows")),
    ({"camera": replace(PLAIN.camera, principal=(0.5, 0.25))}, {}, ("principal point",)),
    ({"camera": BEHIND}, {}, ("behind the eye",)),
    ({"meshes": (PLACED,)}, {}, ("placed by matrices",)),
]


@pytest.mark.parametrize(("changes", "options", "named"), NOT_DRAWN)
def test_scenes_that_opengl_does_not_draw(opened, changes, options, named):
    with (
        Renderer(replace(PLAIN, **changes), device=opened, **options) as renderer,
        pytest.raises(InputError, match="--look plain") as caught,
    ):
        check_drawn(renderer.scene, renderer.features.used)
    assert all(name in str(caught.value) for name in named)


def test_without_moderngl_nothing_is_measured(opened, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "moderngl", None)
    monkeypatch.setattr(bench, "measure", lambda *arguments: pytest.fail("something was measured"))
    refusal = run(capsys, "bench", "quads", "--device", opened.index, "--against", "llvmpipe")
    assert_refused(refusal, "llvmpipe: moderngl is not installed (pip install moderngl, or clshade's extra `peers`)")


@pytest.mark.usefixtures("context")
@pytest.mark.long
@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_images_are_compared_before_times(opened, capsys, monkeypatch, factor):
    draw = OpenGL.draw
    monkeypatch.setattr(OpenGL, "draw", lambda self, camera: np.float32(factor) * draw(self, camera))
    monkeypatch.setattr(bench, "open_device", lambda *_, **__: opened)
    same = bench.run([Workload("small", "", SMALL["quads"])], None, frames=6, against="llvmpipe")
    lines = capsys.readouterr().out.splitlines()
    assert same == (factor == 1.0)
    assert any(line.split()[-1:] == ["yes" if same else "NO"] for line in lines)
    assert any("llvmpipe (" in line for line in lines)
    assert bench.measure(Workload("small", "", SMALL["quads"]), opened, 26, "llvmpipe").compared.turns == 6


def test_agreement_of_images():
    ids = np.zeros((20, 24), np.uint32)
    ids[2:18, 3:12], ids[2:18, 12:21] = 1, 2
    rows, columns = np.indices(ids.shape)
    smooth = (1.0 + 0.01 * rows + 0.02 * columns)[..., None] * np.array([1.0, 0.5, 0.25])
    image = (smooth * (ids > 0)[..., None]).astype(np.float32)
    interior = 2 * 14 * 7 / (16 * 18)
    assert agreement(image, ids, image) == Agreement(interior, largest=0.0, tolerance=TOLERANCE, others=1.0)
    wrong, edge = image.copy(), image.copy()
    wrong[8, 6, 1] += np.float32(2.0 * TOLERANCE * image.max())
    comparison = agreement(image, ids, wrong)
    assert comparison.largest == pytest.approx(2.0 * TOLERANCE, rel=1e-3)  # float32 of a color near 1: 6e-5
    assert not comparison.same
    edge[2:18, 12] = image[2:18, 11]  # the other triangle owns the pixels of its neighbor's border
    assert agreement(image, ids, edge).same
    for spoiled in (np.roll(image, 3, axis=0), image * np.nan):
        assert not agreement(image, ids, spoiled).same
