"""`turntable`, `animate` and `poster`: frames, films and tiles, drawn by several processes or machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base import console
from ..base.atomic_files import check, folder_made, shown
from ..base.validation import integer, number
from ..errors import InputError
from ..scene import adjust_camera
from ..scene.camera import MAX_RESOLUTION, MAX_WHOLE, checked_resolution
from ..scene.formats.table import extensions_with
from ..scene.pose import PerFrame, Poses
from . import DONE
from .options import DEVICE, JSON, Arguments, Group, Option, output_name, seconds
from .outputs import EYES, MASKS, OUTPUT, Saving, Stereo, check_stereo, saving
from .scene import (
    A_SCENE,
    SCENE,
    TEAPOT,
    CameraFields,
    LoadFields,
    apply_options,
    choose_look,
    load_scene,
    picture_settings,
    print_load_notes,
    scene_options,
    wants_ground,
    with_lights,
)

if TYPE_CHECKING:
    from ..farm import Run
    from ..farm.frames import Frames
    from ..scene.camera import Camera
    from ..scene.model import Scene
    from ..scene.pose import Pose
    from ..view.film import Film

FPS = 30  # view.film.FPS, whose import takes long
TILE = 2048  # view.poster.TILE, likewise
FRAMES = "1..120"  # of a turn


class FrameFiles:
    title = OUTPUT
    output = Option(
        "-o, --output OUT: #### stands for the number of the frame; a PNG beside each EXR; its folder is made where there "
        "is none. Or a film: OUT.mp4, .webm, .gif, .apng or .webp",
        output_name,
        "out.####.exr",
    )
    overwrite = Option("--overwrite: draw frames that exist, too")
    save_cameras = Option(
        "--save-cameras FILE.json: also write K and pose of each frame's camera, in the order of the frames, which "
        "`animate` reads; of a stereo pair FILE.left.json and FILE.right.json"
    )


class FilmFields:
    """Arguments of `draw_film` that others lack."""

    title = OUTPUT
    fps = Option(f"--fps RATE: of a film, or of an animation: frames per second, also 30000/1001 (default: {FPS!s})")
    bits = Option("--bit-depth 8|10: of an .mp4: bits per channel (default: 8)", int)
    keep_frames = Option("--keep-frames: of a film, in the folder OUT.mp4.frames")


class FrameFields:
    """Arguments of `draw_frames` that others lack."""

    title = OUTPUT
    flow = Option(
        "--flow: of frames: optical flow in the EXR, pixels to the right and down, to the next frame (flow) and to the "
        "one before (flow_back), what is occluded there (flow_occluded, flow_back_occluded), and the layer id"
    )
    visible = Option(
        "--visible csv|json: of frames: also how much of each instance is seen, and how much of it is in the image, "
        "beside each frame: out.0001_visible.csv and so on"
    )


class Workers:
    """Arguments of `draw_frames`, `draw_film` and `draw_poster`."""

    title = "workers: processes and machines that draw"
    workers = Option("--workers N: processes on this machine (default: this one alone)", int, either="workers")
    scheduler = Option("--scheduler tcp://HOST:8786: the workers of this Dask scheduler", either="workers")
    timeout = Option("--timeout S: seconds to wait for the scheduler and for a worker", float, 10.0)
    frame_timeout = Option(
        "--frame-timeout SECONDS: with --workers or --scheduler: a worker that takes longer to draw and write a frame "
        "counts as hanging, and others draw what it has; starting and compiling the kernels do not count, up to two "
        "minutes (default: it is waited for)",
        seconds,
    )


class Turn:
    title = "turn: about what points up, through what is looked at"
    frames = Option(
        f"--frames 1..120: the frames to draw; also 5, 1..120..2 or 1..10,20 (default: {FRAMES})", either="frames"
    )
    count = Option("--count N: number of frames, for --frames 1..N", int, either="frames")
    turn = Option(
        "--turn 1..120: frames of a whole turn, where --frames are some of them (default: from the first to the last)"
    )
    degrees = Option("--degrees DEG: to the right; below 0: to the left", float, 360.0)


class Played:
    cameras = Option(
        'cameras CAMERAS.json: a list such as [{"eye": [0, 1, 5]}, {"eye": [1, 1, 5], "fov": 40}]: frames 1, 2, ... of the '
        "scene as it is; without it an animation of a glTF file is played: its length at --fps; with --animation all, of "
        "several for one property the last counts",
        nargs="?",
    )
    frames = Option("--frames 1..120: the frames to draw, from 1; also 5, 1..120..2 or 1..10,20", either="frames")
    count = Option("--count N: number of frames, evenly spaced over an animation's length", int, either="frames")


class Tiles:
    title = OUTPUT
    output = Option("-o, --output OUT: OUT.exr and OUT.png", output_name, "poster")
    tile = Option("--tile PIXELS: a side of a tile, a power of two", int, TILE)
    keep_tiles = Option("--keep-tiles: in the folder OUT.tiles", default=False)
    overwrite = Option("--overwrite: draw tiles that an earlier run left, too")


_DRAWING = (Group(OUTPUT, JSON), Workers, DEVICE)
_FRAMES = (Stereo, FrameFiles, FilmFields, Saving, FrameFields, MASKS, *_DRAWING)
_SCENE = Group(SCENE, Option(f"scene SCENE: {A_SCENE}"))
OPTIONS = {
    "turntable": (TEAPOT, *scene_options(), Turn, *_FRAMES),
    "animate": (_SCENE, *scene_options(), Played, *_FRAMES),
    "poster": (TEAPOT, *scene_options(), Tiles, Saving, *_DRAWING),
}


def drawing_options(arguments: Arguments, scene: Scene) -> dict[str, Any]:
    """Return the keyword arguments that `draw_frames`, `draw_film` and `draw_poster` share."""
    options = {
        "overwrite": bool(arguments.overwrite),
        "device": arguments.device,
        "preset": arguments.preset,
        "progress": not arguments.quiet,
        "saving": saving(arguments),
    }
    return {**arguments.keywords(Workers), **options, **picture_settings(arguments, scene)}


# `turntable`


def run_turntable(arguments: Arguments) -> int:
    from ..farm import orbit
    from ..farm.frames import MAX_FRAMES, parse_frames

    if arguments.count is not None:
        frames = parse_frames(f"1..{integer('turntable', '--count', arguments.count, 1, MAX_FRAMES)}")
    else:
        frames = parse_frames(FRAMES if arguments.frames is None else arguments.frames)
        last, is_alone = frames.last, frames.span == 1 and arguments.turn is None and "#" in arguments.output
        if is_alone and 1 < last <= MAX_FRAMES:  # probably meant as the number of frames
            console.warning(f"--frames {last} is one frame, that of number {last}: --count {last} draws {last} frames")
    turn = frames if arguments.turn is None else parse_frames(arguments.turn, "--turn")
    degrees = number("turntable", "--degrees", arguments.degrees)
    scene = load_scene(arguments, turning=True)
    return draw(arguments, scene, orbit(scene.camera, frames.numbers, turn, degrees))


# `animate`


def run_animate(arguments: Arguments) -> int:
    from ..farm import parse_frames, read_cameras

    frames = None if arguments.frames is None else parse_frames(arguments.frames)
    if arguments.cameras is None:
        return _play(arguments, frames)
    arguments.refuse(("count",), "is for the animation of a glTF file, and cannot go with CAMERAS.json")
    scene = load_scene(arguments)
    cameras = read_cameras(arguments.cameras, scene.camera, arguments.resolution)
    numbers = _numbers(frames, arguments, len(cameras), arguments.cameras)
    return draw(arguments, scene, {number: cameras[number - 1] for number in numbers})


def _play(arguments: Arguments, frames: Frames | None) -> int:
    """Draw an animation of a glTF file."""
    from ..scene.formats.load import load_animation

    name = arguments.scene
    if not name.lower().endswith(extensions_with("animation")):
        raise InputError(f"CAMERAS.json: a file of cameras is missing, and {shown(name)} has no animation to play")
    options = arguments.keywords(LoadFields)
    arguments.refuse(("time", "focal", "weld"), "cannot go with an animation that is played")
    fit = arguments.camera == "fit"
    played = load_animation(
        name, count=arguments.count, fps=_rate(arguments), resolution=arguments.resolution, fit=fit, **options
    )
    print_load_notes(played.scene, arguments, name)
    count = len(played.times)
    console.progress(f"{shown(name)}: {shown(played.name)}, {played.seconds:.6g} s: frames 1..{count}")
    numbers = _numbers(frames, arguments, count, "the animation")
    is_fitted = played.scene.fitted or fit
    on_stage = is_fitted or wants_ground(choose_look(played.scene, arguments), arguments)
    stage = played.stage if on_stage else played.scene
    arranged = apply_options(stage, arguments, moving=True)
    meshes = (*arranged.meshes[: len(played.scene.meshes)], *arranged.meshes[len(stage.meshes) :])  # the last: a ground
    scene = replace(arranged, meshes=meshes)

    def camera(frame: int) -> Camera:
        if is_fitted:
            return scene.camera
        moved = replace(played.scene, camera=played.cameras[frame])
        return adjust_camera.camera_of(moved, arguments.keywords(CameraFields))

    def pose(frame: int) -> Pose:
        posed = played.poses[frame]
        if posed.lights is None:
            return posed
        return replace(posed, lights=with_lights(replace(played.scene, lights=posed.lights), arguments).lights)

    def source() -> Any:
        return played.poses.source, arguments.lights, arguments.light_intensity, arguments.light_radius

    return draw(arguments, scene, PerFrame(numbers, camera), Poses(numbers, pose, source))


def _rate(arguments: Arguments) -> float:
    """Return how many frames a second of the animation has. Raises InputError for a rate that is no number above 0."""
    if arguments.fps is None:
        return FPS
    try:
        rate = float(Fraction(arguments.fps))
    except (ValueError, ZeroDivisionError, OverflowError):
        rate = 0.0
    if not rate > 0.0:
        raise InputError(f"--fps: expected a number above 0, or a fraction such as 30000/1001, found {arguments.fps!r}")
    return rate


def _numbers(frames: Frames | None, arguments: Arguments, count: int, owner: str) -> Sequence[int]:
    """Return the numbers of the frames to draw, of `count`. owner: what has them, for the error."""
    numbers: Sequence[int] = range(1, count + 1) if frames is None else frames.numbers
    if not 1 <= numbers[0] <= numbers[-1] <= count:
        raise InputError(f"--frames: {arguments.frames} goes beyond the frames of {owner}, 1..{count}")
    return numbers


# Frames and films


def draw(
    arguments: Arguments, scene: Scene, cameras: Mapping[int, Camera], poses: Mapping[int, Pose] | None = None
) -> int:
    """Draw the frames or the film, as the options say, and print a summary. poses: of an animation that is played."""
    from ..farm import stereo_cameras, write_cameras
    from ..farm.frames import pattern_of_eye

    check_stereo(arguments)
    eyes, saved = {"": cameras}, arguments.save_cameras
    if arguments.stereo is not None:
        eyes = dict(zip(EYES, stereo_cameras(cameras, arguments.stereo, arguments.convergence), strict=True))
    paths = {eye: pattern_of_eye(saved, eye) if eye else saved for eye in eyes} if saved else {}
    with ExitStack() as folders:
        for path in paths.values():  # refused before anything is drawn
            folders.enter_context(folder_made(Path(path).parent))
            check(path)
        results = {}
        for eye, run in eyes.items():
            output = pattern_of_eye(arguments.output, eye) if eye else arguments.output
            results[eye] = _draw_eye(arguments, scene, run, output, poses)
            if paths:
                write_cameras(paths[eye], (run[number] for number in sorted(run)))

    def figures() -> Any:
        stats = {eye: run.stats() for eye, run in results.items()}
        return stats.get("", stats)

    arguments.print_result(figures, lambda: (line for run in results.values() for line in run.lines()))
    return DONE


def _draw_eye(
    arguments: Arguments, scene: Scene, cameras: Mapping[int, Camera], output: str, poses: Mapping[int, Pose] | None
) -> Run | Film:
    from ..view.video import is_film

    options = {"poses": poses, **drawing_options(arguments, scene)}
    if is_film(output):
        if arguments.formats is not None:
            raise InputError(f"--formats: cannot go with a film, {output}")
        from ..view.film import draw_film

        needs = f"needs frames as --output, such as out.####.exr, not {output}"
        arguments.refuse(("flow", "visible", "cryptomatte"), needs)
        return draw_film(scene, cameras, output, **arguments.keywords(FilmFields), **options)
    from ..farm import draw_frames

    of_films = ("bit_depth", "keep_frames", *(("fps",) if poses is None else ()))
    arguments.refuse(of_films, f"needs a film as --output, such as out.mp4, not {output}")
    options |= {**arguments.keywords(FrameFields), "mattes": arguments.cryptomatte or ()}
    return draw_frames(scene, cameras, output, **options)


# `poster`


def run_poster(arguments: Arguments) -> int:
    from ..view.poster import draw_poster

    if arguments.resolution is None:
        expected = f"columns and rows, up to {MAX_WHOLE} each, such as 32768x24576"
        raise InputError(f"--resolution: expected {expected}, found none")
    columns, rows = resolution = checked_resolution("--resolution", arguments.resolution, MAX_WHOLE)
    reduction = max(1.0, max(resolution) / MAX_RESOLUTION)  # of the image for which a camera is chosen
    arguments.resolution = max(1, round(columns / reduction)), max(1, round(rows / reduction))
    scene = load_scene(arguments)
    options = {"resolution": resolution, "tile": arguments.tile, "keep_tiles": arguments.keep_tiles}
    poster = draw_poster(scene, arguments.output, **options, **drawing_options(arguments, scene))
    arguments.print_result(poster.stats, poster.lines)
    return DONE
