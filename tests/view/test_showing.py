"""Display of frames and scenes in notebooks: through IPython's formatters if installed, else by their methods."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import types
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from processes import ROOT

import clshade
from clshade.errors import DeviceError, OutputError
from clshade.pipeline.frame import Frame
from clshade.scene.model import Settings
from clshade.view import notebook

PNG = "image/png"


def frame_of(rgba, layers=None, **changes):
    scene = replace(clshade.builtin("quads"), **changes)
    return Frame(np.asarray(rgba, np.float32), layers or {}, scene, Settings(), lambda: {"times_ms": {"frame": 1.0}})


@pytest.fixture
def frame():
    """Return a frame, red above and green below, with a layer of each kind."""
    rgba = np.zeros((6, 8, 4))
    rgba[:3, :, 0] = rgba[3:, :, 1] = rgba[..., 3] = 1.0
    depth = np.full((6, 8), np.inf, np.float32)
    depth[2:4] = 5.0
    normals = np.zeros((6, 8, 3), np.float32)
    normals[2:4, :, 2] = -1.0
    uv = np.full((6, 8, 2), 0.5, np.float32)
    layers = {
        "Z": depth,
        "id": np.arange(48, dtype=np.uint32).reshape(6, 8),
        "N": normals,
        "P": 7.0 * normals,
        "uv": uv,
    }
    return frame_of(rgba, {**layers, "albedo": rgba[..., :3].copy(), "barycentrics": rgba[..., :3].copy()})


def decoded(data):
    return np.asarray(Image.open(io.BytesIO(data)))


def test_a_frame_is_its_tone_mapped_image(frame):
    shown = decoded(frame._repr_png_())
    assert shown.shape == (6, 8, 3)
    assert shown[0, 0].tolist() == [255, 0, 0]
    assert shown[-1, -1].tolist() == [0, 255, 0]
    assert repr(frame) == "<Frame of quads, 8x6, layers Z, id, N, P, uv, albedo, barycentrics>"
    gray = frame_of(np.full((2, 2, 4), 0.5), preset="course")
    assert (decoded(gray._repr_png_()) == 128).all()  # tone map none: as the course's figures


@pytest.mark.parametrize(
    ("shape", "shown"), [((700, 1024), (700, 1024)), ((1025, 4), (513, 2)), ((1, 5000), (1, 1000))]
)
def test_large_frames_are_reduced(shape, shown):
    assert decoded(frame_of(np.ones((*shape, 4)))._repr_png_()).shape == (*shown, 3)


def test_ipython_shows_a_frame(frame):
    formatters = pytest.importorskip("IPython.core.formatters")
    formatter = formatters.DisplayFormatter()
    bundle, _ = formatter.format(frame)
    assert set(bundle) == {"text/plain", PNG}
    assert bundle[PNG] == frame._repr_png_()
    figure, _ = formatter.format(frame.plot_layers())
    assert figure[PNG].startswith(b"\x89PNG")


def test_the_figure_has_every_layer(frame, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it now raises ImportError
    figure = frame.plot_layers()
    panels = {a.get_title().split("\n")[0]: np.asarray(a.images[0].get_array()) for a in figure.axes if a.images}
    assert list(panels) == ["RGB", "A", *frame.layers]
    assert panels["RGB"][0, 0].tolist() == [255, 0, 0]
    assert panels["Z"][0, 0].tolist() == [96, 96, 96]  # infinite
    assert panels["N"][0, 0].tolist() == [0, 0, 0]
    assert panels["N"][3, 0].tolist() == [128, 128, 0]  # -z, as (n + 1)/2
    assert len(np.unique(panels["id"].reshape(-1, 3), axis=0)) == 48
    assert decoded(figure._repr_png_()).std() > 10


def test_show_opens_a_viewer_outside_of_notebooks(frame, monkeypatch):
    from PIL import ImageShow

    shown = []

    class Viewer:
        def show(self, image, title):
            shown.append((np.asarray(image), title))
            return True

    # Pillow's last viewer, which would print the object, counts as none.
    monkeypatch.setattr(ImageShow, "_viewers", [ImageShow.IPythonViewer(), Viewer()])
    assert frame.show() is None
    assert frame.show("none", exposure=-1.0) is None
    assert (shown[0][0] == frame.to_png8()).all()
    assert shown[1][0][0, 0].tolist() == [128, 0, 0]
    monkeypatch.setattr(ImageShow, "_viewers", [ImageShow.IPythonViewer()])
    with pytest.raises(OutputError, match=r"no program that shows images; Frame\.save"):
        frame.show()


def test_show_in_a_notebook(frame, monkeypatch):
    shown = []
    module = types.ModuleType("IPython")
    module.get_ipython = lambda: types.SimpleNamespace(kernel=object())
    module.display = types.ModuleType("IPython.display")
    module.display.display = lambda bundle, raw: shown.append((bundle, raw))
    monkeypatch.setitem(sys.modules, "IPython", module)
    monkeypatch.setitem(sys.modules, "IPython.display", module.display)
    frame.show(exposure=-30.0)
    ((bundle, raw),) = shown
    assert raw
    assert bundle["text/plain"] == repr(frame)
    assert (decoded(bundle[PNG]) == 0).all()


def test_a_frame_as_a_page(frame, tmp_path):
    made = frame.view(tmp_path / "a.html", exposure=-1.0)
    assert (tmp_path / "a.html").read_text("utf-8") == made.html
    formatters = pytest.importorskip("IPython.core.formatters")
    bundle, _ = formatters.DisplayFormatter().format(made)
    assert bundle["text/html"].startswith("<iframe srcdoc=")
    manifest = json.loads(re.search(r'id="manifest">(.*?)</script>', made.html)[1])
    assert manifest["settings"] == {"operator": "srgb", "exposure": -1.0}
    (image,) = manifest["images"]
    types = {channel["name"]: channel["type"] for channel in image["channels"]}
    assert (types["P.X"], types["id"], image["name"]) == ("float", "uint", "quads")
    assert image["info"]["header"]["scene"].startswith("quads, ")
    course = frame_of(np.zeros((2, 2, 4)), preset="course").view()
    assert '"operator": "none"' in course.html
    with pytest.raises(OutputError, match="no folder"):
        frame.view(tmp_path / "none" / "a.html")


# Scenes


def drawn(monkeypatch):
    """Record the arguments of `render` from now on."""
    calls = []

    def render(scene, **options):
        calls.append((scene, options))
        columns, rows = scene.camera.resolution
        return frame_of(np.ones((rows, columns, 4)))

    monkeypatch.setattr("clshade.pipeline.renderer.render", render)
    return calls


@pytest.mark.parametrize(
    ("resolution", "small"),
    [((800, 600), (256, 192)), ((100, 50), (100, 50)), ((16384, 3), (256, 1)), ((512, 513), (255, 256))],
)
def test_a_scene_is_drawn_small(monkeypatch, resolution, small):
    calls = drawn(monkeypatch)
    scene = clshade.builtin("quads")
    scene = replace(scene, camera=scene.camera.with_resolution(resolution))
    bundle = scene._repr_mimebundle_()
    ((drawn_scene, options),) = calls
    assert drawn_scene.camera.resolution == small
    assert (drawn_scene.camera.plane == scene.camera.plane, options) == (True, {"samples": 1})  # the same view
    assert decoded(bundle[PNG]).shape == (small[1], small[0], 3)
    assert bundle["text/plain"].startswith(f"<Scene quads: {scene.face_count} triangles, ")
    assert f"{resolution[0]}x{resolution[1]}" in bundle["text/plain"]


def test_ipython_shows_a_scene_and_draws_it_once(monkeypatch):
    formatters = pytest.importorskip("IPython.core.formatters")
    calls = drawn(monkeypatch)
    bundle, _ = formatters.DisplayFormatter().format(clshade.builtin("quads"))
    assert set(bundle) == {"text/plain", PNG}
    assert len(calls) == 1


@pytest.mark.parametrize("error", [DeviceError("no device:\nnone"), MemoryError(), RuntimeError("anything")])
def test_a_scene_that_cannot_be_drawn_is_text(monkeypatch, error):
    def render(*_, **__):
        raise error

    monkeypatch.setattr("clshade.pipeline.renderer.render", render)
    bundle = clshade.builtin("quads")._repr_mimebundle_(include=None, exclude=None)
    assert list(bundle) == ["text/plain"]
    assert bundle["text/plain"].splitlines()[1:] == [f"not drawn: {str(error).replace(chr(10), ' ') or 'MemoryError'}"]


def test_without_a_device_a_scene_is_text():
    code = """
import json, clshade
print(json.dumps(clshade.builtin("quads")._repr_mimebundle_()))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={"PATH": "/usr/bin:/bin", "CLSHADE_DEVICE": "no such platform", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "no such platform" in json.loads(done.stdout)["text/plain"]


def test_a_scene_on_the_device(opened):
    bundle = clshade.builtin("quads")._repr_mimebundle_()
    assert max(decoded(bundle[PNG]).shape) <= notebook.SCENE_SIDE
    assert decoded(bundle[PNG]).std() > 10


def test_words():
    """In a terminal: one line, for any content."""
    scene = clshade.builtin("quads")
    assert repr(replace(scene, meshes=(), lights=(), name="")).startswith(
        "<Scene unnamed: 0 triangles, 0 meshes, 0 lights, "
    )
    one = replace(scene, lights=scene.lights[:1], meshes=scene.meshes[:1])
    assert ", 1 mesh, 1 light, " in repr(one)
    body = clshade.builtin("teapot").meshes[0]
    assert repr(body) == "<Mesh body: 3,160 triangles, 1,601 vertices, 1 instance>"
    assert repr(body.material.texture) == "<Texture body: 512x512, 3 channels>"
    assert len(repr(body.material)) < 400
