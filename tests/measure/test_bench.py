"""`bench`: workloads, counts, tables, files, the command. Only one time is judged: a start with an empty cache takes
longer."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from speeds import WORKLOADS, results_of, timed

from clshade.errors import ClshadeError, DeviceError
from clshade.measure.bench import bench, device_peaks, workloads
from clshade.measure.bench.frame_timing import LIGHT_FLOPS, PIXEL_FLOPS, time_frames
from clshade.measure.bench.workloads import Workload, knot, thing
from clshade.pipeline.renderer import Renderer, render

# Workloads


def test_workloads_are_what_they_say():
    made = {workload.name: workload.make() for workload in workloads.WORKLOADS}
    assert {scene.preset for scene in made.values()} == {"standard"}
    assert {mesh.material.n for scene in made.values() for mesh in scene.meshes} == {20.0}
    for name, scene in made.items():
        assert len(scene.lights) == (int(name[7:]) if name.startswith("lights") else 3), name
    assert (made["object-4096"].face_count, made["object-4096"].camera.resolution) == (10_816, (4096, 4096))
    assert (made["knot-2160"].face_count, made["knot-2160"].camera.resolution) == (1_000_000, (3840, 2160))


# Counts


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
    assert large.covered == np.count_nonzero(frame.alpha)
    assert large.held == frame.stats["bytes"]
    few, many = (drawn(knot(n, (32, 32)), opened) for n in (200, 2000))
    corners = 2000 // 2 - 200 // 2  # a closed surface of this kind has half as many vertices as triangles
    # indices of 4 bytes; positions and normals of at least 3 float32 per vertex
    assert many.bytes - few.bytes >= (2000 - 200) * 12 + corners * 24


def test_other_shaders_have_no_floor_of_operations(opened):
    timing = drawn(thing(16, level=2), opened, shader="gouraud")
    assert timing.flops is None
    assert timing.floor_ms(device_peaks.Peaks(flops=1e-9, fill=2e3)) == pytest.approx(timing.bytes / 2.0)


@pytest.mark.sampled
@pytest.mark.parametrize("changes", [{}, {"is_cpu": False, "lanes": 1}], ids=["as it is", "as a GPU"])
def test_peaks(opened, changes):
    rates = device_peaks.peaks(replace(opened, **changes))
    assert all(1e7 < rate < 1e16 for rate in rates)  # no device copies as little as 10 MB per second


# Tables, files, the command


def test_the_tables_hold_what_was_measured(tmp_path):
    timings = results_of(timed(), timed("v", same=False, flops=None), errors={"x": "too large"})
    lines = timings.lines()
    # 100 triangles and pixels in 2 ms; 1e6 bytes take as long at the fill's 5e8; 1e7 operations half of that at 1e10;
    # 2^20 and 1e6 bytes are 1.95 MiB.
    first, second, *_ = (" ".join(line.split()[1:]) for line in lines if line.startswith("w  "))
    assert f"{first} {second}".startswith("10x10 100 100 2.00 1.8 2.2 5 0.05 0.05 0.5 5 2 1 1.95 12.00 2.00 5 6 2 9 ")
    assert any("x: too large" in line for line in lines)
    assert sum("NO" in line for line in lines) == 1
    timings.write(tmp_path / "b")
    rows = list(csv.DictReader((tmp_path / "b.csv").open()))
    assert [(row["name"], row["ratio"], row["same"]) for row in rows] == [("w", "6.0", "True"), ("v", "", "False")]
    assert [rows[0][name] for name in ("gb_s", "floor_ms", "held_bytes")] == ["0.5", "2.0", "2048576"]
    assert (rows[0]["gflops"], rows[1]["gflops"]) == ("5.0", "")


@pytest.fixture
def small_workloads(monkeypatch):
    monkeypatch.setattr(workloads, "WORKLOADS", WORKLOADS)
    monkeypatch.setattr(bench, "WORKLOADS", WORKLOADS)


@pytest.mark.usefixtures("small_workloads")
def test_the_command_times_scenes_of_the_user_beside_workloads(opened, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    Path("own.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    command = ("bench", "own.obj", "teapot", "--device", opened.index, "--frames", "2")
    code, out, _ = run(capsys, *command, "--resolution", "48,32", "--look", "plain", "--samples", "4", "-o", "b")
    assert code == 0
    assert {path.name for path in tmp_path.glob("b.*")} == {"b.csv", "b.json", "b.md"}
    figures = json.loads(Path("b.json").read_text())
    assert [(figure["name"], figure["image"], figure["frames"]) for figure in figures["frames"]] == [
        ("own.obj", "48x32", 2),
        ("teapot", "48x32", 2),
    ]
    assert figures["bytes_held"][1]["scene"] > figures["bytes_held"][0]["scene"] > 0
    assert figures["bytes_held"][0]["image"] == 48 * 32 * 16
    assert [figure["name"] for figure in figures["bytes_held"]] == ["own.obj", "teapot"]
    assert opened.title in out
    assert opened.title in Path("b.md").read_text()
    Path("knot").write_text("v 0 0 0\n")  # a file of a workload's name counts
    assert run(capsys, "bench", "knot", "--device", opened.index)[0] == 2
    code, out, _ = run(capsys, "bench", "quads", "--device", opened.index, "--frames", "1")  # not the built-in scene
    assert code == 0
    assert "48x32" in out


@pytest.mark.usefixtures("small_workloads")
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


def test_the_list_names_all(capsys):
    code, out, err = run(capsys, "bench", "--list")
    assert (code, err) == (0, [])
    named = [line.split()[0] for line in out.splitlines() if not line.startswith(" ")]
    assert named == [workload.name for workload in workloads.WORKLOADS]
