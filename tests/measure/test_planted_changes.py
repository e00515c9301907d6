"""`clshade.verify` finds changes that are planted in an image, its header, its scene and the PNG beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracle_frames import frame_of

from clshade import oracle
from clshade.errors import InputError
from clshade.images import exr, png
from clshade.measure.check import oracle_bounds
from clshade.measure.verify.recorded_image import nearest_stored, read_recorded
from clshade.measure.verify.verify import as_drawn, verified
from clshade.pipeline.frame_results import NOT_SEALED, RECORD, SEAL
from clshade.scene.builtin import scenes
from clshade.scene.model import Mesh, Scene, Settings, with_materials


@dataclass(frozen=True)
class Files:
    planes: dict[str, np.ndarray]
    header: dict[str, Any]
    codes: np.ndarray | None
    scene: Scene


class Planting:
    def __init__(self, folder: Path, half: bool) -> None:
        scene, self.half = scenes.teapot(3, (80, 60)), half
        frame_of(scene, Settings(layers=("Z", "id"))).save(folder / "teapot", half=half)
        image = read_recorded(folder / "teapot.exr")
        assert verified(image, [scene], pixels="all").passed
        self.files = Files(*exr.read(image.path), png.read(folder / "teapot.png", alpha=True), scene)
        shown, settings = as_drawn(scene, image.record), image.record.settings
        expected = oracle.render(shown, settings)
        bound = oracle_bounds.color_bound(expected, settings.precision)
        limit = oracle_bounds.allowed(shown, settings) * bound + expected.jump
        self.right, self.most = expected.rgb, np.maximum(limit, oracle_bounds.FLOAT32_TINY)
        everywhere = np.ones(expected.alpha.shape, bool)
        self.decided = ~(expected.unsure | oracle_bounds.depth_ties(shown, settings, everywhere))  # a tie is no fault

    def color(self, change, files: Files, random) -> Files:
        """Change colors of a pixel, a block or a part of a row by more than is allowed, without the PNG that would tell."""
        rgb = np.stack([files.planes[name] for name in "RGB"], axis=-1)
        while True:
            rows, columns = random.choice([(1, 1), (4, 4), (1, 32)])
            row, column = place(rgb[..., 0], random)
            where = slice(row, row + int(rows)), slice(column, column + int(columns))
            new = rgb.copy()
            limit = (self.right + self.most)[where].astype(rgb.dtype)
            new[where] = change(rgb[where].astype(np.float64), limit)
            read = nearest_stored(new, self.right) if self.half else new.astype(np.float64)
            is_wrong = ~(np.abs(read - self.right) <= self.most).all(axis=-1)
            new = np.where((is_wrong & self.decided)[..., None], new, rgb)
            if not np.array_equal(new, rgb, equal_nan=True):
                planes = {**files.planes, **{name: new[..., k] for k, name in enumerate("RGB")}}
                return replace(files, planes=planes, codes=None)


def place(array: np.ndarray, random) -> tuple[int, ...]:
    return tuple(int(random.integers(size)) for size in array.shape)


def changed_layer(name: str, files: Files, random) -> Files:
    plane = files.planes[name].copy()
    at = place(plane, random)
    value = plane[at]
    wrong = {"id": value + 1, "A": 1.0 - value if value != 0.5 else 1.0}
    plane[at] = wrong.get(name, value * np.float32(1.0 + 2.0**-18) if np.isfinite(value) else 1.0)
    return replace(files, planes={**files.planes, name: plane})


def changed_attribute(files: Files, random) -> Files:
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


def changed_record(files: Files, random) -> Files:
    text = files.header[RECORD]
    at = int(random.integers(len(text)))
    new = text[:at] + str(random.choice(["", "0", "x", '"', "}", "9e999"])) + text[at + 1 :]
    return replace(files, header={**files.header, RECORD: new if new != text else text + " "})


def changed_code(files: Files, random) -> Files:
    codes = files.codes.copy()
    at = place(codes, random)
    codes[at] += 1 if codes[at] < 255 else -1
    return replace(files, codes=codes)


def next_to(values: Any) -> np.ndarray:
    values = np.asarray(values)
    return np.nextafter(values, values.dtype.type(np.inf))


COLORS = {  # of colors (K, L, 3) with the largest that are allowed
    "an ulp beyond its bound": lambda rgb, limit: next_to(next_to(limit)),
    "1 % brighter": lambda rgb, limit: 1.01 * rgb,
    "NaN": lambda rgb, limit: np.full_like(rgb, np.nan),
    "negative": lambda rgb, limit: -rgb - 1e-3,
    "channels exchanged": lambda rgb, limit: rgb[..., ::-1],
    "moved by a column": lambda rgb, limit: np.roll(rgb, 1, axis=1),
}
SCENES = {
    "meshes": lambda scene: replace(scene, meshes=(*scene.meshes[1:], Mesh(np.eye(3), [[0, 1, 2]]))),
    "materials": lambda scene: with_materials(scene, lambda material: replace(material, kd=next_to(material.kd))),
    "lights": lambda scene: replace(scene, lights=()),
    "camera": lambda scene: replace(scene, camera=replace(scene.camera, eye=next_to(scene.camera.eye))),
}
OTHERS = {"header attribute": changed_attribute, "header record": changed_record, "PNG code": changed_code}


def missed(folder: Path, count: int, half: bool = False) -> list[str]:
    """Plant changes, one after another of each kind. Return those that are not found."""
    planting = Planting(folder, half)
    kinds = [
        *((f"color {name}", partial(planting.color, change)) for name, change in COLORS.items()),
        *((f"layer {name}", partial(changed_layer, name)) for name in ("A", "id", "Z")),
        *(
            (f"scene {name}", lambda files, random, change=change: replace(files, scene=change(files.scene)))
            for name, change in SCENES.items()
        ),
        *OTHERS.items(),
    ]
    lines = []
    for seed in range(count):
        kind, change = kinds[seed % len(kinds)]
        changed = change(planting.files, np.random.default_rng(seed))
        written(folder / "planted.exr", changed, half)

        try:
            image = read_recorded(folder / "planted.exr")
            is_found = not verified(image, [changed.scene], pixels="all").passed
        except InputError:
            is_found = kind == "header record"  # nothing may be left of it that can be judged
        if not is_found:
            lines.append(f"{kind}, seed {seed}")
    return lines


def written(path: Path, files: Files, half: bool) -> None:
    metadata = {name: value for name, value in files.header.items() if name not in exr.PROTECTED}
    exr.write(path, files.planes, metadata=metadata, half=half, compression=files.header["compression"])
    path.with_suffix(".png").unlink(missing_ok=True)
    if files.codes is not None:
        png.write(path.with_suffix(".png"), files.codes)


@pytest.mark.sampled
@pytest.mark.parametrize(("count", "half"), [(30, True), (30, False), (1000, False)])
def test_changes_are_found(tmp_path, count, half):
    """Those of half floats are beyond what half hides."""
    assert missed(tmp_path, count, half) == []
