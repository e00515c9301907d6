"""Films: frames drawn as by `farm.draw_frames`, then encoded as MP4, WebM, GIF, APNG or WebP."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import console
from ..base.arrays import Array
from ..base.atomic_files import check, replacing, shown
from ..base.validation import arguments, flag, integer, keywords, value_error
from ..base.validation import path as checked_path
from ..errors import InputError
from ..farm.frames import parse_pattern
from ..farm.running import LINES, Run, check_numbered, draw_frames
from ..images import exr, png
from ..images.figures import bar_width
from ..images.tonemap import BLACK, Operator, display_values, over
from ..pipeline.effective_settings import effective_settings
from ..pipeline.frame_files import SAVING, FileKind, SavingOptions
from ..scene.camera import Camera
from ..scene.description import digest_of, part_digests
from ..scene.model import Scene, default_tonemap
from ..scene.pose import Pose
from . import video
from .frame_folder import FarmOptions, FrameFolder, split_options
from .video import FilmFormat, checked_rate, format_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

FPS = 30  # frames per second, unless chosen
_AHEAD = 2  # images that are decoded while another one is encoded


@dataclass(frozen=True)
class Film:
    """The result of drawing a film.

    Attributes
    ----------
    path, codec, pixels : str
        The film's file, how it is encoded, and what its pixels hold.
    run : Run
        How its frames were drawn.
    count, fps : int, Fraction
        Number of frames in all, and per second.
    resolution : tuple of int
        Columns and rows; even in MP4 and WebM.
    size, encode_seconds : int, float
        Bytes of the file, and the time to encode it, after the frames were drawn.
    frames : str or None
        The folder of the frames, if they are kept.
    """

    path: str
    run: Run
    count: int
    fps: Fraction
    resolution: tuple[int, int]
    codec: str
    pixels: str
    size: int
    encode_seconds: float
    frames: str | None

    @property
    def seconds(self) -> float:
        """Duration of the film."""
        return float(self.count / self.fps)

    def stats(self) -> dict[str, Any]:
        """Return the figures as a dict for JSON."""
        film = {**vars(self), "fps": float(self.fps), "seconds": self.seconds}
        del film["run"]
        removed = () if self.frames else ("first", "last")  # names of files
        return {**{name: value for name, value in self.run.stats().items() if name not in removed}, "film": film}

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        lines, (columns, rows) = self.run.lines(), self.resolution
        rate = f"{self.count} frames, {float(self.fps):.6g} a second, {self.seconds:.6g} s"
        return [
            *(lines if self.frames else lines[:-1]),
            f"film    {shown(self.path)}, {columns}x{rows}, {rate}",
            f"        {self.codec} ({self.pixels}), {self.size / 1e6:.2f} MB, encoded in {self.encode_seconds:.1f} s",
        ]


@arguments(
    path=checked_path,
    bits=partial(integer, least=-(2**31), most=2**31),
    keep_frames=flag,
    saving=partial(keywords, allowed=SAVING),
)
def draw_film(
    scene: Scene,
    cameras: Mapping[int, Camera],
    path: str | os.PathLike[str],
    *,
    poses: Mapping[int, Pose] | None = None,
    fps: float | Fraction | str = FPS,
    bits: int = 8,
    keep_frames: bool = False,
    saving: SavingOptions | None = None,
    **options: Unpack[FarmOptions],
) -> Film:
    """Draw frames of a scene, and write them as a film.

    Raises InputError if an argument is refused, or PyAV is missing, which MP4 and WebM need; and what
    `clshade.farm.draw_frames` raises. An earlier film stays then, and so do frames that were drawn:
    the next call with the same arguments continues from them.

    Parameters
    ----------
    scene : Scene
        The scene to draw.
    cameras : mapping of int to Camera
        Camera of each frame, by frame number; all with one resolution.
    path : str or path-like
        The film's file, which ends in .mp4, .webm, .gif, .apng or .webp.
    poses : mapping of int to Pose, optional
        See `clshade.farm.draw_frames`. An attribute `source`, plain values or arrays as from
        `load_animation`, is compared in place of the poses to tell whether frames of an earlier run
        belong to this film.
    fps : number or str, default 30
        Frames per second, also as a fraction such as ``"30000/1001"``; at most 50 in a GIF, 90 in
        APNG and WebP.
    bits : {8, 10}, default 8
        Bits per channel, rounded from the frames' floats; 10 in MP4 alone.
    keep_frames : bool, default False
        Keep the frames, EXR and PNG, in the folder ``<path>.frames``, which is otherwise removed when
        the film is complete. Frames that were kept once stay beside their film.
    saving : dict, optional
        Keywords of `Frame.save`: tone map and exposure apply to the film, the others to kept frames.
    overwrite, workers, scheduler, timeout, frame_timeout, progress, device
        See `clshade.farm.draw_frames`.
    **options
        Keywords of `clshade.render`.
    """
    name = os.fspath(path)
    check_numbered(cameras, poses)
    kind = format_of(name, bits)
    rate = checked_rate(kind, fps)
    file_kind: FileKind = "png" if bits == 8 else "exr"
    folder = FrameFolder(name)
    keep_frames = keep_frames or folder.kept
    farming, settings = split_options(options)
    saved: SavingOptions = {**saving} if saving else {}
    bar = saved.get("colorbar", False)
    if bar and file_kind == "exr":
        raise InputError("--colorbar: cannot go with --bit-depth 10, for a film of the EXR files")
    columns, rows = _resolution(cameras, kind, colorbar=bar)
    if not keep_frames:
        saved["files"] = (file_kind,)
        settings["layers"] = ()
    scene_drawn, settings_drawn = effective_settings(scene, **settings)
    views = [(number, digest_of(cameras[number])) for number in cameras], poses and _source(poses, cameras)
    look = saved.get("tonemap") or default_tonemap(scene_drawn), saved.get("exposure", 0.0)
    content = part_digests(scene_drawn), settings_drawn, views, look, repr({**saved, "files": None})
    with folder.of(content, keep_frames):
        check(name)
        run = draw_frames(scene, cameras, folder.pattern, poses=poses, saving=saved, **farming, **settings)
        start = time.perf_counter()
        progress = farming.get("progress", True)
        if progress:
            console.progress(f"{shown(name)}: encoding {len(cameras)} frames")
        names = parse_pattern(folder.pattern, len(cameras))
        files = [names.names(number, (file_kind,))[0] for number in sorted(cameras)]
        images = [partial(_display_image, file, kind.alpha, *look) for file in files]
        with replacing(name) as file:
            if kind.encoder:
                video.encode_video(file, _loaded(images, name if progress else ""), len(images), rate, kind)
                columns, rows, pixels = columns + columns % 2, rows + rows % 2, f"{kind.pixels}, BT.709"
            else:
                video.encode_animation(file, images, rate, kind)
                pixels = kind.pixels
        seconds = time.perf_counter() - start
    kept = folder.path if keep_frames else None
    size = os.path.getsize(name)
    return Film(name, run, len(images), rate, (columns, rows), kind.codec, pixels, size, seconds, kept)


def _source(poses: Mapping[int, Pose], cameras: Mapping[int, Camera]) -> Any:
    """Return the `source` of poses, or a digest of each pose if there is none."""
    if "source" in dir(poses):  # getattr's default would hide an AttributeError of the property
        return poses.source  # type: ignore[attr-defined]
    return [digest_of(poses[number]) for number in cameras]


def _resolution(cameras: Mapping[int, Camera], kind: FilmFormat, *, colorbar: bool) -> tuple[int, int]:
    """Return the resolution of the film, with the color bar of its frames. Raises InputError if the cameras' resolutions
    differ, or if the format cannot have it."""
    first: tuple[int, int] | None = None
    for number, camera in cameras.items():
        if not isinstance(camera, Camera):
            raise value_error("draw_film", f"cameras: frame {number}", "a Camera", camera)
        first = first or camera.resolution
        if camera.resolution != first:
            sizes = "{}x{}, found {}x{}".format(*first, *camera.resolution)
            raise InputError(
                f"film: frame {number}: expected all frames of one size, {sizes}: --resolution gives them one"
            )
    assert first is not None
    columns, rows = first[0] + (bar_width(first[1]) if colorbar else 0), first[1]
    if not kind.min_side <= min(columns, rows) <= max(columns, rows) <= kind.max_side:
        expected = f"{kind.min_side} to {kind.max_side} pixels a side for this format"
        raise InputError(f"film: resolution: expected {expected}, found {columns}x{rows}")
    return columns, rows


def _display_image(file: str, alpha: bool, tonemap: Operator, exposure: float) -> Array:
    """Read the codes of a PNG, with its alpha or over black, or the colors of an EXR as display values."""
    if file.endswith(".exr"):
        channels, _ = exr.read(file)
        return display_values(np.stack([channels[channel] for channel in "RGB"], axis=-1), tonemap, exposure)
    picture = png.read(file, alpha=True)
    return picture if alpha else over(picture, BLACK)


def _loaded(images: Sequence[Callable[[], Array]], name: str) -> Iterator[Array]:
    """Yield the images, some of them loaded ahead, which releases the GIL. name: the film's, for reports of progress;
    "": report none."""
    reported = time.monotonic()
    with ThreadPoolExecutor(_AHEAD) as threads:
        loading = deque(threads.submit(load) for load in images[:_AHEAD])
        for number in range(len(images)):
            loading.extend(threads.submit(load) for load in images[number + _AHEAD : number + _AHEAD + 1])
            yield loading.popleft().result()
            if name and time.monotonic() - reported >= LINES:
                reported = time.monotonic()
                console.progress(f"{shown(name)}: {number + 1}/{len(images)} frames encoded")
