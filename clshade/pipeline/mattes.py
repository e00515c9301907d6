"""Cryptomatte layers of a frame: what each sample of its pixels shows."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np

from ..base.arrays import Array
from ..base.validation import arguments, choice, integer, sequence, value_error
from ..images.cryptomatte import MATTES, MAX_RANKS, RANKS, Matte, MatteKind, hashes, matte
from ..scene.settings import Layer
from . import sample_pattern
from .effective_settings import numbers_alone
from .frame import Frame
from .layers import number_names
from .renderer import Renderer

if TYPE_CHECKING:
    from .opencl.device import Device


@arguments(frame=Frame)
def cryptomatte(
    frame: Frame, kinds: Sequence[MatteKind] = MATTES, *, ranks: int = RANKS, device: Device | str | None = None
) -> dict[MatteKind, Matte]:
    """Return Cryptomatte layers of a frame: for each pixel the things that its samples show, and the share of each.

    For each kind these are `channels`, arrays (M, N) float32 such as ``CryptoObject00.R``, and `metadata` for
    the header of an EXR file. Shares are exact: numbers of samples over all. What blends counts as layers do,
    by `layer_alpha`. Raises InputError without mmh3.

    Parameters
    ----------
    frame : Frame
        As `Renderer.render` draws it. Its scene is drawn again, unlit, for each sample of its
        settings.
    kinds : sequence of {"object", "material", "instance"}, default all
        What has masks: meshes, materials, placements of meshes. Unnamed ones are called ``object
        1``, ``material 1``, ``instance 1`` and so on, after the layers `object_id`, `material_id`
        and `instance_id`.
    ranks : int, 1 to 64, default 6
        Things that a pixel lists at most: those that most of its samples show.
    device : Device or str, optional
        As for `Renderer`. The masks are the same on every device.
    """
    asked = check_mattes(kinds)
    integer("cryptomatte", "ranks", ranks, 1, MAX_RANKS)
    scene, settings = frame.scene, frame.settings
    layers: dict[MatteKind, Layer] = {kind: cast("Layer", f"{kind}_id") for kind in MATTES if kind in asked}
    numbers: dict[MatteKind, list[Array]] = {kind: [] for kind in layers}
    with Renderer(scene, settings=numbers_alone(settings, tuple(layers.values())), device=device) as renderer:
        for place in sample_pattern.positions(settings.samples):  # nearest to the center first
            if settings.samples > 1:
                renderer.place_samples(place[None])
            drawn = renderer.render()
            for kind, layer in layers.items():
                numbers[kind].append(drawn[layer])
    mattes = {}
    for kind, layer in layers.items():
        names = {number: name or f"{kind} {number}" for number, name in number_names(scene, layer)}
        mattes[kind] = matte(f"Crypto{kind.capitalize()}", np.array(numbers[kind]), names, ranks)
    return mattes


def check_mattes(kinds: Sequence[MatteKind], files: Container[str] = ("exr",)) -> tuple[MatteKind, ...]:
    """Return kinds of `frame.mattes`. Raises InputError for others, without mmh3, and if these files of `Frame.save` do not
    hold them."""
    asked = None if isinstance(kinds, str) else sequence(kinds)
    if not asked:
        raise value_error("cryptomatte", "kinds", f"one or more of {', '.join(MATTES)}", kinds)
    for kind in asked:
        choice("cryptomatte", "kinds", kind, MATTES)
    hashes(())  # before anything is drawn: raises without mmh3
    if "exr" not in files:
        raise value_error("cryptomatte", "files", "exr among them, which holds it", files)
    return tuple(asked)
