"""Posters: images too large to be drawn at once, drawn in tiles as by `farm.draw_frames`, then joined."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import console
from ..base.arrays import Bytes
from ..base.atomic_files import naming, replacing_all, shown
from ..base.validation import arguments, flag, integer, keywords, value_error
from ..base.validation import path as checked_path
from ..errors import InputError
from ..farm.frames import parse_pattern
from ..farm.local import MOST_WORKERS
from ..farm.running import Run, draw_frames
from ..images import exr, exr_tiles, png
from ..images.layers import LAYER_TABLE
from ..pipeline import frame_files
from ..pipeline.effective_settings import effective_settings
from ..pipeline.frame_files import SAVING, SavingOptions
from ..pipeline.frame_results import record_of, sealed
from ..scene.camera import Camera
from ..scene.image_part import PartCamera, part_of, whole_camera
from ..scene.model import Scene
from ..scene.settings import FrameOptions
from .frame_folder import FrameFolder, digest_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

TILE = 2048  # pixels a side
MIN_TILE, MAX_TILE = 16, 8192  # 8192: PoCL has a buffer for its pixels in float64, too


@dataclass(frozen=True)
class Poster:
    """The result of drawing a poster.

    Attributes
    ----------
    paths : tuple of str
        Its files.
    run : Run
        How its tiles were drawn.
    resolution : tuple of int
        Columns and rows.
    tile : int
        Pixels a side of a tile; those at the right and at the lower end may be smaller.
    size : int
        Bytes of the files.
    join_seconds : float
        Time to join the tiles, after they were drawn.
    tiles : str or None
        The folder of the tiles, if they are kept.
    """

    paths: tuple[str, ...]
    run: Run
    resolution: tuple[int, int]
    tile: int
    size: int
    join_seconds: float
    tiles: str | None

    def stats(self) -> dict[str, Any]:
        """Return the figures as a dict for JSON."""
        poster = {name: getattr(self, name) for name in Poster.__dataclass_fields__ if name != "run"}
        run = {name: value for name, value in self.run.stats().items() if name not in ("first", "last", "files")}
        return {**run, "poster": poster}

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        columns, rows = self.resolution
        count = self.run.drawn + self.run.skipped
        there = f", {self.run.skipped:,} of them there already" if self.run.skipped else ""
        return [
            f"poster  {' and '.join(map(shown, self.paths))}, {columns}x{rows}, {self.size / 1e6:.1f} MB",
            f"tiles   {count:,} of up to {self.tile}x{self.tile}{there}; drawn in {self.run.seconds:.1f} s, joined in "
            f"{self.join_seconds:.1f} s",
            *([f"        kept in {shown(self.tiles)}"] if self.tiles else []),
        ]


class _Tiles(Mapping[int, Camera]):
    """The cameras of a poster's tiles, numbered from 0 row by row from the top; each is made when it is looked up."""

    def __init__(self, whole: Camera, tile: int) -> None:
        columns, rows = whole.resolution
        self.whole, self.tile = whole, tile
        self.across, self.down = -(-columns // tile), -(-rows // tile)

    def __getitem__(self, number: int) -> PartCamera:
        if not 0 <= number < len(self):
            raise KeyError(number)
        left, top = number % self.across * self.tile, number // self.across * self.tile
        columns, rows = self.whole.resolution
        return part_of(self.whole, left, top, min(self.tile, columns - left), min(self.tile, rows - top))

    def __iter__(self) -> Iterator[int]:
        return iter(range(len(self)))

    def __len__(self) -> int:
        return self.across * self.down


@arguments(path=checked_path, keep_tiles=flag, saving=partial(keywords, allowed=SAVING), overwrite=flag, progress=flag)
def draw_poster(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    tile: int = TILE,
    keep_tiles: bool = False,
    saving: SavingOptions | None = None,
    overwrite: bool = False,
    workers: int = 1,
    scheduler: str | None = None,
    timeout: float = 10.0,
    frame_timeout: float | None = None,
    progress: bool = True,
    device: str | None = None,
    **settings: Unpack[FrameOptions],
) -> Poster:
    """Draw an image of any size in tiles, and join them to one tiled EXR and one PNG.

    Every pixel has the bits that it has in an image drawn at once, whatever the tiles. An image of
    more than 16384 pixels a side, which cannot be drawn at once, has those of its regions of 16384
    pixels a side from the top left.

    Parameters
    ----------
    scene : Scene
        The scene to draw.
    path : str or path-like
        File name; an extension .exr or .png is dropped.
    tile : int, default 2048
        Pixels a side of a tile, a power of two from 16 to 8192.
    keep_tiles : bool, default False
        Keep the tiles, EXR and PNG, in the folder ``<path>.tiles``. Otherwise it is removed when the
        poster is complete, unless an earlier run kept it.
    saving : dict, optional
        Keywords of `Frame.save`; `files` may be ``("exr",)`` or ``("png",)`` alone.
    overwrite : bool, default False
        Also draw tiles that an earlier run left.
    workers, scheduler, timeout, frame_timeout, progress, device
        See `clshade.farm.draw_frames`. Workers elsewhere need access to the folder of the tiles.
    **settings
        Keywords of `clshade.render`; ``resolution=(N, M)``, columns and rows, may be up to 131072 each.

    Raises
    ------
    InputError
        If an argument is refused.
    DeviceError, OutputError, WorkerError
        See `clshade.farm.draw_frames`. Earlier files stay, and so do tiles that were drawn: the next
        call with the same arguments continues from them.

    Notes
    -----
    A process that draws needs memory for the scene and for a frame of the size of a tile; joining needs
    ``4 * N * tile`` bytes for the PNG, and hardly any for the EXR, whose tiles are not decoded.
    `clshade.exr.read` refuses images of more than 2^28 pixels; OpenImageIO reads them tile by tile.
    The disk holds tiles and poster at once.

    Examples
    --------
    >>> import clshade
    >>> scene = clshade.builtin("teapot")
    >>> poster = clshade.view.draw_poster(scene, "poster.exr", resolution=(1000, 600), tile=256, progress=False)
    >>> poster.run.drawn, poster.paths
    (12, ('poster.exr', 'poster.png'))
    """
    name = os.fspath(path)
    options: SavingOptions = {**saving} if saving else {}
    paths = frame_files.chosen_paths(name, options.get("files"))
    files = tuple(paths)
    refused = ",".join(kind for kind in files if kind not in ("exr", "png"))
    if refused:
        raise value_error("draw_poster", "files", "exr, png or both", refused)
    for option in ("crop", "colorbar"):
        if options.get(option):
            raise InputError(f"draw_poster: {option}: cannot go with tiles, which are joined as they are")
    tile = integer("draw_poster", "tile", tile, MIN_TILE, MAX_TILE)
    if tile & (tile - 1):
        raise value_error("draw_poster", "tile", "a power of two", tile)
    requested = settings.pop("resolution", None)
    scene, settled = effective_settings(scene, **settings)
    tiles = _Tiles(whole_camera(scene.camera, scene.camera.resolution if requested is None else requested), tile)
    whole, resolution = replace(scene, camera=tiles.whole), tiles.whole.resolution
    # All that is refused is refused before tiles of an earlier run are removed.
    chosen = frame_files.check_output(name, settled, **options)
    if settled.layers and options.get("compression") in exr.LOSSY:
        raise value_error("draw_poster", "compression", "a lossless one with layers", options["compression"])
    integer("draw_poster", "workers", workers, 1, MOST_WORKERS)
    channels = len("RGBA") + sum(len(LAYER_TABLE[layer].components) or 1 for layer in settled.layers)
    if "exr" in files and 4 * channels * tile * tile >= 1 << 31:  # a chunk's size is an int32
        raise value_error("draw_poster", "tile", "tiles of less than 2^31 bytes: smaller ones, or fewer layers", tile)
    folder = FrameFolder(os.fspath(next(iter(paths.values())).with_suffix("")), "poster", "tiles")
    keep_tiles = keep_tiles or folder.kept
    with folder.of(digest_of(whole, settled, tile, {**options, "files": files}), keep_tiles):
        run = draw_frames(
            replace(scene, camera=tiles[0]),
            tiles,
            folder.pattern,
            workers=workers,
            scheduler=scheduler,
            timeout=timeout,
            frame_timeout=frame_timeout,
            overwrite=overwrite,
            progress=progress,
            device=device,
            saving={**options, "files": files},
            **settings,
        )
        start = time.perf_counter()
        if progress:
            console.progress(f"{shown(name)}: joining {len(tiles)} tiles")
        pattern = parse_pattern(folder.pattern, len(tiles))
        with replacing_all(*paths.values()) as opened:  # one after the other: a thread beside would not be interrupted
            for (kind, file_path), file in zip(paths.items(), opened, strict=True):
                names = [pattern.names(number, (kind,))[0] for number in tiles]
                with naming(file_path):
                    if kind == "exr":
                        metadata = frame_files.header(whole, settled, settled.layers)
                        metadata = sealed(metadata, record_of(whole, settled, chosen))
                        header = exr_tiles.header(names[0], resolution, tile, metadata)
                        exr_tiles.join(file, header, names, tiles.across, tiles.down)
                    else:
                        png.encode_bands(file, *resolution, _bands(tiles, names))
        seconds = time.perf_counter() - start
    return Poster(
        paths=tuple(map(os.fspath, paths.values())),
        run=run,
        resolution=resolution,
        tile=tile,
        size=sum(os.path.getsize(each) for each in paths.values()),
        join_seconds=seconds,
        tiles=folder.path if keep_tiles else None,
    )


def _bands(tiles: _Tiles, names: Sequence[str]) -> Iterator[Bytes]:
    """Yield the rows of tiles as images of the poster's width. names: the PNG of each tile."""
    for row in range(tiles.down):
        for column in range(tiles.across):
            picture = png.read(names[row * tiles.across + column], alpha=True)
            if not column:
                band = np.empty((len(picture), tiles.whole.resolution[0], picture.shape[2]), np.uint8)
            left = column * tiles.tile
            band[:, left : left + picture.shape[1]] = picture
        yield band
