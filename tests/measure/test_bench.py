"""`bench`: workloads and counts. Only one time is judged: a start with an empty cache takes longer."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from speeds import made_up

from clshade.measure.bench import bench, children, device_peaks, starting, tables
from clshade.measure.bench.frame_timing import LIGHT_FLOPS, PIXEL_FLOPS, FrameTiming, draw
from clshade.measure.bench.peers import PEERS
from clshade.measure.bench.workloads import SCALING, WORKLOADS, Workload, knot, thing
from clshade.pipeline.renderer import render

# Workloads


def test_workloads_are_what_they_say():
    assert len({each.name for each in WORKLOADS}) == len(WORKLOADS)
    for each in WORKLOADS:
        assert set(each.ratios) <= set(each.peers) <= set(PEERS), each.name
        if not each.apart:
            scene = each.make()
            assert scene.preset == "standard"
            assert all(mesh.material.n == 20.0 for mesh in scene.meshes)
            assert len(scene.lights) == (int(each.name[7:]) if each.name.startswith("lights") else 3)
    sizes = {each.name: each.make() for each in WORKLOADS if each.name in ("object-4096", "knot-2160", "quads")}
    assert {name: (scene.face_count, scene.camera.resolution) for name, scene in sizes.items()} == {
        "object-4096": (10_816, (4096, 4096)),
        "knot-2160": (1_000_000, (3840, 2160)),
        "quads": (64, (1920, 1080)),
    }


def test_the_object_fills_a_third_of_the_image(opened):
    assert render(thing(128), device=opened).alpha.mean() == pytest.approx(1 / 3, abs=0.01)


def test_scaling_has_a_workload_for_each_size():
    assert [SCALING[f"phong-triangles-{n}"].make().face_count for n in (4000, 64_000)] == [4000, 64_000]
    assert SCALING["course-triangles-fixed"].make().face_count == 1000
    assert SCALING["gouraud-pixels-512"].make().camera.resolution == (512, 512)


# Counts


def test_bytes_and_flops(opened):
    """For two sizes the bytes differ by the images', 16 per pixel; for two scenes by their triangles'."""
    small, large = (draw(thing(size, level=2), opened, 1) for size in (32, 64))
    assert large.bytes - small.bytes == 16 * (64**2 - 32**2)
    assert large.flops == large.covered * (PIXEL_FLOPS + 3 * LIGHT_FLOPS)
    frame = render(thing(64, level=2), device=opened)
    assert large.covered == np.count_nonzero(frame.alpha)
    few, many = (draw(knot(n, (32, 32)), opened, 1) for n in (200, 2000))
    corners = 2000 // 2 - 200 // 2  # a closed surface of this kind has half as many vertices as triangles
    # indices of 4 bytes; positions and normals of at least 3 float32 per vertex
    assert many.bytes - few.bytes >= (2000 - 200) * 12 + corners * 24


def test_stages_and_host_make_up_the_frame(opened):
    drawn = draw(thing(48, level=2), opened, 3)
    assert drawn.frames == 3
    assert {"setup", "phong", "sort", "host"} <= set(drawn.stages)
    assert not {"frame", "pack", "build"} & set(drawn.stages)
    assert FrameTiming.from_stats(json.loads(json.dumps(drawn.stats()))) == drawn


def test_a_scene_too_large_for_the_device_is_reported(opened):
    tiny = replace(opened, max_allocation=1 << 12)
    result = bench.measure(Workload("large", "", lambda: thing(64, level=2)), tiny, [], 1)
    assert result.drawn is None
    assert "the device allows 4096" in result.failed
    assert not made_up(result).passed
    assert any(result.failed in line for line in tables.lines(made_up(result)))


@pytest.mark.sampled
@pytest.mark.parametrize("changes", [{}, {"is_cpu": False, "lanes": 1}], ids=["as it is", "as a GPU"])
def test_peaks(opened, changes):
    found = device_peaks.peaks(replace(opened, **changes))
    assert found.copy > 1e7  # no device copies as little as 10 MB per second
    assert found.flops > 1e7
    assert found.fill > 1e7
    assert found.flops / max(found.cycles, 1.0) < 1000.0  # two fma a cycle of 256 lanes at most
    several = device_peaks.Peaks(1.0, 5.0, 6.0), device_peaks.Peaks(2.0, 3.0, 4.0)
    assert device_peaks.best(*several) == (2.0, 5.0, 6.0, 0.0)


@pytest.mark.long
def test_a_process_of_its_own_tells_its_memory(opened):
    drawn = children.draw_apart("gouraud-pixels-fixed", opened.index, 1)
    assert drawn.resolution == (16, 16)
    assert "gouraud" in drawn.stages
    assert drawn.peak_mib is None or 20.0 < drawn.peak_mib < 4096.0  # Python with NumPy takes 20 MiB
    with pytest.raises(
        children.ChildError, match=r"clshade\.measure\.bench\.apart: no OpenCL device matches 'nothing'"
    ):
        children.draw_apart("phong-pixels-fixed", "nothing", 1)


def test_starts_are_with_a_warm_cache_and_with_empty_ones(monkeypatch):
    seen = []

    def fake(*arguments, cwd, **variables):
        cache = Path(variables["XDG_CACHE_HOME"])
        seen.append((arguments[:2], cache.name, any(cache.iterdir())))
        (cache / "kept").touch()
        return ""

    monkeypatch.setattr(starting, "run_module", fake)
    started = starting.start_up("0:0", rounds=2)
    assert [each[0] for each in seen] == 5 * [("clshade", "render")]
    assert [each[1:] for each in seen] == [
        ("warm", False),
        *[("warm", True), ("empty-0", False)],
        *[("warm", True), ("empty-1", False)],
    ]
    assert started.rounds == 2


@pytest.mark.long
def test_starting_up(opened):
    started = starting.start_up(opened.index, rounds=1)
    assert 0.0 < started.warm.median < started.empty.median
