"""Display of frames and scenes in notebooks: through IPython's formatters if installed, else by their methods."""

import io
import json
import re
import sys
import types
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageShow

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
    ids, rgb = np.arange(48, dtype=np.uint32).reshape(6, 8), rgba[..., :3].copy()
    return frame_of(
        rgba, {"Z": depth, "id": ids, "N": normals, "P": 7.0 * normals, "uv": uv, "albedo": rgb, "barycentrics": rgb}
    )


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


@pytest.mark.parametrize(("shape", "small"), [((700, 1024), (700, 1024)), ((1025, 4), (513, 2))])
def test_large_frames_are_reduced(shape, small):
    assert decoded(frame_of(np.ones((*shape, 4)))._repr_png_()).shape == (*small, 3)


def test_the_figure_has_every_layer(frame, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it now raises ImportError
    figure = frame.plot_layers()
    assert [a.get_title().split("\n")[0] for a in figure.axes if a.images] == ["RGB", "A", *frame.layers]
    assert decoded(figure._repr_png_()).std() > 10


def test_show_opens_a_viewer_outside_of_notebooks(frame, monkeypatch):
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
    manifest = json.loads(re.search(r'id="manifest">(.*?)</script>', made.html)[1])
    assert manifest["settings"] == {"operator": "srgb", "exposure": -1.0}
    (image,) = manifest["images"]
    assert image["name"] == "quads"
    assert image["info"]["header"]["scene"].startswith("quads, ")
    assert '"operator": "none"' in frame_of(np.zeros((2, 2, 4)), preset="course").view().html
    with pytest.raises(OutputError, match="no folder"):
        frame.view(tmp_path / "none" / "a.html")


def drawn(monkeypatch):
    calls = []

    def render(scene, **options):
        calls.append((scene, options))
        columns, rows = scene.camera.resolution
        return frame_of(np.ones((rows, columns, 4)))

    monkeypatch.setattr("clshade.pipeline.renderer.render", render)
    return calls


@pytest.mark.parametrize(("resolution", "small"), [((100, 50), (100, 50)), ((16384, 3), (256, 1))])
def test_a_scene_is_drawn_small(monkeypatch, resolution, small):
    calls = drawn(monkeypatch)
    scene = clshade.builtin("quads")
    scene = replace(scene, camera=scene.camera.with_resolution(resolution))
    bundle, _ = pytest.importorskip("IPython.core.formatters").DisplayFormatter().format(scene)
    assert set(bundle) == {"text/plain", PNG}
    ((drawn_scene, options),) = calls
    assert drawn_scene.camera.resolution == small
    assert (drawn_scene.camera.plane == scene.camera.plane, options) == (True, {"samples": 1})  # the same view
    assert decoded(bundle[PNG]).shape == (small[1], small[0], 3)
    assert bundle["text/plain"].startswith(f"<Scene quads: {scene.face_count} triangles, ")
    assert f"{resolution[0]}x{resolution[1]}" in bundle["text/plain"]


@pytest.mark.parametrize("error", [DeviceError("no device:\nnone"), MemoryError()])
def test_a_scene_that_cannot_be_drawn_is_text(monkeypatch, error):
    def render(*_, **__):
        raise error

    monkeypatch.setattr("clshade.pipeline.renderer.render", render)
    bundle = clshade.builtin("quads")._repr_mimebundle_(include=None, exclude=None)
    assert list(bundle) == ["text/plain"]
    assert bundle["text/plain"].splitlines()[1:] == [f"not drawn: {str(error).replace(chr(10), ' ') or 'MemoryError'}"]


def test_a_scene_on_the_device(opened):
    bundle = clshade.builtin("quads")._repr_mimebundle_()
    assert max(decoded(bundle[PNG]).shape) <= notebook.SCENE_SIDE
    assert decoded(bundle[PNG]).std() > 10
