"""Seconds from a command to its picture: with an empty cache, after another scene, and once all is compiled.

    python demos/first_picture.py teapot spot.obj helmet.glb        # two minutes a round, of which the medians count

`cold`: with an empty cache; `next`: at once after another scene; `warm`: when what is compiled ahead is compiled; `png`:
without the EXR; `f3d`: by that package, if it is installed, as a PNG of this size. Each takes its turn in each round.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections import defaultdict
from importlib import util
from pathlib import Path
from tempfile import TemporaryDirectory

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()

import numpy as np  # noqa: E402

OTHER = "icosphere"  # the scene before `next`
F3D = """
import sys, f3d
f3d.Engine.autoload_plugins()
engine = f3d.Engine.create_egl()
engine.window.size = 800, 600
engine.scene.add(sys.argv[1])
engine.window.render_to_image().save(sys.argv[2])
"""


def seconds(folder: str, scene: str, *options: str, cache: str = "cache") -> float:
    """Return how long `render` takes for the scene, 800x600 with 4 samples a pixel."""
    paths = [str(CHECKOUT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "XDG_CACHE_HOME": os.path.join(folder, cache)}
    if cache != "cache":
        environment["CLSHADE_COMPILE_AHEAD"] = "0"  # it would take from the next
    command = [sys.executable, "-m", "clshade", "render", scene, "-o", os.path.join(folder, "image"), *options]
    return run(command, environment)


def run(command: list[str], environment: dict[str, str] | None = None) -> float:
    start = time.perf_counter()
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def wait_for_programs(folder: str) -> None:  # compiled ahead; at most some minutes
    left = 0 if os.environ.get("CLSHADE_COMPILE_AHEAD") == "0" else 300
    while left and not Path(folder, "cache", "clshade", "compiled-ahead").exists():
        time.sleep(1.0)
        left -= 1


def measure(scene: str) -> dict[str, float]:
    with TemporaryDirectory() as folder:
        columns = {"cold": seconds(folder, scene, cache="first")}
        seconds(folder, OTHER)
        columns["next"] = seconds(folder, scene)
        wait_for_programs(folder)
        seconds(folder, scene)
        columns |= {"warm": seconds(folder, scene), "png": seconds(folder, scene, "--formats", "png")}
        if util.find_spec("f3d") is not None and os.path.exists(scene):
            columns["f3d"] = run([sys.executable, "-c", F3D, scene, os.path.join(folder, "f3d.png")])
        return columns


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="built-in scenes, or files")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    times: dict[str, dict[str, list[float]]] = {scene: defaultdict(list) for scene in arguments.scenes}
    for _ in range(arguments.rounds):
        for scene in arguments.scenes:
            for column, value in measure(scene).items():
                times[scene][column].append(value)
    for scene, columns in times.items():
        medians = "  ".join(f"{column} {np.median(values):.2f}" for column, values in columns.items())
        print(f"{os.path.basename(scene):24}{medians}")
    return 0


if __name__ == "__main__":
    interrupts.run(main)
