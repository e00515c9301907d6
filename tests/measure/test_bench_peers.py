"""`bench`: its peers, and the agreement of their images with ours."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from speeds import SMALL, made_up

from clshade.errors import InputError
from clshade.measure.bench import bench, tables, workloads
from clshade.measure.bench.peers import MissingPeer, agreement, background_fill, open_peer, opengl
from clshade.measure.bench.peers.agreement import TEXTURED, TOLERANCE
from clshade.measure.bench.peers.arrays import mesh_arrays
from clshade.measure.bench.workloads import Workload, thing
from clshade.pipeline.renderer import render
from clshade.scene.model import Material, Mesh


def opened_peer(name, scene):
    try:
        return open_peer(name, scene)
    except MissingPeer as error:
        pytest.skip(str(error))


# Peers


@pytest.mark.sampled
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


@pytest.mark.long
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
    assert (background_fill.Write(scene).draw(scene.camera) == [*scene.background, 0.0]).all()


def test_corners_with_indices_of_their_own():
    """A vertex is duplicated for each different normal."""
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

    monkeypatch.setattr(opengl, "_context", lambda name: Context)
    monkeypatch.setattr(opengl, "OpenGL", refuse)
    with pytest.raises(MissingPeer, match=r"^llvmpipe: the framebuffer is not complete$"):
        open_peer("llvmpipe", SMALL["object"]())
    assert released == [True]


# Agreement of images


def picture():
    """Return two triangles of several pixels on a background, in smooth colors."""
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
    """Each pixel shows another triangle."""
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
    assert "numpy draws another picture" in tables.progress(result)
    assert any("NO" in line for line in tables.lines(found))
