"""The result of `flow`, as frames hold it and write it."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from ..base.arrays import Array, Bools, Floats32
from ..base.atomic_files import write_bytes
from ..base.validation import choice, value_error
from ..base.validation import path as checked_path
from ..scene.model import Scene, Settings

FlowName: TypeAlias = Literal["flow", "flow_back"]  # to the next image, to the one before
FLOWS: tuple[FlowName, ...] = get_args(FlowName)

_TAG, _UNKNOWN = 202021.25, 1e10  # of .flo files, whose readers take values above 1e9 as unknown


@dataclass(frozen=True, eq=False)
class Flow:
    """Optical flow from a frame to another image, see `clshade.flow`.

    Attributes
    ----------
    vectors : ndarray of float32, (M, N, 2)
        Pixels to the right and down; NaN in the background, and where the point is not in front of the
        other camera's near plane.
    occluded : ndarray of bool, (M, N)
        True where the other image does not show the point: something hides it, it is outside of the
        image, or its side is culled; and where `vectors` is NaN.
    to : Scene
        The scene of the other image, with its camera.
    settings : Settings
        Settings of the other image: what it culls, its near plane, and what its layers look through.
    """

    vectors: Floats32
    occluded: Bools
    to: Scene
    settings: Settings

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the vectors as a .flo file, the format of Middlebury's optical flow benchmark.

        Vectors that are NaN become 1e10, which its readers take as unknown.

        Parameters
        ----------
        path : str or path-like
            File name ending in .flo.
        """
        name = checked_path("Flow.save", "path", path)
        if not os.fspath(name).lower().endswith(".flo"):
            raise value_error("Flow.save", "path", "a file name ending in .flo", os.fspath(name))
        rows, columns = self.occluded.shape
        known = np.nan_to_num(self.vectors, nan=_UNKNOWN).astype("<f4")
        write_bytes(name, struct.pack("<fii", _TAG, columns, rows) + known.tobytes())


def flow_channels(flows: Mapping[FlowName, Flow]) -> dict[str, Array]:
    """Return flows and their masks, 1 where occluded, as layers by name. Raises InputError for other names."""
    found: dict[str, Array] = {}
    for name, flow in flows.items():
        choice("Frame", "flows", name, FLOWS)
        found |= {name: flow.vectors, f"{name}_occluded": flow.occluded.astype(np.uint32)}
    return found
