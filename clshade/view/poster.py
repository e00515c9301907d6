"""Posters: images too large to be drawn at once, drawn in tiles as by `farm.draw_frames`, then joined."""

from __future__ import annotations

import io
import os
import shutil
import struct
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np

from ..base import console
from ..base.arrays import Bytes
from ..base.atomic_files import naming, replacing_all, shown
from ..base.input_files import file_error, reason_of
from ..base.validation import arguments, flag, integer, keywords, value_error
from ..base.validation import path as checked_path
from ..errors import InputError
from ..farm.frames import parse_pattern
from ..farm.local import MOST_WORKERS
from ..farm.running import Run, draw_frames
from ..images import exr, exr_limits, png
from ..images.layers import LAYER_TABLE
from ..pipeline import frame_files
from ..pipeline.effective_settings import effective_settings
from ..pipeline.frame_files import SAVING, SavingOptions
from ..pipeline.frame_results import record_of, sealed
from ..scene.camera import PartCamera, part_of, whole_camera
from ..scene.description import part_digests
from ..scene.model import Scene, default_tonemap
from ..scene.pose import PerFrame
from .frame_folder import FarmOptions, FrameFolder, split_options

if TYPE_CHECKING:
    from typing_extensions import Unpack

TILE = 2048  # pixels a side
MIN_TILE, MAX_TILE = 16, 8192  # 8192: PoCL has a buffer for its pixels in float64, too

_CHUNK = struct.Struct("<5i")  # column and row of a tile, its levels, bytes of its pixels
_SHARED = (b"channels", b"compression")  # attributes that a tile has in common with the whole

Attributes: TypeAlias = dict[bytes, tuple[bytes, bytes]]  # name -> type and value


@dataclass(frozen=True)
class Poster:
    """The result of drawing a poster.

    Attributes
    ----------
    paths, resolution : tuple of str, of int
        Its files; columns and rows.
    run : Run
        How its tiles were drawn.
    tile : int
        Pixels a side of a tile; those at the right and at the lower end may be smaller.
    size, join_seconds : int, float
        Bytes of the files, and the time to join the tiles, after they were drawn.
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
        run = {name: value for name, value in self.run.stats().items() if name not in ("first", "last", "files")}
        return {**run, "poster": {name: value for name, value in vars(self).items() if name != "run"}}

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        columns, rows = self.resolution
        count = self.run.drawn + self.run.skipped
        resumed = f", {self.run.skipped:,} of them there already" if self.run.skipped else ""
        return [
            f"poster  {' and '.join(map(shown, self.paths))}, {columns}x{rows}, {self.size / 1e6:.1f} MB",
            f"tiles   {count:,} of up to {self.tile}x{self.tile}{resumed}; drawn in {self.run.seconds:.1f} s, joined in "
            f"{self.join_seconds:.1f} s",
            *([f"        kept in {shown(self.tiles)}"] if self.tiles else []),
        ]


@arguments(path=checked_path, keep_tiles=flag, saving=partial(keywords, allowed=SAVING))
def draw_poster(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    tile: int = TILE,
    keep_tiles: bool = False,
    saving: SavingOptions | None = None,
    **options: Unpack[FarmOptions],
) -> Poster:
    """Draw an image of any size in tiles, and join them to one tiled EXR and one PNG.

    Every pixel has the bits that it has in an image drawn at once, whatever the tiles. An image of
    more than 16384 pixels a side, which cannot be drawn at once, has those of its regions of 16384
    pixels a side from the top left.

    Raises InputError if an argument is refused, and what `clshade.farm.draw_frames` raises. Earlier
    files stay then, and so do tiles that were drawn: the next call with the same arguments continues
    from them.

    Parameters
    ----------
    scene : Scene
        The scene to draw.
    path : str or path-like
        File name; an extension .exr or .png is dropped.
    tile : int, default 2048
        Pixels a side of a tile, a power of two from 16 to 8192.
    keep_tiles : bool, default False
        Keep the tiles, EXR and PNG, in the folder ``<path>.tiles``, which is otherwise removed when the
        poster is complete, unless an earlier run kept it.
    saving : dict, optional
        Keywords of `Frame.save`; `files` may be ``("exr",)`` or ``("png",)`` alone.
    overwrite, workers, scheduler, timeout, frame_timeout, progress, device
        See `clshade.farm.draw_frames`. Workers elsewhere need access to the folder of the tiles.
    **options
        Keywords of `clshade.render`; ``resolution=(N, M)``, columns and rows, may be up to 131072 each.

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
    farming, settings = split_options(options)
    saved: SavingOptions = {**saving} if saving else {}
    paths = frame_files.chosen_paths(name, saved.get("files"))
    files = tuple(paths)
    if refused := ",".join(kind for kind in files if kind not in ("exr", "png")):
        raise value_error("draw_poster", "files", "exr, png or both", refused)
    for option in ("crop", "colorbar"):
        if saved.get(option):
            raise InputError(f"draw_poster: {option}: cannot go with tiles, which are joined as they are")
    tile = integer("draw_poster", "tile", tile, MIN_TILE, MAX_TILE)
    if tile & (tile - 1):
        raise value_error("draw_poster", "tile", "a power of two", tile)
    requested = settings.pop("resolution", None)
    scene, settled = effective_settings(scene, **settings)
    camera = whole_camera(scene.camera, scene.camera.resolution if requested is None else requested)
    whole_scene, (columns, rows) = replace(scene, camera=camera), camera.resolution
    across, down = -(-columns // tile), -(-rows // tile)

    def part(number: int) -> PartCamera:
        left, top = number % across * tile, number // across * tile
        return part_of(camera, left, top, min(tile, columns - left), min(tile, rows - top))

    tiles = PerFrame(range(across * down), part)  # row by row from the top
    # All that is refused is refused before tiles of an earlier run are removed.
    chosen = frame_files.check_output(name, settled, **saved)
    if settled.layers and saved.get("compression") in exr.LOSSY:
        raise value_error("draw_poster", "compression", "a lossless one with layers", saved["compression"])
    integer("draw_poster", "workers", farming.get("workers", 1), 1, MOST_WORKERS)
    for option in ("overwrite", "progress"):
        flag("draw_poster", option, farming.get(option, True))
    channels = len("RGBA") + sum(len(LAYER_TABLE[layer].components) or 1 for layer in settled.layers)
    if "exr" in files and 4 * channels * tile * tile >= 1 << 31:  # a chunk's size is an int32
        raise value_error("draw_poster", "tile", "tiles of less than 2^31 bytes: smaller ones, or fewer layers", tile)
    folder = FrameFolder(os.fspath(next(iter(paths.values())).with_suffix("")), "poster", "tiles")
    keep_tiles = keep_tiles or folder.kept
    content = part_digests(whole_scene), settled, tile, default_tonemap(whole_scene), repr({**saved, "files": files})
    with folder.of(content, keep_tiles):
        first = replace(scene, camera=tiles[0])
        run = draw_frames(first, tiles, folder.pattern, saving={**saved, "files": files}, **farming, **settings)
        start = time.perf_counter()
        if farming.get("progress", True):
            console.progress(f"{shown(name)}: joining {len(tiles)} tiles")
        pattern = parse_pattern(folder.pattern, len(tiles))
        with replacing_all(*paths.values()) as opened:  # one after the other: a thread beside would not be interrupted
            for (kind, file_path), file in zip(paths.items(), opened, strict=True):
                names = [pattern.names(number, (kind,))[0] for number in tiles]
                with naming(file_path):
                    if kind == "exr":
                        metadata = frame_files.header(whole_scene, settled, settled.layers)
                        metadata = sealed(metadata, record_of(whole_scene, settled, chosen))
                        header = tiled_header(names[0], camera.resolution, tile, metadata)
                        join_tiles(file, header, names, across, down)
                    else:
                        png.encode_bands(file, columns, rows, _bands(names, across, columns))
        seconds = time.perf_counter() - start
    kept, size = folder.path if keep_tiles else None, sum(map(os.path.getsize, paths.values()))
    return Poster(tuple(map(os.fspath, paths.values())), run, camera.resolution, tile, size, seconds, kept)


def _bands(names: Sequence[str], across: int, columns: int) -> Iterator[Bytes]:
    """Yield the rows of tiles, `across` PNGs each, as images with this many columns."""
    for start in range(0, len(names), across):
        left = 0
        for picture in (png.read(name, alpha=True) for name in names[start : start + across]):
            if not left:
                band = np.empty((len(picture), columns, picture.shape[2]), np.uint8)
            band[:, left : left + picture.shape[1]] = picture
            left += picture.shape[1]
        yield band


# A tiled EXR put together from files of one tile each, without decoding them and with little memory. The layout is that of
# "The OpenEXR File Layout" (openexr.com): a header, a table of offsets, and chunks, each with the place of its tile.
# OpenEXR's own module writes whole images only.


def _not_a_tile(name: str, found: str) -> InputError:
    return file_error(shown(name), "file", "a tile of this image", found)


def _read_header(file: BinaryIO, name: str) -> tuple[int, Attributes]:
    """Read the version, the file's second word, and the header. Raises InputError, naming the file, if it has none."""
    if file.read(4) != exr_limits.MAGIC:
        raise _not_a_tile(name, "something else")
    version = int.from_bytes(file.read(4), "little")
    try:
        return version, {key: (kind, value) for key, kind, value in exr_limits.attributes(file)}
    except ValueError:
        raise _not_a_tile(name, "a damaged one") from None


def _opened(name: str) -> BinaryIO:
    try:
        return open(name, "rb")
    except OSError as error:
        raise _not_a_tile(name, reason_of(error)) from None


def tiled_header(tile_name: str, resolution: tuple[int, int], tile: int, metadata: Mapping[str, Any]) -> bytes:
    """Return the header of a tiled file, up to the table of offsets.

    tile_name: a file of one of the tiles, which has their channels and compression. resolution: (N, M) of the whole. tile:
    pixels a side. metadata: as for `exr.write`. Raises InputError if the file cannot be read.
    """
    with _opened(tile_name) as one:
        tile_version, shared = _read_header(one, tile_name)
    file = io.BytesIO()
    exr.encode(file, np.zeros((1, 1, 3), np.float32), metadata=metadata, tiled=True)
    file.seek(0)
    version, attributes = _read_header(file, "")
    attributes |= {name: shared[name] for name in _SHARED}
    window = struct.pack("<4i", 0, 0, resolution[0] - 1, resolution[1] - 1)
    size = struct.pack("<2I", tile, tile) + attributes[b"tiles"][1][8:]
    for name, value in ((b"dataWindow", window), (b"displayWindow", window), (b"tiles", size)):
        attributes[name] = attributes[name][0], value
    start = exr_limits.MAGIC + (version | tile_version).to_bytes(4, "little")  # a bit of it tells of long names
    for name, (kind, value) in attributes.items():
        start += b"\0".join([name, kind, len(value).to_bytes(4, "little") + value])
    return start + b"\0"


def join_tiles(file: BinaryIO, start: bytes, tiles: Iterable[str], across: int, down: int) -> None:
    """Write a tiled EXR to an open file.

    start: from `tiled_header`. tiles: names of `across` times `down` files of one tile each, row by row from the top, with
    the channels and the compression of the header. Raises InputError for a file that is not one of them.
    """
    _, shared = _read_header(io.BytesIO(start), "")
    file.write(start)
    file.write(bytes(8 * across * down))
    offsets = []
    for number, name in enumerate(tiles):
        offsets.append(file.tell())
        with _opened(name) as tile:
            _, tile_header = _read_header(tile, name)
            for key in _SHARED:
                if tile_header.get(key) != shared[key]:
                    raise _not_a_tile(name, f"one with other {key.decode()}")
            offset = int.from_bytes(tile.read(8), "little")  # of its only chunk, with which it ends
            size = tile.seek(0, io.SEEK_END) - offset - _CHUNK.size
            tile.seek(offset if size >= 0 else 0)
            if not offset or size < 0 or _CHUNK.unpack(tile.read(_CHUNK.size))[4] != size:
                raise _not_a_tile(name, "one that does not end with its pixels")
            file.write(_CHUNK.pack(number % across, number // across, 0, 0, size))
            shutil.copyfileobj(tile, file, 1 << 20)
    file.seek(len(start))
    file.write(struct.pack(f"<{len(offsets)}Q", *offsets))
    file.seek(0, io.SEEK_END)
