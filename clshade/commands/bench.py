"""`bench`: how fast frames are, beside other renderers."""

from __future__ import annotations

import argparse

from ..checks.defaults import BENCH_FRAMES
from . import DONE, FAILED
from .arguments import device_option


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("workloads", nargs="*", metavar="WORKLOAD", help="these only (default: all)")
    parser.add_argument("--list", action="store_true", help="name all workloads and peers")
    parser.add_argument(
        "--frames", type=int, default=BENCH_FRAMES, metavar="N", help=f"of each workload (default: {BENCH_FRAMES})"
    )
    parser.add_argument(
        "--peers",
        metavar="NAMES",
        help="renderers to draw in turns with, such as llvmpipe,numpy, or none (default: all but opengl)",
    )
    parser.add_argument("--scaling", action="store_true", help="time and memory against triangles and pixels")
    parser.add_argument("-o", "--out", metavar="PREFIX", help="write PREFIX.csv, .json, .md and .png")
    device_option(parser)


def run(arguments: argparse.Namespace) -> int:
    from ..checks import bench
    from ..checks.peers import DEFAULT

    if arguments.list:
        print(bench.listing())
        return DONE
    named = [name.strip() for name in (arguments.peers or "").split(",")]
    peers = DEFAULT if arguments.peers is None else () if named == ["none"] else tuple(named)
    passed = bench.run(
        arguments.device,
        names=arguments.workloads,
        peers_named=peers,
        frames=arguments.frames,
        with_scaling=arguments.scaling,
        out=arguments.out,
    )
    return DONE if passed else FAILED
