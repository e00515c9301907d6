"""`bench --shadows`: its rays, its exact answers, Embree, and what it prints."""

from __future__ import annotations

import io
import json
import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.measure.bench import shadow_tables, shadows, shadows_apart
from clshade.measure.bench.exact_shadows import Answer, answers, candidates
from clshade.measure.bench.peers import MissingPeer, embree
from clshade.measure.bench.shadow_kernel import ShadowKernel
from clshade.measure.bench.shadow_rays import (
    NOBODY,
    Receivers,
    ShadowWorkload,
    blocks,
    occlusion_receivers,
    receivers,
)
from clshade.measure.bench.shadow_results import Answers, Built, LightTimes, ShadowTimes
from clshade.measure.bench.workloads import knot
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.geometry import camera_axes
from clshade.scene.model import Mesh, PointLight, Scene
from clshade.scene.seen_points import pixel_rays, triangles

# A floor of two triangles in z = 0, and above it, in z = 1, a square of two triangles that share the edge x = y.
VERTS = np.array(
    [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], np.float64
)
FACES = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], np.int32)
ABOVE = np.array([0.0, 0.0, 2.0])  # the square's shadow on the floor reaches to 2


def answer(point, owner=0, light=ABOVE, verts=VERTS, faces=FACES):
    (found,) = answers(np.array([point], np.float64), np.array([owner]), np.asarray(light), verts, faces)
    return found


# Exact answers


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((1.5, 0.25, 0.0), Answer.DARK),
        ((2.5, 0.25, 0.0), Answer.LIT),
        ((0.0, 0.0, 0.0), Answer.DARK),  # through the edge that both triangles share
        ((2.0, 0.25, 0.0), Answer.DARK),  # along the square's border
        ((2.0, 2.0, 0.0), Answer.DARK),  # through its corner
        ((2.0 + 2.0**-44, 0.25, 0.0), Answer.TIE),
        ((2.0 + 2.0**-32, 0.25, 0.0), Answer.LIT),
        ((2.0 - 2.0**-44, 0.25, 0.0), Answer.DARK),  # edges are part of triangles, so no rounding lets light in
    ],
)
def test_the_shadow_of_a_square(point, expected):
    assert answer(point) is expected


def test_what_casts_no_shadow():
    assert answer((0.0, 0.0, 1.0), owner=2) is Answer.LIT  # neither the own face, nor a neighbor in its plane
    assert answer((0.5, 0.5, 0.0), light=(0.5, 0.5, 0.5)) is Answer.LIT  # behind the light
    assert answer((-2.0, 0.0, 0.0), light=(4.0, 0.0, 1.0)) is Answer.LIT  # seen edge-on from the light
    assert answer((0.5, 0.25, 0.0), light=(3.0, 0.25, 0.0)) is Answer.LIT  # a light in the receiver's plane
    below = VERTS * (1.0, 1.0, -1.0)
    assert answer((0.5, 0.25, 0.0), verts=below) is Answer.LIT


def test_neighbors_cast_only_across_their_edge():
    """Of two faces that meet in a crease, each hides the light that is behind the other, up to their edge."""
    verts = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], np.float64)
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)  # in z = 0 and in x = 0
    for side, expected in ((1.0, Answer.LIT), (-1.0, Answer.DARK)):
        light = np.array([side, 0.3, 0.1])
        assert answer((0.25, 0.25, 0.0), 0, light, verts, faces) is expected
        assert answer((0.0, 0.25, 0.0), 0, light, verts, faces) is expected  # P in the other's plane
    light = np.array([-1.0, 0.3, 0.1])
    assert answer((-(2.0**-50), 0.25, 0.0), 0, light, verts, faces) is Answer.TIE  # rounded to its wrong side


def test_candidates_leave_out_none_that_casts():
    rng = np.random.default_rng(3)
    verts = rng.uniform(-1.0, 1.0, (60, 3))
    faces = np.array([rng.choice(60, 3, replace=False) for _ in range(200)], np.int32)
    points, light = rng.uniform(-1.0, 1.0, (40, 3)), np.array([0.3, 0.2, 5.0])
    for point, near in zip(points, candidates(points, light, verts, faces), strict=True):
        a, b, c = (verts[faces] - point).swapaxes(0, 1)
        volumes = np.stack(
            [
                np.linalg.det(np.stack([p, q, np.broadcast_to(light - point, p.shape)], 1))
                for p, q in ((a, b), (b, c), (c, a))
            ]
        )
        assert set(np.flatnonzero((volumes > 0.0).all(0) | (volumes < 0.0).all(0))) <= set(near)
        assert len(near) < len(faces) / 4


# Rays of images


def square_room(resolution=(40, 30), light=(0.0, 0.0, 2.0)):
    camera = Camera.from_fov((0.5, -3.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 50.0, resolution)
    return Scene((Mesh(VERTS, FACES),), camera, (PointLight(light, (1.0, 1.0, 1.0)),), name="room")


def test_receivers_are_what_the_pixels_show(opened):
    scene = replace(builtin("teapot", level=3), camera=builtin("teapot").camera.with_resolution((37, 30)))
    verts, faces = triangles(scene)
    camera = scene.camera
    ids = blocks(render(scene, device=opened, samples=1, layers=("id",))["id"].astype(np.int32) - 1)
    for rays, light in zip(receivers(scene, opened), scene.lights, strict=True):
        points, corners = rays.points[rays.asked], verts[faces[rays.faces[rays.asked]]]
        a, b, c = corners.swapaxes(0, 1)
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1)
        assert (np.abs(np.einsum("kx,kx->k", normals, points - a)) < 1e-13 * lengths).all()
        for p, q in ((a, b), (b, c), (c, a)):
            assert (np.einsum("kx,kx->k", normals, np.cross(p - points, q - points)) > -1e-13 * lengths).all()
        facing = [np.einsum("kx,kx->k", normals, end - a) for end in (camera.eye, light.position)]
        assert (facing[0] * facing[1] > 0.0).all()
        assert rays.light.tolist() == light.position.tolist()
        assert (rays.asked.sum(axis=1) > 0).all()
        assert 0.5 * (ids >= 0).sum() < rays.asked.sum() < (ids >= 0).sum()
        assert (rays.points[~rays.asked] == 0.0).all()


def test_receivers_lie_below_their_pixels(opened):
    """Points are seen at the centers of the pixels of their blocks; on faces larger than pixels, none is clamped."""
    scene = square_room()
    (rays,) = receivers(scene, opened)
    columns, rows = scene.camera.resolution
    offsets = (rays.points[rays.asked] - scene.camera.eye) @ camera_axes(scene.camera).T
    height, width = scene.camera.plane
    x = (offsets[:, 0] / offsets[:, 2] * scene.camera.focal / width + 0.5) * columns
    y = (0.5 - offsets[:, 1] / offsets[:, 2] * scene.camera.focal / height) * rows
    centered = (np.abs(x % 1.0 - 0.5) < 1e-9) & (np.abs(y % 1.0 - 0.5) < 1e-9)
    assert centered.mean() > 0.98
    owners = render(scene, device=opened, samples=1, layers=("id",))["id"]
    at = owners[y.astype(int), x.astype(int)]
    assert (at[centered] == rays.faces[rays.asked][centered] + 1).all()
    lanes = np.tile(np.arange(16), (len(rays.faces), 1))[rays.asked]
    assert (lanes[centered] == (4 * (y.astype(int) % 4) + x.astype(int) % 4)[centered]).all()


def test_receivers_of_a_light_below(opened):
    assert not sum(rays.asked.sum() for rays in receivers(square_room(light=(0.0, 0.0, -2.0)), opened))


def test_orthographic_rays():
    camera = replace(square_room().camera, orthographic=True)
    rays, origins = pixel_rays(camera)
    assert np.ptp(rays, axis=(0, 1)).tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(origins.mean(axis=(0, 1)), camera.eye, atol=1e-12)
    offsets = (origins - camera.eye) @ camera_axes(camera).T
    np.testing.assert_allclose(np.ptp(offsets[..., 0]), camera.plane[1] * 39 / 40)
    assert offsets[0, 0, 1] > 0.0 > offsets[0, 0, 0]


def test_instances_are_casters():
    placements = np.stack([np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])])
    scene = square_room()
    verts, faces = triangles(replace(scene, meshes=(replace(scene.meshes[0], instances=placements), scene.meshes[0])))
    np.testing.assert_array_equal(verts, np.concatenate([VERTS, 2.0 * VERTS, VERTS]))
    np.testing.assert_array_equal(faces, np.concatenate([FACES, FACES + 8, FACES + 16]))


def test_blocks_beyond_the_image():
    image = np.arange(5 * 6).reshape(5, 6)
    found = blocks(image)
    assert found.shape == (4, 16)
    assert found[0].tolist() == image[:4, :4].ravel().tolist()
    assert found[3, :3].tolist() == [28, 29, NOBODY]
    assert (found != NOBODY).sum() == image.size


# Tracers


class BruteForce:
    """Exact answers to all rays, but for those of `wrong`, by number."""

    title, bytes = "brute force", 1000

    def __init__(self, verts, faces, wrong=()):
        self.mesh, self.wrong, self.seconds = (verts, faces), list(wrong), 0.25

    def tracing(self, rays):
        def trace():
            points, owners, ends = rays.one_by_one()
            if rays.ends is None:
                found = answers(points, owners, ends, *self.mesh)
            else:
                each = zip(points, owners, ends, strict=True)
                found = [answer(point, owner, end, *self.mesh) for point, owner, end in each]
            dark = np.array([each is Answer.DARK for each in found])
            dark[self.wrong] ^= True
            return dark

        return trace

    def shadowed(self, found, rays):
        return found


WORKLOAD = ShadowWorkload("room", "", square_room, 2.0)


def measured(opened, monkeypatch, ours=(), theirs=()):
    monkeypatch.setattr(shadows, "BUILDS", 2)
    return shadows.measure(
        WORKLOAD,
        opened,
        lambda *mesh: BruteForce(*mesh, wrong=ours),
        lambda *mesh: BruteForce(*mesh, wrong=theirs),
        rounds=2,
    )


@pytest.mark.long
def test_answers_are_compared(opened, monkeypatch):
    found = measured(opened, monkeypatch)
    assert [each.many for each in found.lights] == [1, 16, 16]
    assert [len(each.light) for each in found.lights] == [3, 3, 0]
    for light in found.lights:
        assert light.answers == Answers(agreed=shadows.AGREED)
        assert 0 < light.dark < light.rays
        assert len(light.ours_ms) == len(light.theirs_ms) == 2
    assert found.ours == Built("brute force", (250.0, 250.0), 250.0)
    assert found.passed


@pytest.mark.long
def test_wrong_answers_are_found(opened, monkeypatch):
    found = measured(opened, monkeypatch, theirs=range(100, 160))
    assert found.passed
    assert found.lights[0].answers == Answers(60, 60, 0, 0, 60, shadows.AGREED, 0)
    found = measured(opened, monkeypatch, ours=[7, 8])
    assert not found.passed
    assert found.lights[0].answers == Answers(2, 2, 0, 2, 0, shadows.AGREED, 0)


@pytest.mark.long
def test_rays_that_both_answer_wrongly_are_found(opened, monkeypatch):
    found = measured(opened, monkeypatch, ours=range(300), theirs=range(300))
    assert not found.passed
    assert 0 < found.lights[0].answers.both_wrong < shadows.AGREED


@pytest.mark.long
def test_no_more_rays_are_decided_than_allowed(opened, monkeypatch):
    monkeypatch.setattr(shadows, "DISPUTED", 10)
    decided = measured(opened, monkeypatch, theirs=range(100)).lights[0].answers
    assert (decided.differ, decided.checked, decided.theirs_wrong) == (100, 10, 10)


@pytest.mark.long
def test_without_embree(opened, monkeypatch):
    def missing(verts, faces):
        raise MissingPeer("embree: not here")

    found = shadows.measure(WORKLOAD, opened, BruteForce, missing, 1)
    assert (found.theirs, found.missing, found.lights[0].theirs_ms) == (None, "embree: not here", ())
    speed = shadow_tables.ShadowSpeed("a device", "a machine", (found,))
    assert "embree: not here" in "\n".join(shadow_tables.lines(speed))
    assert found.passed


@pytest.mark.long
def test_embree_agrees_but_for_proven_errors(opened):
    pytest.importorskip("embreex")
    scene = knot(2000, (96, 72))
    verts, faces = triangles(scene)
    peer = embree.Embree(verts, faces)
    assert peer.seconds > 0.0
    for rays in receivers(scene, opened):
        dark = peer.shadowed(peer.tracing(rays)(), rays)
        right = answers(rays.points[rays.asked], rays.faces[rays.asked], rays.light, verts, faces)
        same = [found is Answer.TIE or (found is Answer.DARK) == said for found, said in zip(right, dark, strict=True)]
        assert np.mean(same) > 0.99
        assert 0.02 < np.mean(dark) < 0.5


@pytest.mark.long
def test_our_kernel_answers_exactly(opened, monkeypatch):
    monkeypatch.setattr(shadows, "BUILDS", 1)
    workload = ShadowWorkload("knot", "", lambda: knot(600, (48, 36)), 2.0)
    found = shadows.measure(workload, opened, partial(ShadowKernel, opened), BruteForce, 1)
    for light in found.lights:
        assert light.answers == Answers(agreed=shadows.AGREED)
        assert 0 < light.dark < light.rays
    assert found.ours.bytes > 0.0


def test_the_process_apart(monkeypatch, capsys, opened):
    held = []
    monkeypatch.setattr(os, "sched_setaffinity", lambda process, processors: held.append((process, processors)))
    monkeypatch.setattr(shadows_apart, "WORKLOADS", (WORKLOAD,))
    monkeypatch.setattr(shadows_apart, "measure", lambda workload, *_: replace(made_up(), name=workload.name))
    assert shadows_apart.main(["room", opened.index, "3"]) == 0
    assert ShadowTimes.from_stats(json.loads(capsys.readouterr().out)).name == "room"
    ((process, processors),) = held
    assert (process, len(processors)) == (0, 1)
    assert shadows_apart.main(["room", "no such device", "3"]) == 2
    assert "no such device" in capsys.readouterr().err


def test_segments_end_at_the_light():
    points, light = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]), np.array([4.0, 4.0, 4.0])
    origins, directions = embree.segments(points, light)
    np.testing.assert_allclose(origins + directions, np.tile(light, (2, 1)), rtol=1e-6)
    np.testing.assert_allclose(origins, points + embree.START * (light - points), rtol=1e-6)


# What is printed


def made_up_light(differ=0, wrong=0):
    decided = Answers(differ, differ, 0, wrong, differ - wrong, 40, 0)
    return LightTimes((1.0, 2.0, 3.0), 300_000, 75_000, (10.0, 11.0, 12.0), (30.0, 44.0, 31.0), decided)


def made_up(name="teapot", count=10_648, **more):
    ours, theirs = Built("ours", (80.0, 70.0), 41.6), Built("Embree 4", (900.0, 1000.0), 120.0)
    return ShadowTimes(name, count, ours, theirs, (made_up_light(**more),), 1)


def test_rates_and_ratios():
    light = made_up_light()
    assert light.ours_rate == pytest.approx(30.0)
    assert light.theirs_rate == pytest.approx(10.0)
    assert light.least_ratio == pytest.approx(3.0)
    assert light.ratio == pytest.approx(31.0 / 11.0)
    assert light.interval[0] <= light.ratio <= light.interval[1]


def test_names_of_lights():
    sized = replace(made_up_light(), many=16)
    around = replace(sized, light=())
    found = replace(made_up(), lights=(made_up_light(), sized, made_up_light(), sized, around))
    assert [name for name, _ in found.numbered] == ["1", "1 x16", "2", "2 x16", "AO x16"]
    bars = {each.what: each.bar for each in found.verdicts(WORKLOAD)}
    assert bars["times as fast as Embree, light 2 x16"] == 2.0
    assert bars["times as fast as Embree, AO x16"] == 0.5


def test_rays_to_a_sphere():
    """Each lane's own points, at the radius; of every eighth block."""
    rng = np.random.default_rng(2)
    faces = np.where(rng.random((20, 16)) < 0.3, NOBODY, rng.integers(0, 9, (20, 16)))
    rays = Receivers(rng.normal(size=(20, 16, 3)), faces, np.array([1.0, 2.0, 3.0])).to_sphere(0.25)
    assert rays.ends.shape == (3, 16, 16, 3)
    np.testing.assert_allclose(np.linalg.norm(rays.ends - rays.light, axis=-1), 0.25)
    assert np.abs((rays.ends - rays.light).mean(axis=(0, 1, 2))).max() < 0.02
    points, owners, ends = rays.one_by_one()
    count = np.count_nonzero(faces[::8] != NOBODY)
    assert len(points) == len(owners) == len(ends) == 16 * count
    assert (points[:16] == rays.points[rays.asked][0]).all()
    assert (ends[16:32] == rays.ends[rays.asked][1]).all()


def test_rays_of_ambient_occlusion(opened):
    """Of what is seen, as long as they are by default, on the side of the face that is seen, as dense as their cosine."""
    scene = square_room()
    rays = occlusion_receivers(scene, opened)
    verts, faces = triangles(scene)
    points, owners, ends = rays.one_by_one()
    seen = (render(scene, device=opened, samples=1, layers=("id",))["id"] > 0).sum()
    assert len(points) == len(owners) == len(ends)
    assert 0.8 * seen * 16 / 8 < len(points) < 1.2 * seen * 16 / 8
    a, b, c = verts[faces[owners]].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals *= np.sign(np.einsum("kx,kx->k", normals, scene.camera.eye - a))[:, None]
    reach = np.linalg.norm(ends - points, axis=1)
    np.testing.assert_allclose(reach, 0.2 * np.linalg.norm(np.ptp(verts, axis=0)), rtol=1e-6)
    cosines = np.einsum("kx,kx->k", normals, ends - points) / (np.linalg.norm(normals, axis=1) * reach)
    assert (cosines >= 0.0).all()
    np.testing.assert_allclose(np.quantile(cosines**2, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.03)


def test_stats_can_be_read_again():
    found = made_up(differ=5)
    assert ShadowTimes.from_stats(json.loads(json.dumps(found.stats()))) == found
    alone = replace(found, theirs=None, missing="none", lights=(replace(made_up_light(), theirs_ms=()),))
    assert ShadowTimes.from_stats(json.loads(json.dumps(alone.stats()))) == alone
    assert alone.lights[0].ratio is None


def test_tables_and_files(tmp_path, monkeypatch):
    said = {"teapot": made_up(), "knot": made_up("knot", 10**6, differ=9)}

    def child(module, name, device, rounds, **variables):
        assert (module, rounds, variables) == (
            "clshade.measure.bench.shadows_apart",
            7,
            {"POCL_MAX_PTHREAD_COUNT": "1"},
        )
        return json.dumps(said[name].stats())

    monkeypatch.setattr(shadows, "run_module", child)
    out, prefix = io.StringIO(), str(tmp_path / "rays")
    assert shadows.run(rounds=7, targets=True, out=prefix, stream=out)
    text = out.getvalue()
    for expected in ("25.0 %", "300,000", "25.0 %", "Embree: Embree 4", "times as fast as Embree, light 1", ">= 2"):
        assert expected in text
    bars = json.loads(Path(f"{prefix}.json").read_text())["bars"]
    assert [each["kept"] for each in bars] == [True] * 5
    assert [each["what"] for each in bars].count("ms to build") == 1
    csv = Path(f"{prefix}.csv").read_text().splitlines()
    assert len(csv) == 3
    assert csv[0].split(",") == list(shadow_tables.CSV)
    assert "## Answers" in Path(f"{prefix}.md").read_text()
    assert Path(f"{prefix}.png").stat().st_size > 1000


def test_a_wrong_answer_of_ours_fails(monkeypatch, capsys):
    said = {"teapot": made_up(), "knot": made_up("knot", 10**6, differ=9, wrong=1)}
    monkeypatch.setattr(shadows, "run_module", lambda module, name, *_, **__: json.dumps(said[name].stats()))
    assert main(["bench", "--shadows", "knot", "--frames", "3"]) == 1
    assert main(["bench", "--shadows", "teapot", "--frames", "3"]) == 0
    assert "teapot" in capsys.readouterr().out


def test_refusals(capsys):
    with pytest.raises(InputError, match="above 0"):
        shadows.run(rounds=0)
    assert main(["bench", "--shadows", "teapott"]) == 2
    assert "teapot" in capsys.readouterr().err
    for further in (("--workers", "2"), ("--scaling",), ("--peers", "none")):
        assert main(["bench", "--shadows", *further]) == 2
        assert "--shadows" in capsys.readouterr().err


@pytest.mark.parametrize("option", [["--turn", "3"], ["--scaling"], ["--peers", "numpy"], ["--workers", "2"]])
def test_options_of_other_benchmarks_are_refused(capsys, option):
    assert main(["bench", "--shadows", *option]) == 2
    assert "expected either --shadows" in capsys.readouterr().err
