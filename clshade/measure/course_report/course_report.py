"""`report SCENE --course`: the page of one course scene."""

from __future__ import annotations

from pathlib import Path

from ...base import atomic_files
from ...errors import InputError
from ...pipeline.opencl.device import shared_device
from ...scene.model import Scene
from . import content, page

OTHERS = {
    ".pdf": ": a browser prints the page as PDF",
    **dict.fromkeys((".md", ".csv", ".json", ".png", ".exr", ".npy"), ""),
}


def output_path(out: str | Path) -> Path:
    """Return the name of the page: `out`, with .html unless it ends so.

    Raises InputError for the extension of another format, OutputError for a file that cannot be written.
    """
    path = Path(out)
    if path.suffix.lower() in OTHERS:
        expected = "a name that ends in .html"
        raise InputError(f"--out: expected {expected}, found {atomic_files.shown(path)}{OTHERS[path.suffix.lower()]}")
    if path.suffix.lower() not in (".html", ".htm") and path.name not in ("", ".."):
        path = path.with_name(f"{path.name}.html")
    atomic_files.check(path)
    return path


def run(scene: Scene, source: str, out: str | Path, version: str) -> Path:
    """Write the page, and return its name.

    source: what the scene was loaded from; a texture of the course that lies beside it is used if the scene has none.
    out: see `output_path`. version: of clshade. The device is the environment's, see `open_device`, because the course's
    functions use that.
    Raises InputError for a scene that they cannot draw, DeviceError and OutputError.
    """
    path = output_path(out)
    content.check(scene)
    scene = content.with_texture_beside(scene, source)
    atomic_files.write_bytes(path, page.html(content.gather(scene, shared_device()), version))
    return path
