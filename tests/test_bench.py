"""`bench`: its workloads, its peers' pictures, what it counts, its tables and files, the command. Of times only one is
judged: that a start with an empty cache takes longer."""

from __future__ import annotations

import csv
import io
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_cli import assert_refused, run

from clshade import png
from clshade.checks import bench, bench_figure, bench_tables, children, peaks, scaling, speed, starting, workloads
from clshade.checks.drawing import LIGHT_FLOPS, PIXEL_FLOPS, Drawn, draw
from clshade.checks.peers import PEERS, MissingPeer, agreement, gl, open_peer, write
from clshade.checks.peers.agreement import TEXTURED, TOLERANCE
from clshade.checks.peers.arrays import mesh_arrays
from clshade.checks.timing import Spread
from clshade.checks.workloads import SCALING, WORKLOADS, Limit, Workload, full_screen, knot, thing
from clshade.errors import InputError
from clshade.renderer import render
from clshade.scene import Material, Mesh

SMALL = {
    "object": lambda: thing(128, level=3),
    "knot": lambda: knot(300, (192, 144)),
    "quads": lambda: full_screen(4, (48, 32)),
    "lights": lambda: thing(128, level=2, lights=8),
}


def opened_peer(name, scene):
    try:
        return open_peer(name, scene)
    except MissingPeer as error:
        pytest.skip(str(error))


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
    assert [SCALING[f"triangles-{n}"].make().face_count for n in (4000, 64_000)] == [4000, 64_000]
    assert SCALING["triangles-fixed"].make().face_count == 1000
    assert SCALING["pixels-512"].make().camera.resolution == (512, 512)


# Peers


@pytest.mark.parametrize("name", ["llvmpipe", "numpy"])
@pytest.mark.parametrize("make", SMALL.values(), ids=SMALL)
def test_peers_draw_the_same_picture(opened, name, make):
    scene = make()
    peer = opened_peer(name, scene)
    frame = render(scene, device=opened, layers=("id",))
    first = agreement.agreement(frame.rgb, frame["id"], peer.draw(scene.camera))
    assert first.same
    assert first.interior > 0.05
    assert (peer.draw(scene.camera)[..., 3] == frame.alpha).mean() > 0.99
    peer.close()


def test_the_textured_peer(opened):
    scene = thing(96, level=3, textured=True)
    peer = opened_peer("llvmpipe", scene)
    frame = render(scene, device=opened, layers=("id",))
    drawn = peer.draw(scene.camera)
    assert agreement.agreement(frame.rgb, frame["id"], drawn, TEXTURED).same
    plain = replace(scene, meshes=tuple(map(workloads.phong_mesh, scene.meshes)))
    unlike = render(plain, device=opened).rgb
    assert not agreement.agreement(unlike, frame["id"], drawn, TEXTURED).same
    peer.close()


def test_the_scanline_loop_draws_the_preset_course(opened):
    peer = open_peer("scanline", thing(48, level=2))
    frame = render(peer.scene, device=opened, layers=("id",))
    assert peer.once
    assert agreement.agreement(frame.rgb, frame["id"], peer.draw(peer.scene.camera)).same


def test_writing_writes_the_background():
    scene = workloads.empty(8)
    assert (write.Write(scene).draw(scene.camera) == [*scene.background, 0.0]).all()


def test_corners_with_indices_of_their_own():
    """A vertex has as many copies as it has different normals."""
    mesh = thing(8, level=2, textured=True).meshes[0]
    own = replace(
        mesh, normals=np.eye(3) * [[1.0], [2.0], [4.0]], normal_faces=np.arange(3 * len(mesh.faces)).reshape(-1, 3) % 3
    )
    made = mesh_arrays(replace(thing(8), meshes=(own,)))
    assert (made.verts[made.faces] == mesh.verts[mesh.faces].astype(np.float32)).all()
    assert (made.uvs[made.faces] == mesh.uvs[mesh.uv_faces].astype(np.float32)).all()
    assert (made.normals[made.faces] == np.eye(3)[own.normal_faces]).all()
    assert len(mesh.verts) < len(made.verts) < 3 * len(mesh.faces)


@pytest.mark.parametrize(
    "scene",
    [
        replace(thing(8, level=2), meshes=()),
        replace(thing(8, level=2), meshes=(Mesh(np.eye(3), [[0, 1, 2]], material=Material(two_sided=True)),)),
        replace(thing(8, level=2), meshes=2 * thing(8, level=2).meshes),
        replace(
            thing(8, level=2), meshes=(Mesh(np.eye(3), [[0, 1, 2]], instances=np.diag([2.0, 1.0, 1.0, 1.0])[None]),)
        ),
    ],
)
def test_scenes_that_peers_do_not_draw(scene):
    with pytest.raises(InputError, match="expected one mesh"):
        open_peer("numpy", scene)


def test_peers_clip_nothing_and_numpy_has_no_textures():
    scene = thing(8, level=2)
    behind = replace(scene.camera, eye=np.zeros(3), lookat=np.ones(3))
    with pytest.raises(InputError, match="before the eye"):
        open_peer("numpy", replace(scene, camera=behind))
    with pytest.raises(InputError, match="without texture"):
        open_peer("numpy", thing(8, level=2, textured=True))


def test_a_peer_that_is_not_installed_is_named_once_and_the_rest_goes_on(opened, monkeypatch):
    monkeypatch.setitem(sys.modules, "moderngl", None)
    workload = Workload("small", "", SMALL["object"], ratios={"llvmpipe": 5.0})
    result = bench.measure(workload, opened, ["llvmpipe", "numpy"], 1)
    assert [each.peer for each in result.compared] == ["numpy"]
    found = made_up(result, result)
    assert found.missing() == ["llvmpipe: moderngl is not installed (pip install moderngl, or clshade's extra `peers`)"]
    assert found.passed
    assert found.verdicts() == []


def test_a_peer_that_cannot_draw_this_size_is_missing(monkeypatch):
    moderngl = pytest.importorskip("moderngl")
    released = []

    class Context:
        release = staticmethod(lambda: released.append(True))

    def refuse(context, scene):
        raise moderngl.Error("the framebuffer is\nnot complete")

    monkeypatch.setattr(gl, "_context", lambda name: Context)
    monkeypatch.setattr(gl, "OpenGL", refuse)
    with pytest.raises(MissingPeer, match=r"^llvmpipe: the framebuffer is not complete$"):
        open_peer("llvmpipe", SMALL["object"]())
    assert released == [True]


# Whether pictures agree


def picture():
    """Two triangles of several pixels on a background, in smooth colors."""
    ids = np.zeros((20, 24), np.uint32)
    ids[2:18, 3:12], ids[2:18, 12:21] = 1, 2
    rows, columns = np.indices(ids.shape)
    smooth = (1.0 + 0.01 * rows + 0.02 * columns)[..., None] * np.array([1.0, 0.5, 0.25])
    return ids, (smooth * (ids > 0)[..., None]).astype(np.float32)


def test_agreement_of_equal_pictures():
    ids, image = picture()
    found = agreement.agreement(image, ids, image)
    assert found == agreement.Agreement(interior=2 * 14 * 7 / (16 * 18), largest=0.0, tolerance=TOLERANCE, others=1.0)
    assert found.same


def test_an_error_inside_of_a_triangle_is_found_and_one_on_an_edge_is_allowed():
    ids, image = picture()
    wrong = image.copy()
    wrong[8, 6, 1] += np.float32(2.0 * TOLERANCE * image.max())
    found = agreement.agreement(image, ids, wrong)
    assert found.largest == pytest.approx(2.0 * TOLERANCE, rel=1e-3)  # float32 of a color near 1, off by 1e-3: 6e-5
    assert not found.same
    edge = image.copy()
    edge[2:18, 12] = image[2:18, 11]  # the other triangle owns the pixels of its neighbor's border
    assert agreement.agreement(image, ids, edge).same


@pytest.mark.parametrize("spoil", [lambda image: np.roll(image, 3, axis=0), lambda image: image * np.nan])
def test_other_pictures_are_found(spoil):
    ids, image = picture()
    assert not agreement.agreement(image, ids, spoil(image)).same


def test_where_no_pixel_is_inside_the_ranges_tell():
    """Each pixel a triangle of its own."""
    ids, image = picture()
    tiny = np.where(ids > 0, np.arange(1, ids.size + 1).reshape(ids.shape), 0)
    same = agreement.agreement(image, tiny, image)
    assert (same.interior, same.same) == (0.0, True)
    assert not agreement.agreement(image, tiny, 1.1 * image).same


@pytest.mark.parametrize("band", [1, 3, 7, 19])
def test_bands_do_not_show(monkeypatch, band):
    ids, image = picture()
    other = image + np.random.default_rng(1).uniform(-0.01, 0.01, image.shape).astype(np.float32)
    whole = agreement.agreement(image, ids, other)
    monkeypatch.setattr(agreement, "BAND", band)
    assert agreement.agreement(image, ids, other) == whole


def test_a_peer_that_draws_something_else_has_no_ratio_and_fails(opened, monkeypatch):
    scene = SMALL["object"]()
    honest = open_peer("numpy", scene)

    class Wrong:
        title, once, scene = "wrong", False, honest.scene
        draw = staticmethod(lambda camera: 0.5 * honest.draw(camera))
        close = staticmethod(honest.close)

    monkeypatch.setattr(bench, "open_peer", lambda name, scene: Wrong)
    result = bench.measure(Workload("small", "", lambda: scene, ratios={"numpy": 2.0}), opened, ["numpy"], 1)
    found = made_up(result)
    assert not found.passed
    (verdict,) = found.verdicts()
    assert (verdict.value, verdict.kept) == (None, None)
    assert "numpy draws another picture" in bench_tables.progress(result)
    assert any("NO" in line for line in bench_tables.lines(found))


# What is counted


def test_bytes_and_flops(opened):
    """Of two sizes the bytes differ by the images', 16 a pixel; of two scenes by what their triangles take."""
    small, large = (draw(thing(size, level=2), opened, 1) for size in (32, 64))
    assert large.bytes - small.bytes == 16 * (64**2 - 32**2)
    assert large.flops == large.covered * (PIXEL_FLOPS + 3 * LIGHT_FLOPS)
    frame = render(thing(64, level=2), device=opened)
    assert large.covered == np.count_nonzero(frame.alpha)
    few, many = (draw(knot(n, (32, 32)), opened, 1) for n in (200, 2000))
    corners = 2000 // 2 - 200 // 2  # a closed surface of that kind has half as many vertices as triangles
    # indices of 4 bytes; positions and normals of at least 3 float32 a vertex
    assert many.bytes - few.bytes >= (2000 - 200) * 12 + corners * 24


def test_stages_and_host_make_up_the_frame(opened):
    drawn = draw(thing(48, level=2), opened, 3)
    assert drawn.frames == 3
    assert {"setup", "phong", "sort", "host"} <= set(drawn.stages)
    assert not {"frame", "pack", "build"} & set(drawn.stages)
    assert Drawn.from_stats(json.loads(json.dumps(drawn.stats()))) == drawn


def test_a_scene_too_large_for_the_device_is_reported(opened):
    tiny = replace(opened, max_allocation=1 << 12)
    result = bench.measure(Workload("large", "", lambda: thing(64, level=2)), tiny, [], 1)
    assert result.drawn is None
    assert "the device allows 4096" in result.failed
    assert not made_up(result).passed
    assert any(result.failed in line for line in bench_tables.lines(made_up(result)))


@pytest.mark.parametrize("changes", [{}, {"is_cpu": False, "lanes": 1}], ids=["as it is", "as a GPU"])
def test_peaks(opened, changes):
    found = peaks.peaks(replace(opened, **changes))
    assert found.copy > 1e7  # a device that copies 10 MB a second is none
    assert found.flops > 1e7
    assert peaks.best(peaks.Peaks(1.0, 5.0), peaks.Peaks(2.0, 3.0)) == (2.0, 5.0)


def test_a_process_of_its_own_tells_its_memory(opened):
    drawn = children.draw_apart("pixels-fixed", opened.index, 1)
    assert drawn.resolution == (16, 16)
    assert drawn.peak_mib is None or 20.0 < drawn.peak_mib < 4096.0  # Python with NumPy takes 20 MiB
    with pytest.raises(children.ChildError, match=r"clshade\.checks\.apart: no OpenCL device matches 'nothing'"):
        children.draw_apart("pixels-fixed", "nothing", 1)


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


# Exponents


def test_powers():
    sizes = [10.0, 100.0, 1000.0, 10_000.0]
    assert scaling.power(sizes, [3.0 * n**1.2 for n in sizes]) == pytest.approx(1.2)
    assert scaling.power(sizes[:2], [1.0, 2.0]) is None
    fixed = 40.0
    linear = [fixed + 0.5 * n for n in sizes]
    assert scaling.power(sizes, linear) < 0.9
    assert scaling.power_beyond(sizes, linear, fixed, 0.1) == pytest.approx(1.0)
    # Of points that are hardly above the fixed cost nothing is concluded, nor of smaller ones.
    noisy = [3.0 * fixed, fixed - 1.0, *linear[1:]]
    assert scaling.power_beyond([1.0, *sizes], noisy, fixed, 0.1) == pytest.approx(1.0)
    assert scaling.power_beyond(sizes, linear, fixed, 2.0) is None  # but two of them are less than two times it above
    assert scaling.power_beyond(sizes, [*linear[:3], None], fixed, 0.1) is None


def drawn_with(triangles=100, ms=2.0, side=10, peak=None):
    return Drawn((side, side), triangles, side**2, 5, Spread(0.9 * ms, ms, 1.1 * ms), {"host": ms}, 10**6, 10**7, peak)


def series_of(measure):
    made = scaling.scaling(measure)
    assert [each.name for each in made] == ["triangles", "pixels"]
    return made


def test_series_are_drawn_from_small_to_large():
    asked = []

    def measure(name):
        asked.append(name)
        kind, size = name.split("-")
        count = 0 if size == "fixed" else int(size)
        if kind == "triangles":
            return drawn_with(count, 1.0 + 1e-3 * count, peak=100.0 + 1e-2 * count)
        return drawn_with(side=max(count, 16), ms=1.0 + 1e-4 * count**2, peak=50.0)

    triangles, pixels = series_of(measure)
    assert asked == ["triangles-fixed", *list(SCALING)[:8], "pixels-fixed", *list(SCALING)[8:]]
    assert triangles.sizes == sorted(triangles.sizes)
    assert triangles.exponents()["time beyond the fixed cost"] == pytest.approx(1.0, abs=1e-6)
    assert triangles.exponents()["memory beyond the fixed cost"] == pytest.approx(1.0, abs=1e-6)
    assert pixels.sizes[0] == 256**2
    assert pixels.exponents()["time"] < 1.0
    assert pixels.exponents()["memory beyond the fixed cost"] is None


# Tables, files, the command


def made_up(*results, **more):
    return speed.Speed("a device", "a machine", peaks.Peaks(1e9, 1e10), tuple(results), **more)


def compared(peer, ours, theirs, same=True):
    found = agreement.Agreement(0.5, 1e-5 if same else 0.5, TOLERANCE, 1.0)
    return speed.Compared(peer, f"{peer} 1", Spread(ours, ours, ours), Spread(theirs, theirs, theirs), 5, found)


def small_speed():
    workload = Workload("w", "", lambda: None, ratios={"llvmpipe": 5.0}, limits=(Limit("ms", "ms a frame", 1.0),))
    result = speed.Result(workload, drawn_with(), (compared("llvmpipe", 2.0, 12.0), compared("numpy", 2.0, 30.0)))
    started = starting.Started(Spread(0.4, 0.5, 0.6), Spread(3.0, 4.0, 5.0), 5)
    points = tuple(drawn_with(n, 1.0 + n, peak=100.0 + n) for n in (10, 100, 1000))
    return made_up(
        result, started=started, series=(scaling.Series("triangles", drawn_with(1, 1.0, peak=100.0), points),)
    )


def test_verdicts():
    found = {(each.workload, each.what): (each.value, each.kept) for each in small_speed().verdicts()}
    assert found["w", "times as fast as llvmpipe"] == (6.0, True)
    assert found["w", "ms a frame"] == (2.0, False)
    assert found["start-up", "s with a warm cache"] == (0.5, True)
    assert found["start-up", "s with an empty cache"] == (4.0, False)
    assert found["scaling-triangles", "exponent of time beyond the fixed cost"][1]
    assert len(found) == 7
    least = speed.Verdict("", "", 150.0, 150.0, True)
    assert [least.kept, least._replace(value=149.0).kept, least._replace(value=None).kept] == [True, False, None]


def test_the_tables_hold_what_was_found():
    lines = bench_tables.lines(small_speed())
    # 100 triangles and pixels in 2 ms; 1e6 bytes in 2 ms are half of the copy's 1e9 a second; 1e7 operations half of 1e10.
    expected = "w 10x10 100 100.0 % 2.00 1.80 to 2.20 5 0.05 0.05 0.5 50.0 % 5 50.0 % -"
    assert expected in [" ".join(line.split()) for line in lines]
    for block in bench_tables.markdown(small_speed()).split("\n\n"):
        if block.startswith("|"):
            assert len({line.count("|") for line in block.splitlines()}) == 1, block
    rows = list(
        csv.DictReader(io.StringIO(bench_tables.tables.as_csv(bench_tables.CSV, bench_tables.csv_rows(small_speed()))))
    )
    assert [(row["workload"], row["peer"]) for row in rows] == [
        ("w", ""),
        *[("triangles-fixed", ""), ("triangles-10", ""), ("triangles-100", ""), ("triangles-1000", "")],
        *[("w", "llvmpipe"), ("w", "numpy")],
        *[("start-up-warm", ""), ("start-up-empty", "")],
    ]
    assert float(rows[0]["copy_share"]) == pytest.approx(0.5)
    assert (float(rows[5]["ratio"]), float(rows[5]["bar"]), rows[6]["bar"]) == (6.0, 5.0, "")
    assert float(rows[8]["ms"]) == 4000.0


@pytest.mark.parametrize("part", ["all", "frames", "series"])
def test_the_figure(tmp_path, part):
    found = small_speed()
    if part == "frames":
        found = made_up(speed.Result(found.results[0].workload, drawn_with()))
    if part == "series":
        found = replace(found, results=())
    bench_figure.plot(found, tmp_path / "a.png")
    assert png.read(tmp_path / "a.png").std() > 20.0


def no_constants(text):
    raise AssertionError(f"{text} is no JSON")


@pytest.fixture
def small_workloads(monkeypatch):
    made = (
        *(Workload(name, f"small {name}", make) for name, make in SMALL.items() if name != "lights"),
        Workload("empty", "a small empty image", lambda: workloads.empty(8), peers=("write",), ratios={"write": 1e-9}),
    )
    monkeypatch.setattr(bench, "WORKLOADS", made)
    monkeypatch.setattr(bench, "NAMES", (*(each.name for each in made), starting.NAME))


@pytest.mark.usefixtures("small_workloads")
def test_the_command_writes_all(opened, capsys, tmp_path):
    command = ("bench", "object", "knot", "--device", opened.index, "--frames", "2", "--peers", "numpy")
    code, out, err = run(capsys, *command, "-o", tmp_path / "b")
    assert (code, err) == (0, [])
    assert {path.name for path in tmp_path.iterdir()} == {"b.csv", "b.json", "b.md", "b.png"}
    figures = json.loads((tmp_path / "b.json").read_text(), parse_constant=no_constants)
    assert [each["workload"] for each in figures["workloads"]] == ["object", "knot"]
    for each in figures["workloads"]:
        (peer,) = each["peers"]
        assert peer["picture"]["same"]
        assert peer["ratio"] == pytest.approx(peer["theirs_ms"]["median"] / peer["ours_ms"]["median"])
        assert each["drawn"]["frames"] == peer["rounds"] == 2
    assert opened.title in out
    assert opened.title in (tmp_path / "b.md").read_text()


@pytest.mark.usefixtures("small_workloads")
def test_the_command_line(opened, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "bench", "quads", "--device", opened.index, "--frames", "1", "--peers", "none")
    assert (code, list(tmp_path.iterdir())) == (0, [])
    assert "quads" in out
    assert "its ms" not in out
    code, out, _ = run(capsys, "bench", "empty", "--device", opened.index, "--frames", "1", "--peers", "numpy")
    assert code == 0
    assert "times as fast as write" in out  # what writing takes is measured whatever peers are named
    monkeypatch.setattr(bench, "draw_apart", lambda name, device, frames: drawn_with(len(name), frames))
    code, out, _ = run(capsys, "bench", "--scaling", "--frames", "3", "--device", opened.index)
    assert code == 0
    assert "scaling-pixels" in out
    assert "object" not in out.split("bar ")[0].split("grows")[0]
    code, out, err = run(capsys, "bench", "--list")
    assert (code, err) == (0, [])
    assert all(name in out for name in (*PEERS, "object", "knot", "quads", "start-up"))


REFUSED = [
    (("object-1024",), ("workload", "'object-1024'", "did you mean object-")),
    (("--peers", "lvmpipe"), ("--peers", "'lvmpipe'", "did you mean llvmpipe?")),
    (("--peers", ""), ("--peers", "''")),
    (("--frames", "0"), ("--frames", "0")),
    (("--frames", "x"), ("--frames", "'x'")),
    (("--device", "nothing"), ("device", "'nothing'")),
    (("-o", "file/x"), ("file", "not a folder")),
]


@pytest.mark.usefixtures("opened")
@pytest.mark.parametrize(("options", "parts"), REFUSED, ids=[" ".join(options) for options, _ in REFUSED])
def test_refused(capsys, tmp_path, monkeypatch, options, parts):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    monkeypatch.setattr(bench, "measure", lambda *arguments: pytest.fail("something was measured"))
    assert_refused(run(capsys, "bench", *options), *parts)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
