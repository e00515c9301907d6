"""The page for images in a browser: values, colors, layers, comparison, keys; with WebGL and without."""

import json

import numpy as np
import pytest
from browsers import WITHOUT_GL, opened, until
from matplotlib import colormaps
from PIL import Image

from clshade.images import exr
from clshade.images.figures import thumbnails
from clshade.images.image_file import color_group, group_channels, read_picture
from clshade.images.statistics import LUMINANCE
from clshade.images.tonemap import OPERATORS, tonemap
from clshade.view import page

pytestmark = pytest.mark.long

HOSTILE = "<img src=x onerror='hacked=1'></script>"
ROWS, COLUMNS = 48, 64

# Draw at one pixel for one with each of the settings, and return the image's part of the canvas, R, G, B, A bytes.
PIXELS = """([width, height, all]) => {
  const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  return all.map((settings) => {
    viewer.set(settings);
    viewer.view = { x: 0, y: 0, zoom: 1 };
    viewer.draw();
    copy.drawImage(viewer.canvas, 0, 0);
    return String.fromCharCode(...copy.getImageData(0, 0, width, height).data);
  });
}"""


def pixels(shown, rows=ROWS, columns=COLUMNS):
    return pixels_of_each(shown, [{}], rows, columns)[0]


def pixels_of_each(shown, settings, rows=ROWS, columns=COLUMNS):
    texts = shown.evaluate(PIXELS, [columns, rows, settings])
    return [np.frombuffer(text.encode("latin-1"), np.uint8).reshape(rows, columns, 4)[:, :, :3] for text in texts]


def ramp():
    """Return (M, N, 3) float32: 1e-5 to 1e4, negative values, infinity, 0."""
    values = np.geomspace(1e-5, 1e4, ROWS * COLUMNS * 3).astype(np.float32)
    values[:3] = -1.0, np.inf, 0.0
    return values.reshape(ROWS, COLUMNS, 3)


def channels_of_a():
    normals = np.zeros((ROWS, COLUMNS, 3), np.float32)
    normals[:, 8:, 2] = -1.0
    normals[:, 16:] = np.float32([0.6, 0.0, -0.8])
    depth = np.linspace(2, 9, ROWS * COLUMNS, dtype=np.float32).reshape(ROWS, COLUMNS)
    depth[:4] = np.inf
    numbers = (np.arange(ROWS * COLUMNS, dtype=np.uint32) * 7919 % 5000).reshape(ROWS, COLUMNS)
    uv = np.stack([depth, -3.0 * depth], axis=-1)
    uv[:4] = 0.25
    places = np.stack([np.full_like(depth, 3.0), *uv.transpose(2, 0, 1)], axis=-1)
    layers = {"RGB": ramp(), "Z": depth, "N": normals, "object_id": numbers, "uv": uv, "P": places}
    return {**layers, HOSTILE: depth[::-1]}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Write a.exr, b.exr, smaller and in half, whose red is larger by 1, and c.png."""
    folder = tmp_path_factory.mktemp("page")
    names = json.dumps({"1": HOSTILE, "3009": "handle"})
    exr.write(folder / "a.exr", channels_of_a(), metadata={"comment": HOSTILE, "objectNames": names})
    exr.write(folder / "b.exr", {"RGB": ramp()[:40, :50] + np.float32([1, 0, 0])}, half=True)
    Image.fromarray(np.resize(np.arange(256, dtype=np.uint8), (ROWS, COLUMNS, 3))).save(folder / "c.png")
    return folder


@pytest.fixture(scope="module")
def written(files):
    names = {HOSTILE: "a.exr", "b": "b.exr", "c": "c.png"}
    page.view({name: read_picture(files / file) for name, file in names.items()}, HOSTILE).save(files / "page.html")
    return files / "page.html"


@pytest.fixture(scope="module")
def shared(browser, written):
    return opened(browser, written)


@pytest.fixture
def shown(shared):
    """Return the page as it is after opening; nothing may have gone wrong at the end."""
    shared.evaluate("""() => {
      viewer.select([...viewer.images.keys()][0]);
      viewer.reference = "b";
      viewer.setMode("single");
      viewer.setLayer(null);
      viewer.pin(null);
      viewer.reset();
      viewer.fit();
    }""")
    shared.mouse.move(400, 590)
    yield shared
    assert shared.faults == []
    assert shared.evaluate("typeof hacked") == "undefined"


def test_tone_maps_are_those_of_the_library(shown):
    """Within one code, which float32 may miss at a step."""
    settings = [{"operator": o, "exposure": e, "marking": False} for o in OPERATORS for e in (0.0, -3.5, 4.0)]
    for setting, picture in zip(settings, pixels_of_each(shown, settings), strict=True):
        off = np.abs(picture - tonemap(ramp(), setting["operator"], setting["exposure"]).astype(int))
        assert off.max() <= 1, setting
        assert (off > 0).mean() < 0.02, setting
    # False color is in stops.
    rgb = np.maximum(ramp(), 1e-30)
    rgb[0, 0] = 1.0
    stops = np.log2(rgb @ LUMINANCE) + 2.0
    expected = colormaps["turbo"](np.clip((stops + 8.0) / 12.0, 0.0, 1.0), bytes=True)[..., :3].astype(int)
    (picture,) = pixels_of_each(shown, [{"inStops": True, "exposure": 2.0, "marking": False}])
    off = np.abs(picture - expected)[1:]
    assert off.max() <= 8  # one of 256 colors
    assert (off > 0).mean() < 0.02


def test_special_values_are_marked_and_a_png_is_shown_as_it_is(shown):
    assert pixels(shown)[0, 0].tolist() == [255, 176, 0]  # infinite before negative
    assert (pixels(shown)[0, 1:] == tonemap(ramp())[0, 1:]).mean() > 0.98
    counts = until(shown, "document.querySelector('#histogram .counts').textContent")
    assert "1 infinite" in counts
    assert "1 negative" in counts
    shown.evaluate("viewer.select('c')")
    until(shown, "viewer.drawn.image.name === 'c'")
    assert (pixels(shown) == np.resize(np.arange(256), (ROWS, COLUMNS, 3))).all()


def test_the_histogram_counts_every_pixel(shown):
    histograms = until(shown, "viewer.layerOf(viewer.image).full?.histograms.map((counts) => [...counts])")
    finite = ramp()[..., 0].astype(float)
    finite = finite[np.isfinite(finite) & (finite > 0)]
    assert histograms[1] == np.histogram(np.log2(finite), np.arange(-256, 257) / 8.0)[0].tolist()
    assert sum(histograms[0]) == ROWS * COLUMNS - 1  # the first pixel's luminance is infinite
    assert shown.evaluate("filledBins([new Uint32Array(BIN_COUNT)])") == [(32 - 8) * 8, (32 + 4) * 8 - 1]  # about 1


def test_the_probe_shows_the_values_of_the_file(shown, files):
    channels = exr.read(files / "a.exr")[0]
    shown.evaluate("viewer.pin({ x: 17, y: 5 })")
    until(shown, "document.querySelector('#layers .place').textContent === '17, 5'")
    exact = shown.evaluate("[...document.querySelectorAll('#layers td')].map((cell) => cell.title).join('\\n')")
    values = {name: float(value) for name, value in (line.rsplit(" ", 1) for line in exact.split("\n") if line)}
    assert set(values) == set(channels)
    for name, plane in channels.items():
        assert plane.dtype.type(values[name]) == plane[5, 17], name
    shown.mouse.move(150, 200)  # the pinned pixel stays
    shown.keyboard.press("Escape")
    shown.mouse.move(152, 200)
    x, y = shown.evaluate("[viewer.hovered.x, viewer.hovered.y]")
    assert until(shown, f"document.querySelector('#layers .place').textContent === '{x}, {y}'")


def test_layers_are_chosen_by_name_and_drawn_by_their_kind(shown):
    expected = thumbnails(exr.flatten(channels_of_a()))
    for name in ("Z", "N", "object_id", "uv", "P"):
        shown.click(f"#layers tr[data-layer={name}] button")
        off = np.abs(pixels(shown) - expected[name].pixels.astype(int))
        assert off.max() <= (0 if name == "object_id" else 2), name  # depths: percentiles of all pixels, and in float32
    assert shown.evaluate("viewer.image.nameOf(viewer.image.layer('object_id'), 3009)") == "handle"
    shown.click("#layers tr[data-layer=N] button")
    shown.click("#layers .components button[data-value='2']")
    assert until(shown, "viewer.component === 2 && viewer.drawn.kind === KIND.quantity")
    # Names appear as text.
    assert shown.title() == HOSTILE
    assert shown.text_content("#panel h1") == HOSTILE
    assert HOSTILE in shown.text_content("#info dl")
    assert shown.locator("img").count() == 0
    x, y = np.argwhere(channels_of_a()["object_id"].T == 1)[0].tolist()
    shown.evaluate(f"viewer.setLayer('object_id'); viewer.hover({{ x: {x}, y: {y} }}, {{ clientX: 9, clientY: 9 }})")
    until(shown, "!document.getElementById('hover').hidden")
    assert shown.text_content("#hover") == f"1  {HOSTILE}"


KEYS = [
    ("e", "viewer.settings.exposure", 0.5),
    ("Shift+ArrowRight", "viewer.settings.operator", "reinhard"),
    ("m", "viewer.settings.marking", False),
    ("r", "viewer.settings", {"exposure": 0, "operator": "srgb", "marking": True, "inStops": False}),
    ("ArrowRight", "viewer.image.layers.some((layer) => layer.name === viewer.layerName)", True),
    ("2", "viewer.selected", "b"),
    ("Shift+Digit2", "[viewer.reference, viewer.mode]", ["b", "wipe"]),
    ("c", "viewer.mode", "difference"),
    (" ", "viewer.mode", "flicker"),
    ("0", "viewer.view.zoom", 1),
    ("f", "viewer.fitted", True),
    ("?", "document.getElementById('help').open", True),
    ("Escape", "document.getElementById('help').open", False),
]


def test_the_keyboard(shown):
    for key, expression, expected in KEYS:
        shown.keyboard.press(key)
        assert shown.evaluate(expression) == expected, key


def test_comparison(shown):
    """The reference is smaller: beyond it nothing is drawn, of the wipe's right side and of the difference."""
    shown.evaluate("viewer.set({ marking: false })")
    a, b = tonemap(ramp()), tonemap(ramp()[:40, :50] + np.float32([1, 0, 0]))
    shown.evaluate("viewer.setMode('wipe'); viewer.setWipe(20 / viewer.canvas.width)")
    picture = pixels(shown).astype(int)
    assert np.abs(picture[:, :20] - a[:, :20]).max() <= 1
    assert np.abs(picture[:40, 20:50] - b[:, 20:]).max() <= 1  # half's rounding included
    assert (picture[40:, 20:] == 42).all()
    assert (picture[:, 50:] == 42).all()
    shown.evaluate("viewer.setMode('difference')")
    picture = pixels(shown)
    dim = np.s_[1:20, :50]  # where half is precise
    assert (picture[dim][..., 0] == 255).all()
    assert (picture[dim][..., 1] <= 3).all()
    assert (picture[40:] == 42).all()
    assert shown.text_content("#images .figures").startswith("2,000 of 2,000 pixels differ")
    shown.keyboard.down("Shift")
    assert np.abs(pixels(shown).astype(int)[:40, :50] - b).max() <= 1
    shown.keyboard.up("Shift")


def test_dragging_and_zooming(shown):
    start = shown.evaluate("viewer.view")
    shown.mouse.move(200, 200)
    shown.mouse.down()
    shown.mouse.move(230, 210)
    shown.mouse.up()
    moved = shown.evaluate("viewer.view")
    assert (moved["x"] - start["x"], moved["y"] - start["y"]) == (30, 10)
    shown.mouse.wheel(0, -240)
    until(shown, f"viewer.view.zoom > {1.9 * start['zoom']}")


NAMES = [
    ["a.R", "a.G", "a.B", "a", "a.RGB", "", ".", ".R", "x.r", "x.R", "x.g"],
    ["N.X", "N.x", "N.Y", "N", "N.XY", "N'"],
    ["Z", "Left.R", "Left.G", "Left.B", "L", "constructor.X", "constructor.Y", "__proto__.U", "__proto__.V"],
]


def test_scripts_group_channels_and_decode_halves_as_the_library_does(shown):
    for names in NAMES:
        planes = {name: np.zeros((1, 1)) for name in names}
        expected = [[title, group.family, list(group.names)] for title, group in group_channels(planes).items()]
        call = "(names) => groupChannels(names).map(({ name, family, channels }) => [name, family, channels])"
        assert shown.evaluate(call, names) == expected
        color = color_group(planes)
        title = shown.evaluate("(names) => colorLayer(groupChannels(names))?.name ?? null", names)
        assert title == (color and color[0])
    halves = np.arange(65536, dtype=np.uint16).view(np.float16).astype(np.float64)
    texts = shown.evaluate("[...valueTable('half', false)].map(String)")
    assert np.array_equal(np.array([float(text.replace("Infinity", "inf")) for text in texts]), halves, equal_nan=True)


def test_without_webgl(launch, written):
    plain = launch(*WITHOUT_GL)
    shown = opened(plain, written)
    assert "No WebGL 2" in shown.text_content("#notice")
    settings = [{"operator": operator, "exposure": 1.5, "marking": False} for operator in OPERATORS]
    for setting, picture in zip(settings, pixels_of_each(shown, settings), strict=True):
        assert np.abs(picture - tonemap(ramp(), setting["operator"], 1.5).astype(int)).max() <= 1, setting
    expected = thumbnails(exr.flatten(channels_of_a()))
    for name in ("Z", "N", "object_id", "uv", "P"):
        shown.evaluate("(name) => viewer.setLayer(name)", name)
        until(shown, "viewer.drawn.layer.name === viewer.layerName")
        assert np.abs(pixels(shown) - expected[name].pixels.astype(int)).max() <= 2, name
    shown.evaluate("viewer.setLayer(null); viewer.setMode('wipe'); viewer.setWipe(20 / viewer.canvas.width)")
    assert (pixels(shown)[41:, 20:] == 42).all()
    assert [fault for fault in shown.faults if "GPU" not in fault and "WebGL" not in fault] == []
    plain.close()


def test_damaged_data_is_said(browser, written, tmp_path):
    text = written.read_text("utf-8")
    start = text.index('id="chunk-0">') + len('id="chunk-0">')
    (tmp_path / "a.html").write_text(text[:start] + "AAAA" + text[start + 40 :], "utf-8")
    shown = browser.new_page()
    shown.goto((tmp_path / "a.html").as_uri())
    assert "damaged" in until(shown, "document.getElementById('notice').textContent")
    shown.close()


def test_in_a_notebook(browser, written, tmp_path):
    """A notebook's document may have a policy of its own, which frames inherit; this one allows what Jupyter's does."""
    text = f"<!DOCTYPE html><html data-ready><body>{page.Page(written.read_text('utf-8'))._repr_html_()}</body></html>"
    (tmp_path / "a.html").write_text(text, "utf-8")
    shown = opened(browser, tmp_path / "a.html")
    inner = shown.frames[1]
    inner.wait_for_selector("html[data-ready]", state="attached")
    assert inner.evaluate("[viewer.drawn.image.width, viewer.canvas.width > 100, origin]") == [COLUMNS, True, "null"]
    assert shown.faults == []
    shown.close()
