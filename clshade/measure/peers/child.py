"""A renderer in a process of its own: `python -m clshade.measure.peers.child NAME SCENE SAMPLES THREADS`.

It opens the scene, a pickle, and answers each line of standard input with a line of JSON: to `draw` with the milliseconds
of a frame, to a path after having written the last frame there. What libraries print goes to standard error.
"""

from __future__ import annotations

import json
import os
import pickle
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import ClshadeError
from . import PEERS, opener_of
from .drawing import Drawer, Larger


def opened(name: str, path: str, samples: int, threads: int) -> Drawer:
    """Return the renderer of this name with a pickled scene, which this process's parent has written."""
    scene = pickle.loads(Path(path).read_bytes())
    opener = opener_of(name)
    if samples > 1 and not PEERS[name].samples:
        return Larger(opener, name, scene, samples, threads)
    return opener(name, scene, samples, threads)


def serve(open_: Callable[[], Drawer]) -> int:
    """Answer standard input until it ends. open_: makes the renderer; a ClshadeError of it is the answer."""
    channel = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def reply(**fields: object) -> None:
        channel.write(json.dumps(fields) + "\n")
        channel.flush()

    try:
        drawer = open_()
    except ClshadeError as error:
        reply(missing=str(error))
        return 0
    reply(title=drawer.title)
    picture = None
    for line in sys.stdin:
        request = line.rstrip("\n")
        if request == "draw":
            start = time.perf_counter()
            picture = drawer.draw()
            reply(ms=(time.perf_counter() - start) * 1e3)
        elif picture is not None:
            np.savez(request, **picture._asdict())
            reply(wrote=request)
    return 0


def main(arguments: Sequence[str]) -> int:
    name, path, samples, threads = arguments
    return serve(partial(opened, name, path, int(samples), int(threads)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
