"""Options shared by `turntable` and `animate`: output and workers."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...errors import InputError
from . import DONE
from .arguments import device_option, output_name, refuse, seconds
from .saving_options import OUTPUT, chosen_saving, matte_option, saving_options
from .scene_options import picture_settings
from .stereo_options import EYES, check_stereo, stereo_options

FPS = 30  # view.film.FPS, whose import loads NumPy
CONNECT_SECONDS = 10.0  # timeout to reach a scheduler, and for it to have workers

if TYPE_CHECKING:
    from ...farm import Run
    from ...scene.camera import Camera
    from ...scene.model import Scene
    from ...scene.pose import Pose
    from ...view.film import Film


def output_options(parser: argparse.ArgumentParser) -> None:
    stereo_options(parser)
    output = parser.add_argument_group(OUTPUT)
    output.add_argument(
        "-o",
        "--output",
        type=output_name,
        default="out.####.exr",
        metavar="OUT",
        help="#### stands for the number of the frame; a PNG beside each EXR; its folder is made where there is none "
        "(default: out.####.exr). Or a film: OUT.mp4, .webm, .gif, .apng or .webp",
    )
    output.add_argument(
        "--fps",
        metavar="RATE",
        help=f"of a film, or of an animation: frames per second, also 30000/1001 (default: {FPS})",
    )
    output.add_argument("--bit-depth", type=int, metavar="8|10", help="of an .mp4: bits per channel (default: 8)")
    output.add_argument("--keep-frames", action="store_true", help="of a film, in the folder OUT.mp4.frames")
    output.add_argument("--overwrite", action="store_true", help="draw frames that exist, too")
    saving_options(output)
    output.add_argument(
        "--save-cameras",
        metavar="FILE.json",
        help="also write K and pose of each frame's camera, in the order of the frames, which `animate` reads; of a stereo "
        "pair FILE.left.json and FILE.right.json",
    )
    output.add_argument(
        "--flow",
        action="store_true",
        help="of frames: optical flow in the EXR, pixels to the right and down, to the next frame (flow) and to the one "
        "before (flow_back), what is occluded there (flow_occluded, flow_back_occluded), and the layer id",
    )
    output.add_argument(
        "--visible",
        choices=("csv", "json"),
        help="of frames: also how much of each instance is seen, and how much of it is in the image, beside each frame: "
        "out.0001_visible.csv and so on",
    )
    matte_option(output)
    output.add_argument("--json", action="store_true", help="print the summary as JSON")


def worker_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("workers: processes and machines that draw")
    either = group.add_mutually_exclusive_group()
    either.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes on this machine (default: this one alone)"
    )
    either.add_argument("--scheduler", metavar="tcp://HOST:8786", help="the workers of this Dask scheduler")
    group.add_argument(
        "--timeout",
        type=float,
        default=CONNECT_SECONDS,
        metavar="S",
        help=f"seconds to wait for the scheduler and for a worker (default: {CONNECT_SECONDS:g})",
    )
    group.add_argument(
        "--frame-timeout",
        type=seconds,
        metavar="SECONDS",
        help="with --workers or --scheduler: a worker that takes longer to draw and write a frame counts as hanging, and "
        "others draw what it has; starting and compiling the kernels do not count, up to two minutes "
        "(default: it is waited for)",
    )
    device_option(parser)


def drawing_options(arguments: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return the keyword arguments that `farm.draw_frames` and what draws by it have."""
    own = ("workers", "scheduler", "timeout", "frame_timeout", "overwrite", "device", "preset")
    options = {name: getattr(arguments, name) for name in own}
    options |= {"progress": not arguments.quiet, "saving": chosen_saving(arguments)}
    return options | picture_settings(arguments, scene)


def draw(
    arguments: argparse.Namespace, scene: Scene, cameras: Mapping[int, Camera], poses: Mapping[int, Pose] | None = None
) -> int:
    """Draw the frames or the film, as the options say, and print a summary. poses: of an animation that is played."""
    from ...farm import write_cameras

    check_stereo(arguments)
    eyes = _eyes(arguments, cameras)
    with ExitStack() as folders:
        _check_saved(eyes.values(), folders)
        drawn = {}
        for name, eye in eyes.items():
            drawn[name] = _draw(arguments, scene, eye.cameras, eye.output, poses)
            if eye.saved:
                write_cameras(eye.saved, (eye.cameras[number] for number in sorted(eye.cameras)))
    if arguments.json:
        stats = {name: each.stats() for name, each in drawn.items()}
        print(json.dumps(stats.get("", stats), indent=2))
    else:
        print("\n".join(line for each in drawn.values() for line in each.lines()))
    return DONE


class _Eye(NamedTuple):
    """What is drawn of one eye, or in all. saved: the file of its cameras, if any."""

    output: str
    saved: str | None
    cameras: Mapping[int, Camera]


def _eyes(arguments: argparse.Namespace, cameras: Mapping[int, Camera]) -> dict[str, _Eye]:
    """Return both eyes by name, or without --stereo one whose name is empty."""
    from ...farm import stereo_cameras
    from ...farm.frames import pattern_of_eye

    output, saved = arguments.output, arguments.save_cameras
    if arguments.stereo is None:
        return {"": _Eye(output, saved, cameras)}
    pair = stereo_cameras(cameras, arguments.stereo, arguments.convergence)
    return {
        name: _Eye(pattern_of_eye(output, name), saved and pattern_of_eye(saved, name), each)
        for name, each in zip(EYES, pair, strict=True)
    }


def _check_saved(eyes: Iterable[_Eye], folders: ExitStack) -> None:
    """Refuse, before anything is drawn, files of cameras that cannot be written; make their folder."""
    from ...base.atomic_files import check, folder_made

    for eye in eyes:
        if eye.saved:
            folders.enter_context(folder_made(Path(eye.saved).parent))
            check(eye.saved)


def _draw(
    arguments: argparse.Namespace,
    scene: Scene,
    cameras: Mapping[int, Camera],
    output: str,
    poses: Mapping[int, Pose] | None,
) -> Run | Film:
    from ...view.film_format import is_film

    options = {"poses": poses, **drawing_options(arguments, scene)}
    if is_film(output):
        if arguments.formats is not None:
            raise InputError(f"--formats: cannot go with a film, {output}")
        from ...view.film import draw_film

        refuse(
            arguments,
            ("flow", "visible", "cryptomatte"),
            f"needs frames as --output, such as out.####.exr, not {output}",
        )
        film = {"fps": arguments.fps, "bits": arguments.bit_depth, "keep_frames": arguments.keep_frames}
        options |= {name: value for name, value in film.items() if value is not None}
        return draw_film(scene, cameras, output, **options)
    from ...farm import draw_frames

    of_films = ("bit_depth", "keep_frames", *(("fps",) if poses is None else ()))
    refuse(arguments, of_films, f"needs a film as --output, such as out.mp4, not {output}")
    own = {"flow": arguments.flow, "visible": arguments.visible, "mattes": arguments.cryptomatte or ()}
    return draw_frames(scene, cameras, output, **own, **options)
