"""The page of a live view: the viewer of images, and scripts that connect it to the server."""

from __future__ import annotations

from importlib.resources import files

from .page import html

SCRIPTS = tuple(
    f"live{name}.js" for name in ("_connection", "_camera", "_motion", "_waiting", "_panel", "")
)  # in this order


def live_page(name: str, host: str) -> str:
    """Return the page. name: of the scene. host: that it may connect to, such as 127.0.0.1:8000."""
    folder = files("clshade.view").joinpath("page")
    scripts = [folder.joinpath(script).read_text("utf-8") for script in SCRIPTS]
    style = folder.joinpath("live.css").read_text("utf-8")
    return html({}, extra_scripts=scripts, extra_styles=[style], title=name, connect=f"ws://{host}")
