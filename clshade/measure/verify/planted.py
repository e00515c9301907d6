"""Planted changes of an image: each has to be found by `verify`, or to lie outside its sample."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ... import oracle
from ...base.arrays import Array, Bools, Floats
from ...base.atomic_files import naming
from ...base.validation import integer
from ...errors import InputError
from ...images import exr, png
from ...pipeline.drawing_record import NOT_SEALED, RECORD, SEAL
from ...scene.model import Mesh, Scene, with_materials
from ..check import oracle_bounds
from .confidence import sampled
from .recorded_image import RecordedImage, nearest_stored, read_recorded
from .verify import as_drawn, verified

_TRIES = 1000  # at a change that is none
_REFUSED = ("header record", "rows cut off", "file cut off")  # kinds of which nothing may be left that can be judged


@dataclass(frozen=True, eq=False)
class _Files:
    """What is changed: the EXR's channels and header, the PNG's codes, and the scene that is given. left: hundredths of the
    EXR that are not cut off."""

    planes: dict[str, Array]
    header: dict[str, Any]
    codes: Array | None
    scene: Scene
    left: int = 100


_Change = Callable[[_Files, Any], _Files]  # by a random generator; the same files if there is nothing to change
# Of colors (K, L, 3), with the largest that are allowed, by a random generator.
_ColorChange = Callable[[Floats, Array, Any], Array]


@dataclass
class Planted:
    """The result. found, outside: numbers of changes by kind, those found at once, and by `--all` alone. missed: kinds and
    seeds of those not found."""

    found: Counter[str] = field(default_factory=Counter)
    outside: Counter[str] = field(default_factory=Counter)
    missed: list[tuple[str, int]] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether every change was found, or was outside the sample and then found among all pixels."""
        return not self.missed

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        every = self.found + self.outside
        return [
            *(
                f"{k}: {self.found[k]:,} found, {self.outside[k]:,} outside the sample, found by --all"
                for k in sorted(every)
            ),
            f"{every.total():,} planted changes found",
            *(f"MISSED: {kind}, seed {seed}" for kind, seed in self.missed),
        ]

    def stats(self) -> dict[str, Any]:
        """Return the figures as JSON-compatible values."""
        return {**vars(self), "passed": self.passed}


def plant(image: RecordedImage, scene: Scene, count: int, *, pixels: int, seed: int = 0) -> Planted:
    """Change an image that is right in `count` ways, each with a seed of its own from `seed` on, and verify each. Raises
    InputError if it cannot be judged, or is wrong already."""
    count = integer("verify", "planted", count, 1, 2**31)
    pixels = integer("verify", "pixels", pixels, 1, 2**63)
    seed = integer("verify", "seed", seed, 0, 2**63)
    if not verified(image, [scene], pixels="all").passed:
        raise InputError(f"verify: --planted: expected an image that is right, found faults in {image.path}")
    planes, header = exr.read(image.path)
    picture = image.path.with_suffix(".png")
    codes = png.read(picture, alpha=True) if picture.exists() else None
    planting = _Planting(image, _Files(planes, header, codes, scene), pixels)
    found = Planted()
    with naming("temporary folder"), tempfile.TemporaryDirectory() as folder:
        for number in range(seed, seed + count):
            planting.try_change(number, Path(folder) / "planted.exr", found)
    return found


class _Planting:
    """Changes of one image. pixels: of the sample."""

    def __init__(self, image: RecordedImage, files: _Files, pixels: int) -> None:
        self._files, self._pixels, self._exact = files, pixels, image.exact
        self._half = image.record.storage.half
        scene, settings = as_drawn(files.scene, image.record), image.record.settings
        expected = oracle.render(scene, settings)
        factor = oracle_bounds.allowed(scene, settings)
        self._right = expected.rgb
        most = factor * oracle_bounds.color_bound(expected, settings.precision) + expected.jump
        self._most = np.maximum(most, oracle_bounds.FLOAT32_TINY)
        # A tie is no fault, whatever its color.
        everywhere = np.ones(expected.alpha.shape, bool)
        self._decided = ~(expected.unsure | oracle_bounds.depth_ties(scene, settings, everywhere))
        self._kinds: dict[str, _Change] = {
            **{f"color {name}": self._changed_color(change) for name, change in _COLORS.items()},
            **{f"layer {name}": _changed_layer(name) for name in ("A", "id", "Z") if name in files.planes},
            **{f"scene {name}": _changed_scene(change) for name, change in _SCENES.items()},
            "header attribute": _changed_attribute,
            "header record": _changed_record,
            "rows cut off": lambda files, random: replace(files, planes={n: p[:-1] for n, p in files.planes.items()}),
            "file cut off": lambda files, random: replace(files, left=int(random.integers(4, 95))),
        }
        if files.codes is not None:
            self._kinds["PNG code"] = _changed_code

    def try_change(self, seed: int, path: Path, found: Planted) -> None:
        """Plant the change of a seed, and count whether it was found."""
        random = np.random.default_rng(seed)
        kinds = sorted(self._kinds)
        first = seed % len(kinds)
        # An image of one color stays as it is if it is moved: then the next kind is planted.
        tried = ((kind, self._kinds[kind](self._files, random)) for kind in kinds[first:] + kinds[:first])
        kind, changed = next(each for each in tried if each[1] is not self._files)
        self._write(path, changed)

        def is_found(pixels: Any) -> bool:
            try:
                return not verified(read_recorded(path), [changed.scene], pixels=pixels, seed=seed).passed
            except InputError:
                return kind in _REFUSED

        if is_found(self._pixels):
            found.found[kind] += 1
        elif self._is_outside(changed, seed) and is_found("all"):
            found.outside[kind] += 1
        else:
            found.missed.append((kind, seed))

    def _write(self, path: Path, files: _Files) -> None:
        metadata = {name: value for name, value in files.header.items() if name not in exr.PROTECTED}
        compression = files.header["compression"]
        exr.write(path, files.planes, metadata=metadata, half=self._half, compression=compression)
        data = path.read_bytes()
        path.write_bytes(data[: len(data) * files.left // 100])
        path.with_suffix(".png").unlink(missing_ok=True)
        if files.codes is not None:
            with open(path.with_suffix(".png"), "wb") as file:
                png.encode(file, files.codes)

    def _is_outside(self, changed: _Files, seed: int) -> bool:
        """Return whether all changed pixels are outside the sample."""
        other = np.zeros(self._decided.shape, bool)
        for name, plane in self._files.planes.items():
            other |= (changed.planes[name] != plane) & ~(np.isnan(changed.planes[name]) & np.isnan(plane))
        at = np.flatnonzero(other)
        return len(at) > 0 and not np.isin(at, sampled(other.size, self._pixels, seed)).any()

    def _changed_color(self, change: _ColorChange) -> _Change:
        """Return what changes the colors of a pixel, a block of them, or a part of a row by more than is allowed, without
        the PNG, whose colors would tell."""

        def changed(files: _Files, random: Any) -> _Files:
            rgb = np.stack([files.planes[name] for name in "RGB"], axis=-1)
            for _ in range(_TRIES):
                rows, columns = random.choice([(1, 1), (4, 4), (1, 32)])
                row, column = _place(rgb[..., 0], random)
                where = slice(row, row + int(rows)), slice(column, column + int(columns))
                new = rgb.copy()
                most = (self._right + self._most)[where].astype(np.float16 if self._half else rgb.dtype)
                new[where] = change(rgb[where].astype(np.float64), most, random)
                read: Floats = (
                    new.astype(np.float64) if self._exact else nearest_stored(new.astype(most.dtype), self._right)
                )
                is_wrong: Bools = np.asarray(~(np.abs(read - self._right) <= self._most).all(axis=-1))
                new = np.where((is_wrong & self._decided)[..., None], new, rgb)
                if not np.array_equal(new, rgb, equal_nan=True):
                    planes = {**files.planes, **{name: new[..., k] for k, name in enumerate("RGB")}}
                    return replace(files, planes=planes, codes=None)
            return files

        return changed


def _place(array: Array, random: Any) -> tuple[int, ...]:
    return tuple(int(random.integers(size)) for size in array.shape)


def _next_beyond(colors: Floats, most: Array, random: Any) -> Array:
    """Return the next number, as stored, beyond the largest color that is allowed."""
    beyond: Array = np.nextafter(np.nextafter(most, most.dtype.type(np.inf)), most.dtype.type(np.inf))
    return beyond


_COLORS: Mapping[str, _ColorChange] = {
    "an ulp beyond its bound": _next_beyond,
    "1 % brighter": lambda colors, most, random: 1.01 * colors,
    "NaN": lambda colors, most, random: np.full_like(colors, np.nan),
    "negative": lambda colors, most, random: -colors - 1e-3,
    "channels exchanged": lambda colors, most, random: colors[..., ::-1],
    "moved by a column": lambda colors, most, random: np.roll(colors, 1, axis=1),
}


def _changed_layer(name: str) -> _Change:
    """Return what changes a number of a layer in one pixel."""

    def changed(files: _Files, random: Any) -> _Files:
        plane = files.planes[name].copy()
        at = _place(plane, random)
        value = plane[at]
        if name == "id":
            plane[at] = value + 1
        elif name == "A":
            plane[at] = 1.0 - value if value != 0.5 else 1.0
        else:
            plane[at] = value * np.float32(1.0 + 2.0**-18) if np.isfinite(value) else 1.0
        return replace(files, planes={**files.planes, name: plane})

    return changed


def _changed_attribute(files: _Files, random: Any) -> _Files:
    """Change, remove or add an attribute of the header."""
    ours = sorted(name for name in files.header if name not in NOT_SEALED - {SEAL} and name != RECORD)
    name = ours[int(random.integers(len(ours)))]
    value = files.header[name]
    if isinstance(value, str):
        value = value[:-1] + ("x" if value[-1:] != "x" else "y")
    else:
        value = np.float32(2.0) * value + 1 if isinstance(value, np.ndarray) else 2 * value + 1
    changes: list[dict[str, Any]] = [{name: value}, {"added": "by someone"}]
    changes += [] if name == "pixelAspectRatio" else [{name: None}]  # every file has one
    return replace(files, header={**files.header, **changes[int(random.integers(len(changes)))]})


def _changed_record(files: _Files, random: Any) -> _Files:
    """Change a letter of the record, or leave one out."""
    text = files.header[RECORD]
    at = int(random.integers(len(text)))
    new = text[:at] + str(random.choice(["", "0", "x", '"', "}", "9e999"])) + text[at + 1 :]
    if new == text:
        new = text + " "
    return replace(files, header={**files.header, RECORD: new})


def _changed_scene(change: Callable[[Scene, Any], Scene]) -> _Change:
    return lambda files, random: replace(files, scene=change(files.scene, random))


def _moved_vertex(scene: Scene, random: Any) -> Scene:
    k = int(random.integers(len(scene.meshes)))
    mesh = scene.meshes[k]
    verts = np.array(mesh.verts)
    at = _place(verts, random)
    verts[at] = np.nextafter(verts[at], verts.dtype.type(np.inf))
    return replace(scene, meshes=(*scene.meshes[:k], replace(mesh, verts=verts), *scene.meshes[k + 1 :]))


def _nudged(value: Any) -> Any:
    return np.nextafter(np.asarray(value, np.float64), np.inf)


def _changed_light(scene: Scene, random: Any) -> Scene:
    if not scene.lights:
        return replace(scene, ambient=_nudged(scene.ambient))
    first, *others = scene.lights
    return replace(scene, lights=(replace(first, intensity=_nudged(first.intensity)), *others))


_SCENES: Mapping[str, Callable[[Scene, Any], Scene]] = {
    "vertex moved by an ulp": _moved_vertex,
    "material": lambda scene, random: with_materials(scene, lambda each: replace(each, kd=_nudged(each.kd))),
    "light": _changed_light,
    "camera": lambda scene, random: replace(scene, camera=replace(scene.camera, eye=_nudged(scene.camera.eye))),
    "mesh left out": lambda scene, random: replace(scene, meshes=(*scene.meshes[1:], Mesh(np.eye(3), [[0, 1, 2]]))),
}


def _changed_code(files: _Files, random: Any) -> _Files:
    assert files.codes is not None
    codes = files.codes.copy()
    at = _place(codes, random)
    codes[at] += 1 if codes[at] < 255 else -1
    return replace(files, codes=codes)
