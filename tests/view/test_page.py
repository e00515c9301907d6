"""The page for images as text: its data, its escapes, what it lets its scripts do."""

import base64
import html as markup
import json
import re
import zlib

import numpy as np
import pytest
from command_line import assert_refused, listing, run
from pages import Node, parsed
from PIL import Image
from processes import ROOT

from clshade.images import exr
from clshade.images.image_file import Picture, read_picture
from clshade.view import page

HOSTILE = """</script><script>hacked=1</script>"><img src=x onerror='hacked=1'>&amp;%%data%%\u2028"""
BITS = {"half": np.uint16, "float": np.uint32, "uint": np.uint32, "u8": np.uint8, "u16": np.uint16}


def text_of(document: Node, name: str) -> str:
    return next(node.text for node in document.all() if node.attributes.get("id") == name)


def manifest_of(document: Node) -> dict:
    return json.loads(text_of(document, "manifest"))


def decoded(document, described):
    channels = {}
    for channel in described["channels"]:
        bits, values = BITS[channel["type"]], []
        for number in channel["chunks"]:
            planes = np.frombuffer(zlib.decompress(base64.b64decode(text_of(document, f"chunk-{number}"))), np.uint8)
            differences = np.ascontiguousarray(planes.reshape(bits().itemsize, -1).T).view(bits).reshape(-1)
            values.append(np.cumsum(differences, dtype=bits))
        channels[channel["name"]] = channel["type"], np.concatenate(values).reshape(described["height"], -1)
    return channels


@pytest.mark.parametrize("chunk", [1 << 22, 7])
def test_every_bit_is_kept(monkeypatch, chunk):
    monkeypatch.setattr(page, "_CHUNK", chunk)
    bits = np.random.default_rng(5).integers(0, 2**32, (6, 5), np.uint32)
    channels = {"Z": bits.view(np.float32), "id": bits, "R": bits.astype(np.uint16).view(np.float16)}
    document = parsed(page.html({"a": Picture(channels)}).encode())
    (described,) = manifest_of(document)["images"]
    stored = decoded(document, described)
    assert {name: kind for name, (kind, _) in stored.items()} == {"Z": "float", "id": "uint", "R": "half"}
    assert (stored["Z"][1] == bits).all()
    assert (stored["id"][1] == bits).all()
    assert (stored["R"][1] == bits.astype(np.uint16)).all()
    assert (described["width"], described["height"]) == (5, 6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_codes_of_a_png_are_kept(tmp_path, dtype):
    codes = np.resize(np.arange(np.iinfo(dtype).max + 1), (256, 258, 3)).astype(dtype)
    # Pillow writes 16 bits in gray alone.
    Image.fromarray(codes if dtype is np.uint8 else codes[:, :, 0]).save(tmp_path / "a.png")
    picture = read_picture(tmp_path / "a.png")
    kind, stored = page.stored_bits(next(iter(picture.channels.values())), picture.bits)
    assert kind == f"u{dtype().itemsize * 8}"
    assert (stored == codes[:, :, 0]).all()
    assert page.info(picture)["encoded"] is True


def test_nothing_of_a_file_becomes_markup():
    header = {HOSTILE: HOSTILE, "objectNames": json.dumps({"1": HOSTILE}), "instanceNames": json.dumps({"2": "b"})}
    picture = Picture({"R": np.zeros((2, 2), np.float32), HOSTILE: np.zeros((2, 2), np.uint32)}, header)
    document = parsed(page.html({HOSTILE: picture}, title=HOSTILE).encode())
    plain = page.html({"a": Picture({"R": picture.channels["R"], "b": picture.channels[HOSTILE]})})
    assert [node.tag for node in document.all()] == [node.tag for node in parsed(plain.encode()).all()]
    manifest = manifest_of(document)
    (image,) = manifest["images"]
    assert manifest["title"] == image["name"] == image["channels"][1]["name"] == HOSTILE
    assert image["info"]["names"] == {"object_id": {"1": HOSTILE}, "instance_id": {"2": "b"}}
    assert document.all("title")[0].text == HOSTILE
    made = page.view({"a": picture}, HOSTILE)
    (frame,) = parsed(made._repr_html_().encode()).all()
    assert (frame.tag, frame.attributes["srcdoc"]) == ("iframe", made.html)
    assert repr(made).isprintable()


def test_scripts_may_not_reach_the_network():
    text = page.html({}, extra_scripts=["let extra = 1;"])
    policy = markup.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1])
    directives = dict(part.strip().split(" ", 1) for part in policy.split(";"))
    assert (directives["default-src"], directives["connect-src"]) == ("'none'", "'none'")
    assert "unsafe" not in policy
    scripts = [node.text for node in parsed(text.encode()).all("script") if not node.attributes]
    assert scripts[-1] == "let extra = 1;"
    assert directives["script-src"].split() == [page._hash(script) for script in scripts]
    assert not re.search(r"https?://", text)
    assert "connect-src 'self'" in markup.unescape(page.html({}, connect="'self'"))


def test_names_of_another_form_are_left_out():
    for names in ("{", "[1]", 5, "null", "[" * 100_000):
        picture = Picture({"R": np.zeros((1, 1), np.float32)}, {"objectNames": names})
        assert page.info(picture)["names"] == {}


def test_every_part_is_used_and_installed():
    parts = {path.name for path in (ROOT / "clshade" / "view" / "page").iterdir()}
    assert parts == {*page.SCRIPTS, *page.SHADERS, *page.LIVE_SCRIPTS, "page.html", "style.css", "live.css"}
    (patterns,) = re.findall(r'^"clshade.view" = \[(.*)\]$', (ROOT / "pyproject.toml").read_text(), re.M)
    assert {f'"page/*.{name.rpartition(".")[2]}"' for name in parts} == set(patterns.split(", "))


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exr.write("a.exr", {name: np.ones((2, 3)) for name in "RGB"})
    (tmp_path / "other").mkdir()
    exr.write("other/a.exr", {"Z": np.ones((3, 2))})


def images_of(path):
    return [image["name"] for image in manifest_of(parsed(path.read_bytes()))["images"]]


def test_the_command_writes_a_page(files, tmp_path, capsys):
    code, out, err = run(capsys, "view", "a.exr")
    assert (code, out) == (0, "")
    assert re.fullmatch(r"clshade: wrote a\.html \(0\.\d MB\)", err[0])
    assert images_of(tmp_path / "a.html") == ["a.exr"]
    code, _, _ = run(capsys, "view", "a.exr", "other/a.exr", "-o", "b.html", "--exposure", "-2", "a.exr")
    assert code == 0
    assert images_of(tmp_path / "b.html") == ["a.exr", "other/a.exr", "a.exr (2)"]


def test_an_existing_page_is_replaced_when_asked_alone_and_not_by_a_full_disk(files, tmp_path, capsys, monkeypatch):
    page = tmp_path / "a.html"
    page.write_text("mine")
    assert_refused(run(capsys, "view", "a.exr"), "a.html exists already: -o a.html replaces it")

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("os.fsync", full)
        assert_refused(run(capsys, "view", "a.exr", "-o", "a.html"), "a.html", "No space left on device")
    assert page.read_text() == "mine"
    assert listing(tmp_path) == ["a.exr", "a.html", "other", "other/a.exr"]
    assert run(capsys, "view", "a.exr", "-o", "a.html")[0] == 0
    assert images_of(page) == ["a.exr"]
