"""`grade`: an image against the right one, and what is wrong with it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array, Bools, Bytes, Floats
from ...base.atomic_files import shown
from ...base.input_files import file_error, first_bytes, reason_of
from ...errors import ClshadeError, InputError
from ...images import decode
from ...images.image_file import read_picture
from ...scene.model import Scene, Settings
from .drawing import Canvas, Drawing, as_codes
from .edge_mistakes import STEPS, snapped
from .search import Explanation, explain, wrong

_EXR, _ARRAYS = b"\x76\x2f\x31\x01", (".npy", ".npz")
_FEW = 0.05  # share of pixels, above which differences are no matter of edges
ENDINGS = (".png", ".exr", ".npy", ".npz", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif", ".ppm")


@dataclass(frozen=True, eq=False)
class Right:
    """The right image. drawing: what draws it. linear: (M, N, 3), row 0 at the top."""

    drawing: Drawing
    linear: Floats

    @property
    def codes(self) -> Floats:
        """The codes (M, N, 3) of its 8-bit file."""
        return np.rint(as_codes(self.linear))


@dataclass(frozen=True, eq=False)
class Grade:
    """What is found in an image.

    name: of its file. image: its codes (M, N, 3), 0 to 255. differ: number of pixels that differ by more than one code.
    edges: how many of these another rule for edges decides. worst: largest difference, codes. explanations: the best first,
    none if the image is right or nothing comes near.
    """

    name: str
    image: Floats
    differ: int
    edges: int
    worst: float
    explanations: tuple[Explanation, ...]

    @property
    def right(self) -> bool:
        return self.differ == self.edges

    @property
    def best(self) -> Explanation | None:
        return self.explanations[0] if self.explanations else None

    def facts(self) -> dict[str, Any]:
        """Return the results for programs."""
        return {
            "image": self.name,
            "right": self.right,
            "pixels": self.image.shape[0] * self.image.shape[1],
            "pixels_that_differ": self.differ,
            "of_these_on_edges": self.edges,
            "largest_difference": self.worst / 255.0,
            "explained": bool(self.best and self.best.claimed),
            "explanations": [_facts(each) for each in self.explanations],
        }


def _facts(found: Explanation) -> dict[str, Any]:
    return {
        "mistakes": [change.label for change in found.changes],
        "advice": [change.mistake.advice for change in found.changes],
        "difference_removed": found.removed,
        "pixels_made_right": found.fixed,
        "same_image": [[change.label for change in changes] for changes in found.same],
    }


def right_of(scene: Scene, settings: Settings) -> Right:
    """Draw the right image. Raises InputError for settings that are not modeled."""
    if settings.samples != 1 or settings.shader == "pbr" or settings.shadows or settings.ambient_occlusion:
        raise InputError(
            "grade: settings: expected one sample, shader gouraud, phong or nolight, no shadows, found others"
        )
    columns, rows = scene.camera.resolution
    if scene.camera.orthographic or any(mesh.blends or mesh.tests_alpha for mesh in scene.meshes):
        raise InputError(f"{scene.name}: expected opaque meshes seen in perspective, found others")
    drawing = Drawing(scene, settings)
    return Right(drawing, picture(drawing, (rows, columns)))


def all_pixels(shape: tuple[int, int]) -> Canvas:
    """Return the canvas of a whole image, (M, N)."""
    return Canvas(shape, *np.divmod(np.arange(shape[0] * shape[1]), shape[1]))


def picture(drawing: Drawing, shape: tuple[int, int]) -> Floats:
    """Return the linear image (M, N, 3) of a drawing, row 0 at the top."""
    return all_pixels(shape).linear(drawing).reshape(*shape, 3)


def explained_codes(right: Right, found: Explanation) -> Floats:
    """Return the codes (M, N, 3) of the image that the mistakes of an explanation give."""
    shape = right.linear.shape[0], right.linear.shape[1]
    return np.rint(all_pixels(shape).codes(found.draw(_seen(right, right.codes)))).reshape(right.linear.shape)


def read_codes(path: str | Path) -> Floats:
    """Read an image as codes (M, N, 3), 0 to 255, row 0 at the top: those of 8-bit files as they are; linear floats of EXR,
    .npy and .npz (its array `rgb`, or its only one) times 255, clipped to [0, 255]. Row 0 of an .npy is the bottom, as the
    course's functions return images; of all others it is the top. Raises InputError naming the file."""
    owner = shown(path)
    begin = first_bytes(path, len(_EXR))
    if begin == _EXR:
        color = read_picture(path).color()
        if color is None:
            raise file_error(owner, "channels", "R, G and B", "none")
        return as_codes(np.asarray(color[1], np.float64))
    if Path(path).suffix.lower() in _ARRAYS:
        codes = _codes_of(_array(path, owner), owner)
        return codes[::-1] if Path(path).suffix.lower() == ".npy" else codes
    codes = np.asarray(decode.read_image(path, srgb=False), np.float64) * 255.0
    return np.where(np.abs(codes - np.rint(codes)) < 1e-4, np.rint(codes), codes)


def _array(path: str | Path, owner: str) -> Array:
    try:
        found = np.load(path, allow_pickle=False)
        if isinstance(found, np.ndarray):
            return found
        with found:
            names = found.files
            if "rgb" in names or len(names) == 1:
                return np.asarray(found["rgb" if "rgb" in names else names[0]])
    except Exception as error:  # damaged archives raise exceptions of many types
        raise file_error(owner, "file", "an array", reason_of(error) or "damaged data") from None
    raise file_error(owner, "arrays", "one named rgb", ", ".join(names[:8]) or "none")


def _codes_of(array: Array, owner: str) -> Floats:
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "fu":
        raise file_error(owner, "array", "floats or uint8 of shape (M, N, 3)", f"{array.dtype} of shape {array.shape}")
    if array.dtype.kind == "f":
        return as_codes(array.astype(np.float64))
    return array.astype(np.float64) * (255.0 / np.iinfo(array.dtype).max)


def grade(path: str | Path, right: Right) -> Grade:
    """Grade an image file. Raises InputError if it cannot be read or has another size than the right image."""
    image = read_codes(path)
    if image.shape != right.linear.shape:
        (rows, columns), (M, N) = image.shape[:2], right.linear.shape[:2]
        exchanged = "; rows and columns exchanged? index image[row, column]" if (rows, columns) == (N, M) else ""
        raise file_error(
            shown(path), "size", f"{N} x {M} pixels, as the scene has (--resolution)", f"{columns} x {rows}{exchanged}"
        )
    return graded(image, right, shown(path))


def graded(image: Floats, right: Right, name: str) -> Grade:
    """Grade an image, codes (M, N, 3)."""
    expected = right.codes if (image == np.rint(image)).all() else as_codes(right.linear)
    differ = wrong(image, expected)
    edges = _on_edges(image, right, differ)
    worst = float(np.abs(image - expected).max())
    if (differ == edges).all():
        return Grade(name, image, int(differ.sum()), int(edges.sum()), worst, ())
    found = explain(_seen(right, image), image, right.linear, edges)
    return Grade(name, image, int(differ.sum()), int(edges.sum()), worst, tuple(found))


def _seen(right: Right, image: Floats) -> Drawing:
    """Return the right drawing with the color that the image has most often where the right one shows the background."""
    background = right.drawing.scene.background
    empty = (right.linear == (np.zeros(3) if background is None else background)).all(axis=2)
    if not empty.any():
        return right.drawing
    colors, counts = np.unique(image[empty], axis=0, return_counts=True)
    return replace(right.drawing, backdrop=colors[counts.argmax()] / 255.0)


def _on_edges(image: Floats, right: Right, differ: Bools) -> Bools:
    """Return (M, N) bool: which pixels that differ are right for an edge that is 1/256 px elsewhere: a fill rule, or how
    corners are rounded, decides these."""
    found = np.zeros_like(differ)
    if not 0 < differ.sum() <= _FEW * differ.size:
        return found
    rows, columns = np.nonzero(differ)
    canvas = Canvas((differ.shape[0], differ.shape[1]), rows, columns)
    for snap in STEPS.values():
        codes = np.rint(canvas.codes(snapped(right.drawing, snap)))
        found[rows, columns] |= ~wrong(image[rows, columns], codes)
    return found


# Folders


class Row(NamedTuple):
    """A submission that was graded: its facts, see `Grade.facts`, and 8-bit images (M, N, 3) of itself and of what explains
    it, if anything does."""

    facts: dict[str, Any]
    image: Bytes
    explained: Bytes | None


def submissions(folder: str | Path) -> list[Path]:
    """Return the image files of a folder, and of folders within it, in the order of their names: those with ENDINGS whose
    names, and folders' names, begin with no dot. Links to folders are not followed."""
    found = []
    for where, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        found += [Path(where, name) for name in sorted(names) if not name.startswith(".")]
    return [path for path in found if path.suffix.lower() in ENDINGS]


def _one(path: Path, right: Right) -> Row | str:
    try:
        found = grade(path, right)
    except ClshadeError as error:
        return str(error)
    explained = None if found.best is None else np.uint8(explained_codes(right, found.best))
    return Row(found.facts(), np.uint8(np.rint(found.image)), explained)


def grade_all(paths: Sequence[Path], right: Right) -> Iterator[Row | str]:
    """Grade files in parallel, and yield the result of each, or in one line why it cannot be read."""
    workers = min(len(paths), len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    if workers < 2:
        yield from map(partial(_one, right=right), paths)
        return
    with ProcessPoolExecutor(workers, get_context("forkserver"), _keep, (right,)) as pool:
        yield from pool.map(_kept_one, paths)


_kept: list[Right] = []


def _keep(right: Right) -> None:
    """Keep the right image in a worker."""
    _kept[:] = [right]


def _kept_one(path: Path) -> Row | str:
    return _one(path, _kept[0])
