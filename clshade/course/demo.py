"""The demos: a scene, its figures as EXR and PNG, and all of them on a contact sheet."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.text_tables import create_folder
from ..errors import ClshadeError, InputError
from ..images import marks
from ..images.metrics import scale_end
from ..scene.builtin.scenes import builtin
from ..scene.formats.load import load
from ..scene.formats.reading import as_texture
from ..scene.lights import plain_lights
from ..scene.model import Scene
from .figures import LIGHTS, Figure, build_all, draw_all, pairs

SCENE, TEXTURE = "h3.npy", "cat_diff.png"  # used if they are in the current folder
_OPTIONS = {
    "--scene": ("FILE", f"course scene (default: ./{SCENE} if there is one, else a built-in scene)"),
    "--texture": ("FILE", f"for demotmap.py (default: ./{TEXTURE} if there is one); demo.py draws the vertex colors"),
    "--out": ("DIR", "folder of the images (default: the current one)"),
    "--resolution": ("N,M", "columns and rows, in place of the scene's; the pixels become square"),
    "--device": (None, "pocl, intel, part of a platform's name ... (default: CLSHADE_DEVICE, PoCL)"),
}


def _resolution(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        columns, rows = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--resolution: expected two whole numbers such as 512,512, found {text!r}") from None
    return columns, rows


def find_scene(options: argparse.Namespace, mapped: bool) -> Scene:
    """Return the scene named on the command line, in the current folder or built in; with a texture if `mapped`."""
    texture = options.texture if options.texture or not os.path.isfile(TEXTURE) else TEXTURE
    path, resolution = options.scene, _resolution(options.resolution)
    if path is None and os.path.isfile(SCENE) and (texture or not mapped):
        path = SCENE
    if path is None:
        scene = builtin("course", **({} if resolution is None else {"resolution": resolution}))
        if mapped and options.texture:
            scene = with_texture(scene, texture)
    elif mapped and not texture:
        raise InputError(f"--texture: expected an image for {path}, found none")
    else:
        scene = load(path, texture=texture if mapped else None, resolution=resolution)
    if len(scene.lights) != LIGHTS:
        raise InputError(f"{scene.name}: lights: expected three, found {len(scene.lights)}")
    if scene.preset != "course":
        raise InputError(f"{path}: expected a course scene (.npy), found a mesh without lights and camera")
    return scene


def with_texture(scene: Scene, path: str | None) -> Scene:
    """Return the scene with an image file as its texture map, or without one."""
    texture = None if path is None else as_texture(path, srgb=False, lookup="course")
    mesh = scene.meshes[0]
    return replace(scene, meshes=(replace(mesh, material=replace(mesh.material, texture=texture)),))


def save(scene: Scene, figure: Figure, folder: Path) -> None:
    """Write the figure as EXR (linear, unclamped) and as PNG (clamped, as the course shows it)."""
    from ..images import exr, png
    from ..scene.geometry import camera_metadata

    about = {"title": figure.title, "scene": scene.name, "settings": "preset=course"}
    metadata = {**camera_metadata(scene.camera), **about, "renderTimeSeconds": figure.milliseconds / 1e3}
    exr.write(folder / f"{figure.stem}.exr", figure.linear, metadata=metadata)
    png.write(folder / f"{figure.stem}.png", figure.picture)


def _numbers(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in vector) + ")"


def shown(scene: Scene, figure: Figure) -> marks.Panel:
    """Return a panel of the figure, clamped, with the position and intensity of its lights and its drawing time."""
    lights = [plain_lights(scene.name, scene.lights)[k] for k in figure.lights]
    lines = [f"light at {_numbers(light.position)}, intensity {_numbers(light.intensity)}" for light in lights]
    text = "\n".join([*lines, f"{figure.milliseconds:.1f} ms"])
    return marks.Panel(marks.reduced(figure.picture), figure.title, text)


def difference(gouraud: Figure, phong: Figure) -> marks.Panel:
    """Return a panel of the difference of two figures in the channel that differs most."""
    apart = np.abs(phong.linear - gouraud.linear).max(axis=2)
    white = scale_end(apart)
    level = np.clip(apart / white * 255.0, 0.0, 255.0).astype(np.uint8)
    text = f"|figure {phong.number} - figure {gouraud.number}|, black: 0, white: {white:.2g} or more"
    text += f"\nmean {apart.mean():.2g}, largest {apart.max():.2g}"
    return marks.Panel(marks.reduced(level), f"phong - gouraud: {phong.what}", text)


def _run(options: argparse.Namespace, figures: Sequence[Figure], sheet_name: str) -> None:
    from ..base.progress_bar import Bar
    from ..images import png
    from ..pipeline.programs import running_time

    if options.device:
        os.environ["CLSHADE_DEVICE"] = options.device
    scene = find_scene(options, figures[0].mapped)
    folder = create_folder(options.out)
    importing = threading.Thread(target=importlib.import_module, args=("matplotlib.ft2font",), daemon=True)
    importing.start()
    build_all(scene, figures)
    importing.join()
    with Bar(len(figures), scene.name, clock=running_time, hidden=False, left=True) as bar:
        for _ in draw_all(scene, figures):
            bar.advance()
    with ThreadPoolExecutor(1) as writer:
        written = [writer.submit(save, scene, figure, folder) for figure in figures]
        panels = [shown(scene, figure) for figure in figures] + [difference(*pair) for pair in pairs(figures)]
        columns, rows = scene.camera.resolution
        size = f"{scene.name}, {scene.face_count} triangles, {columns} x {rows}"
        heading = f"{size}; ambient light {_numbers(scene.ambient)}; times: one call, programs built before"
        png.write(folder / sheet_name, marks.compose_sheet(panels, heading))
        for result in written:
            result.result()
    print(f"{len(figures)} figures as .exr and .png and {sheet_name} in {folder.resolve()}")


def main(description: str, figures: Sequence[Figure], sheet_name: str) -> int:
    """Run a demo; return its exit code: 0 done, 2 bad input."""
    parser = argparse.ArgumentParser(description=description)
    for option, (metavar, text) in _OPTIONS.items():
        parser.add_argument(option, metavar=metavar, help=text)
    parser.set_defaults(out=".")
    try:
        _run(parser.parse_args(), figures, sheet_name)
    except ClshadeError as error:
        print(f"{Path(sys.argv[0]).name}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    return 0
