"""Cryptomatte layers of a frame: what each sample of its pixels shows."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..base.arrays import Array
from ..base.validation import arguments, choice, integer, sequence, value_error
from ..images.cryptomatte import MATTES, MOST_RANKS, RANKS, Matte, MatteKind, hashes, matte
from ..scene.settings import Layer
from . import sample_pattern
from .effective_settings import numbers_alone
from .frame import Frame
from .layer_buffers import number_names
from .renderer import Renderer

if TYPE_CHECKING:
    from .opencl.device import Device


# Layer, and name of the Cryptomatte layer.
_LAYERS: dict[MatteKind, tuple[Layer, str]] = {
    "object": ("object_id", "CryptoObject"),
    "material": ("material_id", "CryptoMaterial"),
    "instance": ("instance_id", "CryptoInstance"),
}


@arguments(frame=Frame)
def cryptomatte(
    frame: Frame, kinds: Sequence[MatteKind] = MATTES, *, ranks: int = RANKS, device: Device | str | None = None
) -> dict[MatteKind, Matte]:
    """Return Cryptomatte layers of a frame: for each pixel the things that its samples show, and the share of each.

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

    Returns
    -------
    dict
        For each kind `channels`, arrays (M, N) float32 such as ``CryptoObject00.R``, and `metadata`
        for the header of an EXR file.

    Raises
    ------
    InputError
        If an argument is refused, or mmh3 is not installed.

    Notes
    -----
    Shares are exact: numbers of samples over all. What blends counts as layers do, by `layer_alpha`.
    """
    asked = _checked_kinds(kinds)
    integer("cryptomatte", "ranks", ranks, 1, MOST_RANKS)
    scene, settings = frame.scene, frame.settings
    layers = tuple(_LAYERS[kind][0] for kind in asked)
    numbers: dict[Layer, list[Array]] = {layer: [] for layer in layers}
    with Renderer(scene, settings=numbers_alone(settings, layers), device=device) as renderer:
        for place in sample_pattern.positions(settings.samples):  # nearest to the center first
            if settings.samples > 1:
                renderer.place_samples(place[None])
            drawn = renderer.render()
            for layer, shown in numbers.items():
                shown.append(drawn[layer])
    mattes = {}
    for kind in MATTES:
        if kind in asked:
            layer, label = _LAYERS[kind]
            names = {number: name or f"{kind} {number}" for number, name in number_names(scene, layer)}
            mattes[kind] = matte(label, np.array(numbers[layer]), names, ranks)
    return mattes


def _checked_kinds(kinds: Sequence[MatteKind]) -> tuple[MatteKind, ...]:
    asked = None if isinstance(kinds, str) else sequence(kinds)
    if not asked:
        raise value_error("cryptomatte", "kinds", f"one or more of {', '.join(MATTES)}", kinds)
    for kind in asked:
        choice("cryptomatte", "kinds", kind, MATTES)
    hashes(())  # before anything is drawn: raises without mmh3
    return tuple(asked)


def check_mattes(kinds: Sequence[MatteKind], files: Container[str]) -> None:
    """Raise InputError, before anything is drawn, for what `Frame.save` could not write with `frame.mattes` of these
    kinds."""
    _checked_kinds(kinds)
    if "exr" not in files:
        raise value_error("cryptomatte", "files", "exr among them, which holds it", files)
