"""What the files of a frame say of it besides its pixels: its error, its optical flow, and the record of how it was drawn,
which `clshade verify` reads, with a seal; and why it shows nothing."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ..base.arrays import Bools, Floats32, Reals
from ..base.atomic_files import write_bytes
from ..base.json_values import plain
from ..base.validation import path as checked_path
from ..base.validation import value_error
from ..base.version import VERSION
from ..images import exr, exr_limits
from ..scene.camera import MAX_RESOLUTION, PartCamera
from ..scene.description import digest_of, part_digests
from ..scene.geometry import in_image
from ..scene.ground import objects_of
from ..scene.model import Scene, Settings, default_tonemap
from ..scene.settings import Edges, Scalars
from .frame_files import SavingOptions
from .placements import mirroring
from .struct_layout import SUBPIXEL_BITS, kernels_digest


@dataclass(frozen=True, eq=False)
class Check:
    """The result of `clshade.check`.

    A bound is sqrt(max(n, 1)) * 2^-24 * kappa * B, or 1e-12 * kappa * B for float64: n is the specular exponent, B the most
    light that the point can send, kappa, a condition number, how far the geometry amplifies rounding errors.

    Ties are pixels with another owner at a depth within 2^-38 of the oracle's, where either is correct. With several samples
    also pixels of the same id, if any, whose color is off and one of whose samples has two nearest faces as close as that;
    these do not count in `bounds` either. Nor do gates, pixels whose error exceeds what is allowed by no more than a
    highlight, or a step of a color map, that may fall on either side of its threshold.
    """

    pixels: int  # checked
    of: int  # all
    bounds: float  # largest error of a color, in bounds
    allowed: float  # the largest one allowed, 32 for float32, 1 for float64, see `oracle_bounds.allowed`
    error: float  # largest |value - oracle| / B
    rms: float  # its root mean square, of the whole image only if all pixels were checked
    kappa: float  # of the pixel of `bounds`
    worst: tuple[int, int]  # row (from the top) and column of that pixel
    strata: dict[str, tuple[int, float]]  # pixels checked, and their largest error in bounds
    wrong: int  # pixels whose owner, instance or coverage differs from the oracle's, or whose values are not finite
    ties: int  # pixels
    gates: int  # pixels
    depth: float | None  # largest relative error of Z, in 2^-24, or in 2^-53 for float64; None without that layer
    depth_allowed: int  # the largest one allowed, 10, or 22 for float64
    ids: bool  # whether owners were compared; without the layer id only coverage is
    precision: str  # of the frame
    seconds: float  # that the check took
    # (M, N), error in bounds, infinity where a pixel is wrong, 0 for ties; None unless all pixels were checked
    image: Floats32 | None = field(repr=False)
    flow: float | None = (
        None  # largest error of the flows, in what is allowed; infinite for a wrong mask, None without any
    )

    @property
    def passed(self) -> bool:
        """Whether no checked pixel is wrong and all errors are within what is allowed."""
        depth_is_right = self.depth is None or self.depth <= self.depth_allowed
        flow_is_right = self.flow is None or self.flow <= 1.0
        return self.wrong == 0 and self.bounds <= self.allowed and depth_is_right and flow_is_right

    @property
    def complete(self) -> bool:
        """Whether every pixel was checked."""
        return self.pixels == self.of

    @property
    def unit(self) -> str:
        """The unit of a bound, without kappa and the light."""
        return "1e-12" if self.precision == "float64" else "sqrt(max(n,1)) * 2^-24"

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        what = "ids and coverage" if self.ids else "coverage (ids: no such layer)"
        owned = f"{what}: {self.wrong:,} wrong" + (f", {self.ties:,} ties" if self.ties else "")
        row, column = self.worst
        at = f"row {row}, column {column}" if self.bounds > 0.0 else "no pixel"
        gates = f", {self.gates:,} at a highlight's gate not counted" if self.gates else ""
        depth = [f"Z: {self.depth:.3g} of {self.depth_allowed} roundings"] if self.depth is not None else []
        depth += [f"flow: {self.flow:.3g} of what is allowed"] if self.flow is not None else []
        strata = ", ".join(f"{name} {worst:.2g} ({count:,})" for name, (count, worst) in self.strata.items() if count)
        return [
            f"{self.pixels:,} of {self.of:,} pixels computed again in float64, {self.seconds * 1e3:.0f} ms: "
            + ("within bounds" if self.passed else "FAILED"),
            f"largest error {self.bounds:.3g} of {self.allowed:g} bounds, {self.error:.2g} of the light, "
            f"kappa {self.kappa:.3g}, at {at}{gates}",
            f"by stratum {strata}",
            "; ".join([owned, *depth]),
            "every pixel was looked at" if self.complete else "a lower bound: pixels not looked at may be worse",
        ]

    def stats(self) -> dict[str, Any]:
        """Return the figures as JSON-compatible values."""
        figures = {name: value for name, value in vars(self).items() if name != "image"}
        if self.flow is None:
            del figures["flow"]
        figures["strata"] = {name: {"pixels": n, "bounds": worst} for name, (n, worst) in self.strata.items()}
        return {**figures, "passed": self.passed, "lower_bound": not self.complete}

    def metadata(self) -> dict[str, Any]:
        """Return header attributes for the EXR."""
        of_what = "largest error" if self.complete else "lower bound of the largest error"
        attributes = {
            "check": f"{of_what}: {self.pixels} of {self.of} pixels computed again in float64; "
            + f"{self.allowed:g} bounds allowed, a bound is {self.unit} * kappa of the light",
            "checkPixels": self.pixels,
            "checkErrorBounds": self.bounds,
            "checkErrorRelative": self.error,
            "checkKappa": self.kappa,
            "checkWrongPixels": self.wrong,
        }
        return attributes if self.depth is None else {**attributes, "checkDepthRoundings": self.depth}


FlowName: TypeAlias = Literal["flow", "flow_back"]  # to the next image, to the one before
FLOWS: tuple[FlowName, ...] = get_args(FlowName)

_TAG, _UNKNOWN = 202021.25, 1e10  # of .flo files, whose readers take values above 1e9 as unknown


@dataclass(frozen=True, eq=False)
class Flow:
    """Optical flow from a frame to another image, see `clshade.flow`.

    vectors: (M, N, 2), pixels to the right and down; NaN in the background, and where the point is not in front of the other
    camera's near plane. occluded: (M, N), True where the other image does not show the point: something hides it, it is
    outside of the image, or its side is culled; and where `vectors` is NaN. to: the scene of the other image, with its
    camera. settings: those of the other image: what it culls, its near plane, and what its layers look through.
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
        if not name.lower().endswith(".flo"):
            raise value_error("Flow.save", "path", "a file name ending in .flo", name)
        rows, columns = self.occluded.shape
        vectors = np.nan_to_num(self.vectors, nan=_UNKNOWN).astype("<f4")
        write_bytes(name, struct.pack("<fii", _TAG, columns, rows) + vectors.tobytes())


RECORD, SEAL = "clshade", "clshadeSeal"  # names of the header's attributes
STEPS = 1 << SUBPIXEL_BITS  # of snapped corners, per pixel
# Types of the options of `Frame.save` that a record holds, those of the PNG in its member `png`.
PNG = {"tonemap": str, "exposure": float, "colorbar": bool}
EXR = {"half": bool, "compression": str, "crop": bool}
# What the EXR's writer adds to the header is not sealed.
NOT_SEALED = {*exr.PROTECTED, *exr.WRITTEN, *exr_limits.OUTSIDE.values(), SEAL}


def record_of(
    scene: Scene, settings: Settings, saving: SavingOptions, *, device: str | None = None, command: str | None = None
) -> dict[str, Any]:
    """Return the record of an image as JSON-compatible values. scene, settings: as drawn; fields of the settings are those
    that differ from `Settings()`. saving: all options. The camera is None for a part of an image, and for one of more than
    16384 pixels a side."""
    is_part, usual = isinstance(scene.camera, PartCamera), vars(Settings())
    options: dict[str, Any] = {**saving, "tonemap": saving["tonemap"] or default_tonemap(scene)}
    png, storage = ({name: kind(options[name]) for name, kind in kinds.items()} for kinds in (PNG, EXR))
    record = {
        "version": VERSION,
        "scene": part_digests(scene),
        "name": scene.name,
        "camera": None if is_part or max(scene.camera.resolution) > MAX_RESOLUTION else _values(scene.camera),
        "settings": {name: plain_value(value) for name, value in vars(settings).items() if value != usual[name]},
        "storage": {"png": png, **storage},
        "kernels": kernels_digest(),
        "subpixels": STEPS,
        "device": device,
        "command": command,
    }
    return {name: value for name, value in record.items() if value is not None or name == "camera"}


def _values(instance: Any) -> dict[str, Any]:
    return {declared.name: plain(getattr(instance, declared.name)) for declared in fields(instance)}


def plain_value(value: Any) -> Any:
    """Return the value of a field of Settings as a record has it."""
    return _values(value) if isinstance(value, (Edges, Scalars)) else plain(value)


def sealed(metadata: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the header's attributes with the record, as JSON, and the seal: the SHA-256 of all of them."""
    text = json.dumps(record, ensure_ascii=False, separators=(",", ":"))
    header = {**{name: value for name, value in metadata.items() if value is not None}, RECORD: text}
    return {**header, SEAL: seal_of(header)}


def seal_of(header: Mapping[str, Any]) -> str:
    """Return the seal that belongs to a header, as it is written or as `exr.read` returns it."""
    return digest_of({name: _stored(value) for name, value in header.items() if name not in NOT_SEALED})


def _stored(value: Any) -> Any:
    """Return an attribute as an EXR stores it."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode("utf-8")
    if isinstance(value, (float, np.ndarray, np.floating)):
        with np.errstate(over="ignore"):
            return np.asarray(value, np.float32)
    return value if isinstance(value, (bool, int)) else str(value)


# Counters of a frame -> why a triangle that they count is not drawn.
_NOT_DRAWN = {
    "behind": "behind the camera",
    "off_screen": "beside the image",
    "back_facing": "seen from behind, which is not drawn",
    "between_samples": "smaller than a pixel and between its samples",
    "zero_area": "without area",
}
_BLOCK = 1 << 14  # triangles that are looked at together
_FLAT = 1e-9  # an area in the image, as a share of the squares of two sides, that is the rounding of none


def why_unseen(rgba: Reals, scene: Scene, settings: Settings, counts: Mapping[str, Any]) -> str:
    """Return a line if the scene has triangles and the image shows none of them, with the likely reason; else "". A ground
    does not count.

    rgba: (M, N, 4). counts: `Frame.stats`, which the frames of other programs may lack.
    """
    if not counts.get("triangles") or isinstance(scene.camera, PartCamera):
        return ""
    objects, is_empty = objects_of(scene), not (rgba[::16, ::16, 3].any() or rgba[..., 3].any())
    grounds = scene.face_count - objects.face_count
    if is_empty or (grounds and objects.face_count and counts["visible"] <= grounds and settings.edges is None):
        counts_of_objects = _object_counts(objects, settings) if grounds else counts
        if is_empty or not counts_of_objects["visible"] or _is_clear(objects):
            return f"nothing can be seen{'' if is_empty else ' but the ground'}: {_not_covered(objects, counts_of_objects)}"
    few, rgb = rgba[::16, ::16, :3], rgba[..., :3]  # a few pixels tell it of most images
    if not few.any() and not rgb.any():
        return f"the image is black: {_dark(scene, settings)}"
    background = scene.background if settings.background == "scene" else None
    if background is not None and all((some == np.float32(background)).all() for some in (few, rgb)):
        return "nothing can be seen: all that is drawn has the color of the background"
    return ""


@np.errstate(over="ignore", invalid="ignore")
def _object_counts(scene: Scene, settings: Settings) -> dict[str, int]:
    """Count triangles by why they cannot be seen, as `Frame.stats` does, up to the first block of which some may be."""
    counts = {"triangles": scene.face_count, "visible": 0, **dict.fromkeys(_NOT_DRAWN, 0)}
    placed = ((mesh, matrix) for mesh in scene.meshes for matrix in mesh.instances)
    for mesh, matrix, first in ((*pair, first) for pair in placed for first in range(0, len(pair[0].faces), _BLOCK)):
        corners = mesh.verts[mesh.faces[first : first + _BLOCK]].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        places, depths = in_image(scene.camera, corners.reshape(-1, 3) - scene.camera.eye)
        places = places.reshape(-1, 3, 2)
        one, other = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
        area = one[:, 1] * other[:, 0] - one[:, 0] * other[:, 1]  # positive where counter-clockwise
        beside: Any = (places < 0.0).all(axis=1) | (places > np.array(scene.camera.resolution)).all(axis=1)
        culls = settings.cull or mesh.material.sides == "front"
        left = np.ones(len(places), bool)
        for name, fault in {
            "behind": (depths.reshape(-1, 3) <= 0.0).all(axis=1),
            "off_screen": beside.any(axis=1),
            "zero_area": np.abs(area) <= _FLAT * (one * one + other * other).sum(axis=1),
            "back_facing": (area > 0.0 if mirroring(matrix[None])[0] else area < 0.0) & culls,
        }.items():
            counts[name] += int((left & fault).sum())
            left &= ~fault
        counts["visible"] += int(left.sum())
        if counts["visible"]:
            break
    return counts


def _is_clear(scene: Scene) -> bool:
    materials = [mesh.material for mesh in scene.meshes if len(mesh.faces)]
    return all(material.blend and material.opacity == 0.0 for material in materials)


def _not_covered(scene: Scene, counts: Mapping[str, Any]) -> str:
    if counts["visible"]:
        if _is_clear(scene):
            return "the opacity of all materials is 0"
        if any(mesh.blends or mesh.tests_alpha for mesh in scene.meshes):
            return "alpha is 0, or below its cutoff, wherever there is a face"
        return "no face covers a sample of a pixel"
    reason = max(_NOT_DRAWN, key=lambda name: counts[name])
    if counts[reason] == counts["triangles"]:
        return f"every triangle is {_NOT_DRAWN[reason]}"
    return f"{counts[reason]:,} of {counts['triangles']:,} triangles are {_NOT_DRAWN[reason]}"


def _dark(scene: Scene, settings: Settings) -> str:
    if settings.shader == "nolight":
        return "the colors and textures of all faces in view are black"
    if np.any(scene.ambient) or (settings.shader == "pbr" and scene.environment is not None):
        return "materials or colors of all faces in view are black"
    if any(light.intensity.any() for light in scene.lights):
        return "no light reaches the faces in view, and there is no ambient light"
    return "the scene has no light"
