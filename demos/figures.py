"""The page FIGURES.md: seconds from a command to its picture, time and error of a frame, and its time beside OpenGL's.

    python demos/figures.py --out demos                    # half an hour on two cores
    python demos/figures.py --only pictures spot.obj helmet.glb

Pictures: `cold` with an empty cache, `next` at once after another scene, `warm` when what is compiled ahead is compiled,
`png` without the EXR, `f3d` by that package, if it is installed. Each takes its turn in each round; medians count.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterable
from importlib import util
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()

import numpy as np  # noqa: E402

SCENES = ["teapot", "torus_knot", "box_room"]
OTHER = "icosphere"  # the scene before `next`
F3D = """
import sys, f3d
f3d.Engine.autoload_plugins()
engine = f3d.Engine.create_egl()
engine.window.size = 800, 600
engine.scene.add(sys.argv[1])
engine.window.render_to_image().save(sys.argv[2])
"""


def run_clshade(folder: str, *words: str, cold: bool = False) -> float:
    """Run a command of clshade with the folder's cache, or with an empty one; return its seconds."""
    paths = [str(CHECKOUT), *filter(None, [os.environ.get("PYTHONPATH")])]
    cache = os.path.join(folder, "first" if cold else "cache")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "XDG_CACHE_HOME": cache}
    if cold:
        environment["CLSHADE_COMPILE_AHEAD"] = "0"  # it would take time from the next command
    return run([sys.executable, "-m", "clshade", *words], environment)


def run(command: list[str], environment: dict[str, str] | None = None) -> float:
    start = time.perf_counter()
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def wait_for_programs(folder: str) -> None:  # compiled ahead; at most some minutes
    left = 0 if os.environ.get("CLSHADE_COMPILE_AHEAD") == "0" else 300
    while left and not Path(folder, "cache", "clshade", "compiled-ahead").exists():
        time.sleep(1.0)
        left -= 1


def seconds_to_picture(scene: str) -> dict[str, float]:
    with TemporaryDirectory() as folder:
        render = ("render", scene, "-o", os.path.join(folder, "image"))
        columns = {"cold": run_clshade(folder, *render, cold=True)}
        run_clshade(folder, "render", OTHER, "-o", os.path.join(folder, "other"))
        columns["next"] = run_clshade(folder, *render)
        wait_for_programs(folder)
        run_clshade(folder, *render)
        columns |= {"warm": run_clshade(folder, *render), "png": run_clshade(folder, *render, "--formats", "png")}
        if util.find_spec("f3d") is not None and os.path.exists(scene):
            columns["f3d"] = run([sys.executable, "-c", F3D, scene, os.path.join(folder, "f3d.png")])
        return columns


def pictures(scenes: list[str], rounds: int) -> Iterable[list[Any]]:
    times: dict[str, dict[str, list[float]]] = {scene: defaultdict(list) for scene in scenes}
    for _ in range(rounds):
        for scene in scenes:
            for column, value in seconds_to_picture(scene).items():
                times[scene][column].append(value)
    names = list(max(times.values(), key=len))
    yield ["seconds", *names]
    for scene, columns in times.items():
        yield [
            os.path.basename(scene),
            *(f"{np.median(columns[name]):.2f}" if name in columns else "" for name in names),
        ]


def errors(folder: str, scene: str) -> Iterable[list[Any]]:
    """Return the variants of `report` to which no faster one is equal in error, fastest first."""
    run_clshade(folder, "report", scene, "--resolution", "320,240", "--out", folder)
    document = json.loads(Path(folder, "report.json").read_text())
    yield [os.path.basename(scene), "ms", "RMSE"]
    front = [variant for variant in document["variants"] if variant["name"] in document["pareto_front"]]
    for variant in sorted(front, key=lambda variant: variant["ms"]):
        yield [variant["settings"] or "1 sample", f"{variant['ms']:.3g}", f"{variant['rmse']:.2g}"]


def frames(folder: str) -> Iterable[list[Any]]:
    prefix = os.path.join(folder, "speed")
    against = ["--against", "llvmpipe"] if util.find_spec("moderngl") is not None else []
    run_clshade(folder, "bench", *against, "-o", prefix)
    document = json.loads(Path(prefix + ".json").read_text())
    yield ["workload", "image", "triangles", "ms", "times as fast as llvmpipe"]
    for frame in document["frames"]:
        ratio = f"{frame['ratio']:.1f}" if frame.get("same") else ""
        yield [frame["name"], frame["image"], f"{frame['triangles']:,}", f"{frame['ms']:.3g}", ratio]


def as_markdown(rows: Iterable[list[Any]]) -> str:
    header, *body = rows
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (header, ["---"] * len(header), *body))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help="built-in scenes, or files")
    parser.add_argument("--rounds", type=int, default=3, help="of pictures (3)")
    parser.add_argument("--only", nargs="+", choices=["pictures", "errors", "frames"], help="parts of the page")
    parser.add_argument("--out", default=".", help="folder for FIGURES.md (default: this one)")
    options = parser.parse_args()
    chosen = options.only or ["pictures", "errors", "frames"]
    parts = [f"# Figures\n\nMade by `python demos/figures.py` on {time.strftime('%Y-%m-%d')}."]
    with TemporaryDirectory() as folder:
        if "pictures" in chosen:
            parts += ["## Seconds to a picture", as_markdown(pictures(options.scenes, options.rounds))]
        if "errors" in chosen:
            parts += ["## Error against time", *(as_markdown(errors(folder, scene)) for scene in options.scenes)]
        if "frames" in chosen:
            parts += ["## Frames", as_markdown(frames(folder))]
        for path in sorted(Path(folder).glob("*.json"))[:1]:
            document = json.loads(path.read_text())
            parts.append(f"On {document['machine']}; {document['device']}.")
    Path(options.out, "FIGURES.md").write_text("\n\n".join(parts) + "\n")
    return 0


if __name__ == "__main__":
    interrupts.run(main)
