"""`bench`: frame times, compared with other renderers."""

from __future__ import annotations

import argparse

from ...errors import InputError
from ...measure.defaults import BENCH_FRAMES, BENCH_TURN, CREW_FRAMES, VIEWS
from . import DONE, FAILED
from .arguments import device_option, numbers, output_name

# What benchmarks of their own do not take together.
_OF_MODES = (
    "shadows",
    "views",
    "instances",
    "processors",
    "workers",
    "scheduler",
    "workloads",
    "scaling",
    "peers",
    "turn",
    "targets",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("workloads", nargs="*", metavar="WORKLOAD", help="these only (default: all)")
    parser.add_argument("--list", action="store_true", help="name all workloads and peers")
    parser.add_argument(
        "--frames",
        type=int,
        metavar="N",
        help=f"of each workload (default: {BENCH_FRAMES}), or of the turntable (default: {CREW_FRAMES})",
    )
    parser.add_argument(
        "--turn",
        type=int,
        metavar="N",
        help=f"frames in a row, when alternating with a peer (default: {BENCH_TURN})",
    )
    parser.add_argument(
        "--peers",
        metavar="NAMES",
        help="renderers to draw in turns with, such as llvmpipe,numpy, or none (default: all but opengl)",
    )
    parser.add_argument("--scaling", action="store_true", help="time and memory against triangles and pixels")
    parser.add_argument("--targets", action="store_true", help="also say which of the project's targets are met")
    parser.add_argument(
        "--workers",
        type=numbers(int, None, "whole numbers such as 2,4"),
        metavar="N,...",
        help="a turntable by so many processes each, in turns with one process",
    )
    parser.add_argument("--scheduler", metavar="tcp://HOST:8786", help="and by the workers of this Dask scheduler")
    parser.add_argument(
        "--shadows",
        action="store_true",
        help="shadow rays of teapot and knot, in turns with Intel Embree (PyPI: embreex), one thread each",
    )
    parser.add_argument(
        "--views",
        type=int,
        nargs="?",
        const=VIEWS,
        metavar="K",
        help=f"so many views of a mesh by render_many, in turns with loops over render (default: {VIEWS})",
    )
    parser.add_argument(
        "--instances",
        type=numbers(int, None, "whole numbers such as 1000,100000"),
        metavar="N,...",
        help="one mesh drawn so many times, from one copy and from as many copies: time and memory",
    )
    parser.add_argument(
        "--processors",
        type=lambda text: tuple(name.strip() for name in text.split(",")),
        nargs="?",
        const=(),
        metavar="MODEL,...",
        help="kernels as PyPI's PoCL compiles them for other processors: images, calls of functions, times (default: all)",
    )
    parser.add_argument("-o", "--out", type=output_name, metavar="PREFIX", help="write PREFIX.csv, .json, .md and .png")
    device_option(parser)


def run(arguments: argparse.Namespace) -> int:
    from ...measure.bench import bench
    from ...measure.bench.peers import DEFAULT

    if arguments.list:
        print(bench.listing())
        return DONE
    if arguments.shadows:
        return _run_shadows(arguments)
    if arguments.views is not None:
        return _run_views(arguments)
    if arguments.instances:
        return _run_instances(arguments)
    if arguments.processors is not None:
        return _run_processors(arguments)
    if arguments.workers or arguments.scheduler:
        return _run_crews(arguments)
    named = [name.strip() for name in (arguments.peers or "").split(",")]
    peers = DEFAULT if arguments.peers is None else () if named == ["none"] else tuple(named)
    passed = bench.run(
        arguments.device,
        names=arguments.workloads,
        peers_named=peers,
        frames=BENCH_FRAMES if arguments.frames is None else arguments.frames,
        turn=BENCH_TURN if arguments.turn is None else arguments.turn,
        with_scaling=arguments.scaling,
        targets=arguments.targets,
        out=arguments.out,
    )
    return DONE if passed else FAILED


def _check_alone(arguments: argparse.Namespace, *taken: str) -> None:
    """Refuse options of `bench` beside a mode of its own. taken: the mode's option, and those that go with it."""
    for name in _OF_MODES:
        value = getattr(arguments, name)
        if name not in taken and value is not None and value is not False and value != []:
            mode = f"--{taken[0]}"
            other = name if name == "workloads" else f"--{name}"
            raise InputError(f"bench: expected either {mode} or {other}, found both")


def _run_crews(arguments: argparse.Namespace) -> int:
    from ...measure.bench import workers

    _check_alone(arguments, "workers", "scheduler")
    passed = workers.run(
        arguments.workers or (1,),
        scheduler=arguments.scheduler,
        device=arguments.device,
        frames=CREW_FRAMES if arguments.frames is None else arguments.frames,
        out=arguments.out,
    )
    return DONE if passed else FAILED


def _run_shadows(arguments: argparse.Namespace) -> int:
    from ...measure.bench import shadows

    _check_alone(arguments, "shadows", "workloads", "targets")
    passed = shadows.run(
        arguments.device,
        names=arguments.workloads,
        rounds=BENCH_FRAMES if arguments.frames is None else arguments.frames,
        targets=arguments.targets,
        out=arguments.out,
    )
    return DONE if passed else FAILED


def _run_views(arguments: argparse.Namespace) -> int:
    from ...measure.bench import views

    _check_alone(arguments, "views")
    passed = views.run(
        arguments.views,
        device=arguments.device,
        rounds=views.ROUNDS if arguments.frames is None else arguments.frames,
        out=arguments.out,
    )
    return DONE if passed else FAILED


def _run_instances(arguments: argparse.Namespace) -> int:
    from ...measure.bench import instances

    _check_alone(arguments, "instances")
    passed = instances.run(
        arguments.instances,
        device=arguments.device,
        frames=BENCH_FRAMES if arguments.frames is None else arguments.frames,
        out=arguments.out,
    )
    return DONE if passed else FAILED


def _run_processors(arguments: argparse.Namespace) -> int:
    from ...measure.bench import processors

    _check_alone(arguments, "processors")
    if arguments.device is not None:
        raise InputError("bench: --processors: expected no --device, for all are PyPI's PoCL")
    passed = processors.run(
        arguments.processors,
        frames=BENCH_FRAMES if arguments.frames is None else arguments.frames,
        out=arguments.out,
    )
    return DONE if passed else FAILED
