"""Live views for tests: a small scene, its source, and sessions whose time stands still."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

import clshade
from clshade.cli import view as live_view
from clshade.cli.main import _parser
from clshade.cli.options import join_values
from clshade.view.live_scene import LiveScene, Source
from clshade.view.live_session import Drawing, Session, Task

SMALL = ("quads", "--resolution", "40,30")


def source_of(*arguments: object) -> Source:
    """Return the source of `clshade view ARGUMENTS`."""
    command = join_values(["view", *map(str, arguments)])
    parsed = _parser(command).parse_args(command)
    return live_view.source_of(parsed, *parsed.files)


@dataclass
class Clock:
    now: float = 0.0

    def __call__(self) -> float:
        return self.now


def session_of(*arguments: object) -> tuple[Session, Clock]:
    clock = Clock()
    return Session(LiveScene(source_of(*(arguments or SMALL))), clock), clock


def next_drawing(session: Session, ms: float = 1.0) -> Drawing:
    """Draw what is due, and let the session believe that it took `ms`."""
    task = session.due()
    assert isinstance(task, Task), task
    drawing = session.draw(task)
    session.drawn(task, ms)
    return drawing


def all_drawings(session: Session, clock: Clock) -> list[Drawing]:
    """Draw until nothing is due, waiting where the session asks for it."""
    drawings = []
    while (due := session.due()) is not None:
        if isinstance(due, float):
            clock.now += due
            continue
        drawings.append(next_drawing(session))
    return drawings


def unpacked(message: bytes) -> tuple[dict[str, Any], dict[str, clshade.base.arrays.Array]]:
    """Return the header and the arrays of a binary message."""
    length = int.from_bytes(message[:4], "little")
    header = json.loads(message[8 : 8 + length])
    arrays = {}
    shape = header["height"], header["width"]
    for entry in header["arrays"]:
        channels = 4 if entry["name"] == "rgba" else 1
        count = shape[0] * shape[1] * channels
        array = np.frombuffer(message, entry["type"], count, 8 + length + entry["offset"])
        arrays[entry["name"]] = array.reshape(*shape, channels) if channels > 1 else array.reshape(shape)
    return header, arrays
