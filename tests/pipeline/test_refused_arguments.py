"""Arguments of the public functions that are of no use, such as an array where a word is expected: an InputError of one line
that names function and argument."""

import re
from itertools import product

import numpy as np
import pytest

import clshade
from clshade import course, farm, view
from clshade.errors import InputError
from clshade.pipeline.frame import Frame

ODD = {
    "array": np.array([1.0, 2.0]),
    "words": np.array(["phong", "phong"]),
    "empty": np.zeros(0),
    "scalar array": np.array(2.5),
    "records": np.zeros(2, [("x", "f4")]),
    "lists": [[1, 2], [3]],
    "dict": {"a": np.zeros(3)},
    "bytes": b"phong",
    "class": int,
}
SCENE = clshade.builtin("icosphere", level=0, resolution=(8, 6))
CAMERAS = {1: SCENE.camera}
TURN = farm.parse_frames("1..2")
FRAME = Frame(np.zeros((6, 8, 4), np.float32), {}, SCENE, clshade.Settings(), dict)
ID_FRAME = Frame(FRAME.rgba, {"id": np.zeros((6, 8), np.uint32)}, SCENE, clshade.Settings(layers=("id",)), dict)
CALLS = {
    "check: pixels": lambda odd: clshade.check(FRAME, pixels=odd),
    "check: seed": lambda odd: clshade.check(FRAME, seed=odd),
    "cryptomatte: kinds": lambda odd: clshade.cryptomatte(FRAME, kinds=odd),
    "Frame.save: files": lambda odd: FRAME.save("a", files=odd),
    "tonemap: operator": FRAME.to_png8,
    "Frame.metadata: deterministic": lambda odd: FRAME.arrays(deterministic=odd),
    "flow: frame": lambda odd: clshade.flow(odd, SCENE),
    "flow: to": lambda odd: clshade.flow(ID_FRAME, odd),
    "render: device": lambda odd: clshade.render(SCENE, device=odd),
    "Settings: preset": lambda odd: clshade.render(SCENE, preset=odd),
    "Renderer: forced": lambda odd: clshade.Renderer(SCENE, forced=odd),
    "Renderer: lanes": lambda odd: clshade.Renderer(SCENE, lanes=odd),
    "check: frame": clshade.check,
    "cryptomatte: frame": clshade.cryptomatte,
    "load_environment: path": clshade.load_environment,
    "studio: up": clshade.studio,
    "Camera.from_matrices: matrices": lambda odd: clshade.Camera.from_matrices(odd, np.eye(4)[None], (4, 4)),
    "arguments: scene": course.arguments,
    "save_course: path": lambda odd: course.save(SCENE, odd),
    "draw_poster: saving": lambda odd: view.draw_poster(SCENE, "a", saving=odd),
    "draw_poster: keep_tiles": lambda odd: view.draw_poster(SCENE, "a", keep_tiles=odd),
    "draw_film: bits": lambda odd: view.draw_film(SCENE, CAMERAS, "a.gif", bits=odd),
    "draw_frames: poses": lambda odd: view.draw_film(SCENE, CAMERAS, "a.gif", poses=odd),
    "draw_sheet: scene": view.draw_sheet,
    "draw_frames: overwrite": lambda odd: farm.draw_frames(SCENE, CAMERAS, "a.#.exr", overwrite=odd),
    "draw_frames: scheduler": lambda odd: farm.draw_frames(SCENE, CAMERAS, "a.#.exr", scheduler=odd),
    "draw_frames: saving": lambda odd: farm.draw_frames(SCENE, CAMERAS, "a.#.exr", saving=odd),
    "orbit: camera": lambda odd: farm.orbit(odd, [1], TURN),
    "orbit: numbers": lambda odd: farm.orbit(SCENE.camera, odd, TURN),
    "parse_frames: text": farm.parse_frames,
    "read_cameras: path": lambda odd: farm.read_cameras(odd, SCENE.camera),
    "write_cameras: cameras": lambda odd: farm.write_cameras("a.json", odd),
}
# No refusals: they mean none, or numbers.
TAKEN = {("orbit: numbers", "empty"), ("orbit: numbers", "bytes"), ("Renderer: forced", "empty")}
TAKEN |= {("write_cameras: cameras", "empty")}


@pytest.mark.parametrize(("call", "odd"), [pair for pair in product(CALLS, ODD) if pair not in TAKEN])
def test_refused_in_one_line(call, odd, folder):
    with pytest.raises(InputError) as caught:
        CALLS[call](ODD[odd])
    assert re.match(rf"{call}[:,]", str(caught.value)), caught.value
    assert str(caught.value).isprintable()
    assert not list(folder.iterdir())


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"kinds": ["materials"]}, "kinds: expected one of object, material, instance, found 'materials'"),
        ({"kinds": "object"}, "kinds: expected one or more of object, material, instance, found 'object'"),
        ({"kinds": []}, "kinds: expected one or more of object, material, instance, found []"),
        ({"ranks": 65}, "ranks: expected a whole number from 1 to 64, found 65"),
    ],
)
def test_mattes_are_refused_before_anything_is_drawn(monkeypatch, change, line):
    monkeypatch.setattr("clshade.pipeline.visible.Renderer", None)
    with pytest.raises(InputError, match=re.escape(f"cryptomatte: {line}")):
        clshade.cryptomatte(FRAME, **change)
