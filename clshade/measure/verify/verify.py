"""Verify an image in a file: recompute a random sample of its pixels with the oracle, and compare what is beside it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ... import oracle
from ...base.arrays import Array, Bools
from ...base.atomic_files import shown as shown_path
from ...base.input_files import file_error
from ...base.validation import count_or_all, integer, value_error
from ...base.version import VERSION
from ...errors import InputError
from ...images import png
from ...images.layers import LAYER_TABLE
from ...images.tonemap import JOINT
from ...oracle import OracleFrame, OracleLayers
from ...pipeline import frame_files
from ...pipeline.effective_settings import effective_settings
from ...pipeline.frame import Frame
from ...pipeline.struct_layout import kernels_digest
from ...scene.builtin import scenes
from ...scene.description import part_digests
from ...scene.model import Scene
from ..check import oracle_bounds
from ..check.check import Comparison
from ..check.layer_bounds import layer_errors
from ..defaults import SAMPLE
from .confidence import sampled, upper_bound
from .recorded_image import Record, RecordedImage, Storage, nearest_stored, read_recorded, stored_range
from .verification import Verification

_ENTROPY = 6  # bytes of a seed that nobody chose
_UNKNOWN = 0.01  # of the pixels; of an image in which more cannot be judged nothing is said


def verify(
    path: str | os.PathLike[str],
    scene: Scene | None = None,
    *,
    pixels: int | Literal["all"] = SAMPLE,
    seed: int | None = None,
) -> Verification:
    """Verify an image that `Frame.save` wrote: compute random pixels again in float64, without OpenCL.

    Parameters
    ----------
    path : str or path-like
        An EXR. The PNG beside it is compared too, if there is one.
    scene : Scene, optional
        What it shows, with its camera, as it was given to `clshade.render`. Default: the built-in scene
        that the header names.
    pixels : int or "all", default 4605
        Number of pixels to compute again, at least 1, or "all". If none of 4605 is wrong, fewer than
        0.1 % of all pixels are, with 99 % confidence.
    seed : int, optional
        Seed of the sample, 0 to 2^64 - 1. Default: one that nobody can foresee.

    Returns
    -------
    Verification
        Whether the image `passed`, and what is wrong.

    Raises
    ------
    InputError
        If the file cannot be judged: it is no EXR of clshade's, has no record, is of another size than
        that says, or shows a scene that is not known, or faces at one depth in more than 1 % of it.

    Notes
    -----
    The pixels are drawn uniformly, without replacement. What is right is what `clshade.check` accepts,
    which does not depend on the kernels. Values that are stored as half, or of float64 as float32, may
    have been any that are stored so.

    Examples
    --------
    >>> clshade.render(clshade.builtin("teapot")).save("teapot")
    []
    >>> clshade.verify("teapot.exr").passed
    True
    """
    if scene is not None and not isinstance(scene, Scene):
        raise value_error("verify", "scene", "a Scene", scene)
    image = read_recorded(path)
    return verified(image, [builtin_of(image.record) if scene is None else scene], pixels=pixels, seed=seed)


def builtin_of(record: Record) -> Scene:
    """Return the built-in scene that a record names, with its camera. Raises InputError if it names none, or another."""
    expected = "verify: scene: expected the Scene that was drawn, found"
    if record.name not in scenes.BUILTINS:
        raise InputError(f"{expected} none for {record.name!r}")
    assert record.camera is not None
    scene = replace(scenes.builtin(record.name), camera=record.camera)
    if closest([scene], record)[1]:  # which needs not be wrong: anyone may name a scene so
        raise InputError(f"{expected} only another one, the built-in scene named {record.name!r}")
    return scene


def verified(
    image: RecordedImage, candidates: Sequence[Scene], *, pixels: int | Literal["all"] = SAMPLE, seed: int | None = None
) -> Verification:
    """Return the result for an image of one of these scenes, see `verify`."""
    record = image.record
    rows, columns = image.channels["RGBA"].shape[:2]
    of = rows * columns
    count = count_or_all("verify", "pixels", pixels, of)
    unforeseen = int.from_bytes(os.urandom(_ENTROPY), "big")
    seed = unforeseen if seed is None else integer("verify", "seed", seed, 0, 2**64 - 1)
    scene, different = closest(candidates, record)
    drawn_by = f"clshade {record.version}" + (f" on {record.device}" if record.device else "")
    if different:
        fault = f"the scene is not the one that was drawn: its {', '.join(different)} differ"
        return Verification(0, of, drawn_by=drawn_by, faults=(fault, *image.faults), remarks=_remarks(image))
    drawn_scene = as_drawn(scene, record)
    index = sampled(of, count, seed)
    found, is_wrong, is_unknown = _judge(image, drawn_scene, *np.divmod(index, columns))
    picture = _picture(image, drawn_scene)
    faults = (*image.faults, *picture.faults)
    wrong, unknown = index[is_wrong].tolist(), int(is_unknown.sum())
    if unknown > max(1.0, _UNKNOWN * count) and not (wrong or faults):
        expected = f"at most {_UNKNOWN:.0%} of the pixels at faces of one depth, where either may show"
        unjudged = f"{unknown:,} of {count:,}, which cannot be judged"
        raise file_error(shown_path(image.path), "pixels", expected, unjudged)
    return Verification(
        pixels=count,
        of=of,
        wrong=len(wrong),
        at_most=upper_bound(len(wrong) + unknown, count, of),
        bounds=float(found.counted.max(initial=0.0)),
        allowed=found.allowed,
        ties=unknown,
        gates=int(found.gates.sum()),
        worst=divmod(wrong[0], columns) if wrong else None,
        seed=seed if count < of else None,
        drawn_by=drawn_by,
        compared=("color", "coverage", *record.settings.layers, *(["PNG"] if picture.compared else [])),
        faults=faults,
        remarks=(*_remarks(image), *picture.remarks),
    )


def as_drawn(scene: Scene, record: Record) -> Scene:
    """Return the scene as the settings of the record show it, in the image's resolution."""
    camera = record.camera
    assert camera is not None
    return effective_settings(scene, settings=record.settings, resolution=camera.resolution)[0]


def closest(candidates: Sequence[Scene], record: Record) -> tuple[Scene, list[str]]:
    """Return the scene that differs least from the one that was drawn, and the parts in which it does."""

    def different(scene: Scene) -> list[str]:
        digests = part_digests(as_drawn(scene, record))
        return [name for name, digest in digests.items() if digest != record.scene[name]]

    return min(((scene, different(scene)) for scene in candidates), key=lambda candidate: len(candidate[1]))


def _remarks(image: RecordedImage) -> tuple[str, ...]:
    record, remarks = image.record, []
    if record.version != VERSION or record.kernels != kernels_digest():
        remarks.append(f"drawn by clshade {record.version} with other kernels or another version than {VERSION}")
    if image.others:
        remarks.append(f"not looked at: {', '.join(image.others[:8])}{' ...' if len(image.others) > 8 else ''}")
    return tuple(remarks)


# Pixels


def _judge(image: RecordedImage, scene: Scene, rows: Array, columns: Array) -> tuple[Comparison, Bools, Bools]:
    """Compare pixels with the oracle: colors, coverage and all layers. Return also which are wrong, and which may be."""
    settings, where = image.record.settings, (rows, columns)
    expected = oracle.render(scene, settings, rows, columns)
    names = [name for name in settings.layers if name not in ("Z", "id")]
    layers = oracle.render_layers(scene, settings, rows, columns) if names else None
    frame = _frame(image, scene, expected, layers, where)
    comparison = Comparison(frame, expected, rows, columns)
    compared = ~comparison.wrong & ~comparison.ties
    wrong = comparison.wrong | (compared & (comparison.counted > comparison.allowed))
    if "Z" in frame.layers:
        roundings = oracle_bounds.depth_errors(frame["Z"][where], expected)
        wrong |= compared & ~(roundings <= oracle_bounds.depth_roundings(frame.alpha))
    if layers is not None:
        wrong |= ~comparison.ties & ~expected.unsure & _wrong_layers(frame, layers, names, where)
    unknown = comparison.ties | (expected.unsure if layers is not None else False)
    return comparison, wrong, unknown & ~wrong


def _frame(
    image: RecordedImage, scene: Scene, expected: OracleFrame, layers: OracleLayers | None, where: tuple[Array, Array]
) -> Frame:
    """Return the frame in the file. At these pixels its values are, of all that are stored so, nearest to the expected."""
    settings = image.record.settings
    real = oracle_bounds.real_of(settings)
    right = {"RGBA": np.concatenate([expected.rgb, expected.alpha[:, None]], axis=1), "Z": expected.Z}
    channels = dict(image.channels)
    kinds: dict[str, Any] = {"RGBA": real, **{name: LAYER_TABLE[name].dtype(real) for name in settings.layers}}
    for name, values in channels.items():
        if values.dtype == kinds[name]:
            continue
        value = right[name] if name in right else getattr(layers, name)
        channels[name] = values.astype(kinds[name])
        channels[name][where] = nearest_stored(values[where], value)
    return Frame(channels.pop("RGBA"), channels, scene, settings, dict)


def _wrong_layers(frame: Frame, layers: OracleLayers, names: Sequence[str], where: tuple[Array, Array]) -> Bools:
    """Return where a layer is beyond its bound, or not finite although it has to be, (K,) bool."""
    wrong, values = np.zeros(len(where[0]), bool), {}
    for name in names:
        value = frame[name][where]
        if value.dtype.kind == "f":
            refused = np.isinf(value) if name == "scalar" else ~np.isfinite(value)
            wrong |= refused.reshape(len(value), -1).any(axis=1)
            value = np.where(refused, value.dtype.type(0), value)
        values[name] = value
    with np.errstate(invalid="ignore"):
        for errors in layer_errors(values, layers, frame.scene, frame.settings).values():
            wrong |= ~(errors <= 1.0)
    return wrong


# The PNG beside the EXR


@dataclass(frozen=True)
class _Picture:
    """What is found in the PNG beside an EXR. compared: whether it could be."""

    compared: bool = False
    faults: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def _picture(image: RecordedImage, scene: Scene) -> _Picture:
    """Compare the PNG beside an EXR, if there is one, with it."""
    path, how = image.path.with_suffix(".png"), image.record.storage
    if not path.exists():
        return _Picture()
    if not image.exact and (how.tonemap in JOINT or scene.background is None):
        return _Picture(remarks=(f"not looked at: {path.name}, whose colors the EXR holds rounded",))
    try:
        codes = png.read(path, alpha=True)
    except InputError as error:
        return _Picture(faults=(str(error),))
    low, high = _codes(image, scene, how)
    if codes.shape != low.shape:
        size, found_size = ("{1} x {0} pixels of {2} channels".format(*array.shape) for array in (low, codes))
        return _Picture(True, (f"{path.name} is of another size: expected {size}, found {found_size}",))
    differing = np.argwhere(((codes < low) | (codes > high)).any(axis=-1))
    if not len(differing):
        return _Picture(True)
    place = "the first at row {}, column {}".format(*differing[0])
    return _Picture(True, (f"{path.name} is not the EXR, tone-mapped: {len(differing):,} pixels differ, {place}",))


def _codes(image: RecordedImage, scene: Scene, how: Storage) -> tuple[Array, Array]:
    """Return the least and the largest codes that the PNG may have."""
    rgba, settings = image.channels["RGBA"], image.record.settings
    found = []
    for values in (rgba,) if image.exact else stored_range(rgba):
        codes = Frame(values, {}, scene, settings, dict).to_png8(how.tonemap, how.exposure)
        if how.colorbar:
            codes = frame_files.with_colorbar(codes, scene, settings, how.tonemap, how.exposure)
        found.append(codes)
    return found[0], found[-1]
