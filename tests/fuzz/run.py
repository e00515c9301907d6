"""Fuzz by hand: `python tests/fuzz/run.py --scenes 0:20000 --files 0:20000 --seed 1` draws these random scenes and
loads these damaged files. Each failure is printed with the command that repeats it, and the file of the scene, cut down."""

import argparse
import sys
from functools import partial
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "support"))


def numbers(text: str) -> range:
    first, last = text.split(":")
    return range(int(first), int(last))


def main() -> int:
    from file_mutations import file_failures
    from scene_fuzzer import scene_failures

    from clshade.pipeline.opencl.device import open_device

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=numbers, default=range(0), metavar="A:B")
    parser.add_argument("--files", type=numbers, default=range(0), metavar="A:B")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device")
    arguments = parser.parse_args()
    if not (arguments.files or arguments.scenes):
        parser.error("expected --scenes or --files")
    device, count = open_device(arguments.device) if arguments.scenes else None, 0
    ways = {"file": file_failures, "scene": partial(scene_failures, device)}
    for what, number in [*(("file", n) for n in arguments.files), *(("scene", n) for n in arguments.scenes)]:
        print(f"{what} {number}", end="\r", file=sys.stderr, flush=True)  # what a crash leaves
        for failure in ways[what]([number], arguments.seed):
            print(failure, flush=True)
            count += 1
    print(f"{len(arguments.files)} files, {len(arguments.scenes)} scenes: {count} failed")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
