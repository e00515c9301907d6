"""`bench --against`: the image that OpenGL draws, and the agreement of images."""

from __future__ import annotations

import sys
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from command_line import assert_refused, run
from speeds import SMALL

from clshade.errors import InputError
from clshade.measure.bench import agreement, bench, opengl, workloads
from clshade.measure.bench.agreement import TEXTURED, TOLERANCE
from clshade.measure.bench.opengl import MissingOpenGL, OpenGL, check_drawn, mesh_arrays, open_context
from clshade.measure.bench.workloads import Workload, full_screen, thing
from clshade.pipeline.renderer import Renderer, render
from clshade.scene.model import Mesh, Scene


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


@pytest.mark.sampled
@pytest.mark.parametrize("make", [*SMALL.values(), two_meshes], ids=[*SMALL, "two-sided"])
def test_opengl_draws_the_same_picture(opened, context, make):
    scene = make()
    with closing(OpenGL(context, scene)) as reference:
        frame = render(scene, device=opened, layers=("id",))
        comparison = agreement.agreement(frame.rgb, frame["id"], reference.draw(scene.camera))
        assert comparison.same
        assert comparison.interior > 0.05
        assert (reference.draw(scene.camera)[..., 3] == frame.alpha).mean() > 0.99


@pytest.mark.long
def test_textures(opened, context):
    scene = thing(96, level=3, textured=True)
    with closing(OpenGL(context, scene)) as reference:
        frame = render(scene, device=opened, layers=("id",))
        drawn = reference.draw(scene.camera)
        assert agreement.agreement(frame.rgb, frame["id"], drawn, TEXTURED).same
        plain = replace(scene, meshes=tuple(map(workloads.phong_mesh, scene.meshes)))
        unlike = render(plain, device=opened).rgb
        assert not agreement.agreement(unlike, frame["id"], drawn, TEXTURED).same


def test_corners_with_indices_of_their_own():
    """A vertex is duplicated for each different normal."""
    mesh = thing(8, level=2, textured=True).meshes[0]
    indexed = replace(
        mesh, normals=np.eye(3) * [[1.0], [2.0], [4.0]], normal_faces=np.arange(3 * len(mesh.faces)).reshape(-1, 3) % 3
    )
    vertices, faces = mesh_arrays(indexed)
    assert (vertices[faces, :3] == mesh.verts[mesh.faces].astype(np.float32)).all()
    assert (vertices[faces, 6:9] == np.eye(3)[indexed.normal_faces]).all()
    assert (vertices[faces, 9:] == mesh.uvs[mesh.uv_faces].astype(np.float32)).all()
    assert len(mesh.verts) < len(vertices) < 3 * len(mesh.faces)


PLAIN = thing(8, level=2)


@pytest.mark.parametrize(
    ("scene", "options", "named"),
    [
        (PLAIN, {"shader": "nolight"}, ("no phong", "no lighting")),
        (PLAIN, {"samples": 4, "sample_shading": True}, ("samples", "sample shading")),
        (PLAIN, {"shadows": True}, ("casters", "shadows")),
        (replace(PLAIN, lights=()), {}, ("no light",)),
        (replace(PLAIN, camera=replace(PLAIN.camera, principal=(0.5, 0.25))), {}, ("principal point",)),
        (replace(PLAIN, camera=replace(PLAIN.camera, eye=np.zeros(3), lookat=np.ones(3))), {}, ("behind the eye",)),
        (
            replace(PLAIN, meshes=(Mesh(np.eye(3), [[0, 1, 2]], instances=np.diag([2.0, 1.0, 1.0, 1.0])[None]),)),
            {},
            ("placed by matrices",),
        ),
    ],
)
def test_scenes_that_opengl_does_not_draw(opened, scene, options, named):
    with (
        Renderer(scene, device=opened, **options) as renderer,
        pytest.raises(InputError, match="--look plain") as caught,
    ):
        check_drawn(renderer.scene, renderer.features.used)
    assert all(name in str(caught.value) for name in named)


# Without OpenGL


def test_without_moderngl_nothing_is_measured(opened, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "moderngl", None)
    monkeypatch.setattr(bench, "measure", lambda *arguments: pytest.fail("something was measured"))
    refusal = run(capsys, "bench", "quads", "--device", opened.index, "--against", "llvmpipe")
    assert_refused(refusal, "llvmpipe: moderngl is not installed (pip install moderngl, or clshade's extra `peers`)")


def test_without_egl_it_is_said(monkeypatch):
    pytest.importorskip("moderngl")
    monkeypatch.setattr(opengl, "BACKEND", {"backend": "egl", "libegl": "no-such-library.so"})
    with pytest.raises(MissingOpenGL, match=r"^llvmpipe: no OpenGL context by EGL: .*apt install libegl1"):
        open_context("llvmpipe")


def test_a_size_that_opengl_does_not_draw_is_said():
    moderngl = pytest.importorskip("moderngl")
    released = []

    class Context:
        release = staticmethod(lambda: released.append(True))

        @staticmethod
        def renderbuffer(*_, **__):
            raise moderngl.Error("the framebuffer is\nnot complete")

    with pytest.raises(MissingOpenGL, match=r"^OpenGL: the framebuffer is not complete$"):
        OpenGL(Context, SMALL["object"]())
    assert released == [True]


# The comparison


@pytest.mark.usefixtures("context")
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


# Agreement of images


def picture():
    """Return two triangles of several pixels on a background, in smooth colors."""
    ids = np.zeros((20, 24), np.uint32)
    ids[2:18, 3:12], ids[2:18, 12:21] = 1, 2
    rows, columns = np.indices(ids.shape)
    smooth = (1.0 + 0.01 * rows + 0.02 * columns)[..., None] * np.array([1.0, 0.5, 0.25])
    return ids, (smooth * (ids > 0)[..., None]).astype(np.float32)


def test_an_error_inside_of_a_triangle_is_found_and_one_on_an_edge_is_allowed():
    ids, image = picture()
    comparison = agreement.agreement(image, ids, image)
    assert comparison == agreement.Agreement(
        interior=2 * 14 * 7 / (16 * 18), largest=0.0, tolerance=TOLERANCE, others=1.0
    )
    wrong = image.copy()
    wrong[8, 6, 1] += np.float32(2.0 * TOLERANCE * image.max())
    comparison = agreement.agreement(image, ids, wrong)
    assert comparison.largest == pytest.approx(
        2.0 * TOLERANCE, rel=1e-3
    )  # float32 of a color near 1, off by 1e-3: 6e-5
    assert not comparison.same
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
