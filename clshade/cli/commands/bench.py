"""`bench`: frame times, compared with other renderers."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ...errors import InputError
from ...measure.defaults import BENCH_FRAMES, BENCH_TURN, CREW_FRAMES, VIEWS
from . import DONE, FAILED
from .arguments import device_option, numbers, output_name

_OF_ALL = ("list", "frames", "out", "device")  # what benchmarks of their own take too


def add_options(parser: argparse.ArgumentParser) -> None:
    first = len(parser._actions)
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
        help="a turntable by N processes, in turns with one process",
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
        help=f"K views of a mesh by render_many, in turns with loops over render (default: {VIEWS})",
    )
    parser.add_argument(
        "--instances",
        type=numbers(int, None, "whole numbers such as 1000,100000"),
        metavar="N,...",
        help="one mesh drawn N times, from one copy and from N copies: time and memory",
    )
    parser.add_argument(
        "--processors",
        type=lambda text: tuple(name.strip() for name in text.split(",")),
        nargs="?",
        const=(),
        metavar="MODEL,...",
        help="kernels as PyPI's PoCL compiles them for other processors: images, calls of functions, times (default: all)",
    )
    parser.add_argument(
        "--features",
        action="store_true",
        help="percentage of a frame that is saved if kernels are compiled without what a scene does not need",
    )
    parser.add_argument(
        "--limits",
        action="store_true",
        help="what --budget and --tolerance are asked for, and what is got: 12 scenes, five levels each",
    )
    parser.add_argument("-o", "--out", type=output_name, metavar="PREFIX", help="write PREFIX.csv, .json, .md and .png")
    device_option(parser)
    parser.set_defaults(of_modes=parser._actions[first:])


def run(arguments: argparse.Namespace) -> int:
    from ...measure.bench import bench
    from ...measure.bench.peers import DEFAULT

    if arguments.list:
        print(bench.listing())
        return DONE
    for mode, (measure, taken) in _MODES.items():
        value = getattr(arguments, mode)
        if value is not None and value is not False:
            _check_alone(arguments, mode, *taken)
            return DONE if measure(arguments) else FAILED
    named = [name.strip() for name in (arguments.peers or "").split(",")]
    peers = DEFAULT if arguments.peers is None else () if named == ["none"] else tuple(named)
    passed = bench.run(
        arguments.device,
        names=arguments.workloads,
        peers_named=peers,
        frames=_frames(arguments, BENCH_FRAMES),
        turn=BENCH_TURN if arguments.turn is None else arguments.turn,
        with_scaling=arguments.scaling,
        targets=arguments.targets,
        out=arguments.out,
    )
    return DONE if passed else FAILED


def _check_alone(arguments: argparse.Namespace, *taken: str) -> None:
    """Refuse options of `bench` beside a mode of its own. taken: the mode's option, and those that go with it."""
    for action in arguments.of_modes:
        if action.dest not in (*taken, *_OF_ALL) and getattr(arguments, action.dest) not in (action.default, []):
            other = action.dest if action.dest == "workloads" else f"--{action.dest}"
            raise InputError(f"bench: expected either --{taken[0]} or {other}, found both")


def _frames(arguments: argparse.Namespace, usual: int) -> int:
    frames: int | None = arguments.frames
    return usual if frames is None else frames


def _shadows(arguments: argparse.Namespace) -> bool:
    from ...measure.bench import shadows

    rounds = _frames(arguments, BENCH_FRAMES)
    options = {"names": arguments.workloads, "targets": arguments.targets, "out": arguments.out}
    return shadows.run(arguments.device, rounds=rounds, **options)


def _views(arguments: argparse.Namespace) -> bool:
    from ...measure.bench import views

    rounds = _frames(arguments, views.ROUNDS)
    return views.run(arguments.views, device=arguments.device, rounds=rounds, out=arguments.out)


def _instances(arguments: argparse.Namespace) -> bool:
    from ...measure.bench import instances

    frames = _frames(arguments, BENCH_FRAMES)
    return instances.run(arguments.instances, device=arguments.device, frames=frames, out=arguments.out)


def _processors(arguments: argparse.Namespace) -> bool:
    from ...measure.bench import processors

    if arguments.device is not None:
        raise InputError("bench: --processors: cannot go with --device: it measures PyPI's PoCL")
    return processors.run(arguments.processors, frames=_frames(arguments, BENCH_FRAMES), out=arguments.out)


def _features(arguments: argparse.Namespace) -> bool:
    from ...measure.bench import features

    rounds = _frames(arguments, features.ROUNDS)
    return features.run(arguments.device, names=arguments.workloads, rounds=rounds, out=arguments.out)


def _limits(arguments: argparse.Namespace) -> bool:
    from ...measure.bench import limits

    frames = _frames(arguments, limits.FRAMES)
    return limits.run(arguments.device, names=arguments.workloads, frames=frames, out=arguments.out)


def _crews(arguments: argparse.Namespace) -> bool:
    from ...measure.bench import workers

    frames = _frames(arguments, CREW_FRAMES)
    drawn_by = {"scheduler": arguments.scheduler, "device": arguments.device}
    return workers.run(arguments.workers or (1,), frames=frames, out=arguments.out, **drawn_by)


# Benchmarks of their own: the option that asks for one, what measures, and the other options that it takes.
_MODES: dict[str, tuple[Callable[[argparse.Namespace], bool], tuple[str, ...]]] = {
    "shadows": (_shadows, ("workloads", "targets")),
    "views": (_views, ()),
    "instances": (_instances, ()),
    "processors": (_processors, ()),
    "features": (_features, ("workloads",)),
    "limits": (_limits, ("workloads",)),
    "workers": (_crews, ("scheduler",)),
    "scheduler": (_crews, ()),
}
