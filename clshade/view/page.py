"""A self-contained HTML page that shows HDR images: every value of every channel, no network."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import html as markup
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from ..base import atomic_files
from ..base.arrays import Array
from ..base.atomic_files import Path
from ..base.json_values import in_line
from ..errors import InputError
from ..images.image_file import Picture, color_group, group_channels
from ..images.layers import LAYER_TABLE
from ..images.tonemap import Operator, checked

SCRIPTS = (
    *("images.js", "statistics.js", "shading.js", "display_webgl.js", "overlay.js"),
    *("viewer.js", "panels.js", "keys.js", "main.js"),
)  # in this order: each may use what those before it declare
LIVE_SCRIPTS = ("live_controls.js", "live.js")
SHADERS = ("tonemap.glsl", "display.glsl")
MAX_EXPOSURE = 100.0  # stops that the page takes: its arithmetic is float32
_CHUNK = 1 << 22  # values of a chunk: browsers limit the length of a string
_LEVEL = 5  # of deflate
_COLORMAPS = {"quantity": "viridis", "stops": "turbo"}  # matplotlib's


@dataclass(frozen=True)
class Page:
    """A page as text. Notebooks show it in an iframe, which a static export keeps."""

    html: str
    title: str = "clshade"

    def __repr__(self) -> str:
        return f"<Page {in_line(self.title)}, {len(self.html) / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{markup.escape(self.html)}" sandbox="allow-scripts" allow="fullscreen" width="100%" '
            'height="640" style="border: 0"></iframe>'
        )

    def save(self, path: Path) -> int:
        """Write the page to a file, atomically, and return its size in bytes. Raises OutputError."""
        data = self.html.encode()
        atomic_files.write_bytes(path, data)
        return len(data)


def html(
    images: Mapping[str, Picture],
    *,
    extra_scripts: Sequence[str] = (),
    extra_styles: Sequence[str] = (),
    title: str = "clshade",
    tonemap: Operator = "srgb",
    exposure: float = 0.0,
    connect: str = "'none'",
) -> str:
    """Return the page that shows the images, the first of them first.

    images: name -> image; may be empty for a page whose images come from an extra script.
    extra_scripts: JavaScript that runs last, and finds the `Viewer` as `viewer`. extra_styles: CSS after the page's own.
    tonemap, exposure: the first ones, to which a reset returns.
    connect: where scripts may connect to, a source list of the Content Security Policy's `connect-src`.
    """
    settings = checked_settings(tonemap, exposure)
    scripts, style = [*map(_part, SCRIPTS), *extra_scripts], "\n".join([_part("style.css"), *extra_styles])
    texts: list[Future[str]] = []
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # deflate releases the GIL
        try:
            described = [_described(name, picture, threads, texts) for name, picture in images.items()]
            chunks = [_block("text/plain", f"chunk-{number}", text.result()) for number, text in enumerate(texts)]
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)  # after an error or Ctrl-C it starts nothing more
            raise
    first = _first_chunks(images, described)
    manifest = {"title": title, "settings": settings, "images": described, "colormaps": _colormaps()}
    # No markup can begin in the JSON: in an HTML script only `<` can begin it.
    manifest_text = json.dumps(manifest, allow_nan=False).replace("<", "\\u003c")
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src "
        f"{' '.join(map(_hash, scripts))}; connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
    data = [_block("application/json", "manifest", manifest_text)]
    data += [_block("x-shader/x-fragment", name, _part(name)) for name in SHADERS]
    data += [chunk for number, chunk in enumerate(chunks) if number in first]
    values = {
        "policy": markup.escape(policy),
        "title": markup.escape(title.encode("utf-8", "replace").decode()),  # a file's name may hold any bytes
        "style": f"<style>{style}</style>",
        "data": "\n".join(data),
        "scripts": "\n".join(f"<script>{script}</script>" for script in scripts),
        "rest": "\n".join(chunk for number, chunk in enumerate(chunks) if number not in first),
    }
    pieces = _part("page.html").split("%%")  # text and names of values in turn
    return "".join(values[piece] if number % 2 else piece for number, piece in enumerate(pieces))


def view(
    images: Mapping[str, Picture], title: str = "clshade", *, tonemap: Operator = "srgb", exposure: float = 0.0
) -> Page:
    """Return the page that shows the images, see `html`."""
    return Page(html(images, title=title, tonemap=tonemap, exposure=exposure), title)


def live_page(name: str, host: str) -> str:
    """Return the page of a live view: the viewer of images, and scripts that connect it to the server.

    name: the scene's. host: that it may connect to, such as 127.0.0.1:8000.
    """
    scripts = [_part(script) for script in LIVE_SCRIPTS]
    return html({}, extra_scripts=scripts, extra_styles=[_part("live.css")], title=name, connect=f"ws://{host}")


def checked_settings(tonemap: Operator, exposure: float) -> dict[str, Any]:
    """Return the page's settings. Raises InputError for others than `clshade.images.tonemap` takes."""
    stops = checked(tonemap, exposure)
    return {"operator": tonemap, "exposure": max(-MAX_EXPOSURE, min(MAX_EXPOSURE, stops))}


@cache
def _part(name: str) -> str:
    """Return a file of the page."""
    return (files("clshade.view") / "page" / name).read_text("utf-8")


def _hash(text: str) -> str:
    """Return a source expression of the Content Security Policy that allows this inline text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _block(kind: str, name: str, text: str) -> str:
    return f'<script type="{kind}" id="{name}">{text}</script>'


def _described(name: str, picture: Picture, threads: ThreadPoolExecutor, texts: list[Future[str]]) -> dict[str, Any]:
    """Return an image's description, and append the chunks of its channels to `texts`."""
    rows, columns = picture.shape
    channels = []
    for channel, plane in picture.channels.items():
        kind, bits = stored_bits(plane, picture.bits)
        start, values = len(texts), bits.reshape(-1)
        texts += [threads.submit(_encoded, values[k : k + _CHUNK]) for k in range(0, values.size, _CHUNK)]
        channels.append({"name": channel, "type": kind, "chunks": list(range(start, len(texts)))})
    return {"name": name, "width": columns, "height": rows, "channels": channels, "info": info(picture)}


def _first_chunks(images: Mapping[str, Picture], described: Sequence[dict[str, Any]]) -> set[int]:
    """Return the numbers of the chunks that the page draws first: they stand before its scripts, the others behind."""
    if not images:
        return set()
    picture = next(iter(images.values()))
    color = color_group(picture.channels)
    names = group_channels(picture.channels)[color[0]].names if color else tuple(picture.channels)[:1]
    return {number for row in described[0]["channels"] if row["name"] in names for number in row["chunks"]}


def info(picture: Picture) -> dict[str, Any]:
    """Return what the page knows about an image besides its pixels, for JSON.

    encoded: whether its colors are sRGB-encoded. header: attribute -> text. names: layer -> number -> name, without
    attributes in which another program keeps something else.
    """
    header = {in_line(name): in_line(value) for name, value in picture.header.items()}
    names = {}
    for layer, row in LAYER_TABLE.items():
        with contextlib.suppress(KeyError, TypeError, ValueError, RecursionError, AttributeError):
            names[layer] = {number: str(name) for number, name in json.loads(picture.header[row.names]).items()}
    return {"encoded": bool(picture.bits), "header": header, "names": names}


def stored_bits(plane: Array, bits: int = 0) -> tuple[str, Array]:
    """Return the type in which the page keeps a channel, and its bits as unsigned integers.

    plane: (M, N). bits: of the codes of a PNG, whose values are code/(2^bits - 1); 0 for others.
    Types: half, float, uint; u8 and u16 for codes. float64 is rounded to float, as in an EXR.
    """
    if bits:
        return f"u{bits}", np.rint(plane.astype(np.float64) * (2**bits - 1)).astype(f"u{bits // 8}")
    if plane.dtype.kind in "iub":
        return "uint", np.ascontiguousarray(plane, dtype=np.uint32)
    if plane.dtype.kind != "f":
        raise InputError(f"view: channels: expected floats or whole numbers, found type {plane.dtype}")
    if plane.dtype == np.float16:
        return "half", np.ascontiguousarray(plane).view(np.uint16)
    with np.errstate(over="ignore", invalid="ignore"):
        return "float", np.ascontiguousarray(plane, dtype=np.float32).view(np.uint32)


def _encoded(values: Array) -> str:
    """Encode unsigned integers: differences of consecutive ones, modulo 2^bits, one byte plane after another.

    Neighbors have similar bits, so that the high bytes of the differences are nearly constant: a rendered image with all
    layers takes three quarters of the space that deflated byte planes of its values take.
    """
    differences = np.diff(values, prepend=values.dtype.type(0))
    planes = differences.astype(f"<u{values.itemsize}").view(np.uint8).reshape(-1, values.itemsize).T
    return base64.b64encode(zlib.compress(planes.tobytes(), _LEVEL)).decode()


@cache
def _colormaps() -> dict[str, str]:
    """Return colormaps of 256 colors by purpose, R, G, B bytes in base64."""
    from matplotlib import colormaps

    colors = {purpose: colormaps[name](np.arange(256), bytes=True)[:, :3] for purpose, name in _COLORMAPS.items()}
    return {purpose: base64.b64encode(rgb.tobytes()).decode() for purpose, rgb in colors.items()}
