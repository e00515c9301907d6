"""The page of a live view: the viewer of images, and scripts that connect it to the server."""

from __future__ import annotations

from .page import html, part

SCRIPTS = ("live_connection.js", "live_camera.js", "live_motion.js", "live_panel.js", "live.js")  # in this order


def live_page(name: str, host: str) -> str:
    """Return the page. name: of the scene. host: that it may connect to, such as 127.0.0.1:8000."""
    return html(
        {},
        extra_scripts=[part(script) for script in SCRIPTS],
        extra_styles=[part("live.css")],
        title=name,
        connect=f"ws://{host}",
    )
