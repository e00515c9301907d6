"""The page of a live view."""

from __future__ import annotations

from importlib.resources import files


def live_page(name: str) -> str:
    script = files("clshade.view").joinpath("page").joinpath("live.js").read_text("utf-8")
    return f"<!DOCTYPE html><meta charset=utf-8><title>x</title><body><canvas id=c width=800 height=600></canvas><script>{script}</script>"
