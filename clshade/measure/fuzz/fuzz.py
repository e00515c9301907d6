"""`python -m clshade fuzz`: random scenes against the float64 oracle, mutated files against the loaders."""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ... import oracle
from ...base.arrays import Bools
from ...oracle import OracleFrame
from ...oracle.corners import usable_uvs
from ...pipeline.features import OPTIONAL
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.model import Mesh, Scene, Settings
from ..check import oracle_bounds
from ..check.layer_bounds import assert_layers
from . import file_mutations
from .random_scenes import RandomScene, scene_of

ALPHA_MARGIN = 1e-5  # alpha this close to the cutoff may pass or fail in float32 (see `decided_by_alpha`)
TEXEL_ERROR = 2.0**-42  # of a position in texels, relative to the largest coordinate times the texture's size
SHRINKING = 20.0  # seconds spent on shrinking a failing scene


@dataclass(frozen=True)
class Failure:
    """Failure of scene or file `number`. shrunk: description of the smallest part of the scene that still fails."""

    what: str
    number: int
    reason: str
    shrunk: str = ""

    def __str__(self) -> str:
        return f"{self.what} {self.number}: {self.reason}" + (f" [{self.shrunk}]" if self.shrunk else "")


@dataclass
class Tally:
    """Counts of what was compared.

    covered: covered pixels. gates, ties, alphas: pixels excepted, each with proof: at a highlight's gate, at a depth
    tie, decided by an alpha at its cutoff. again: scenes also drawn with another number of lanes.
    """

    scenes: int = 0
    pixels: int = 0
    covered: int = 0
    gates: int = 0
    ties: int = 0
    alphas: int = 0
    again: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    def __str__(self) -> str:
        def share(count: int) -> str:
            return f"{count} ({count / max(self.covered, 1) * 1e6:.1f} per million)"

        return (
            f"{self.pixels:,} pixels, {self.covered:,} covered; excepted: {share(self.gates)} at a gate, "
            f"{share(self.ties)} tied, {share(self.alphas)} at an alpha cutoff; {self.again:,} scenes drawn by two "
            "numbers of lanes"
        )


def draw(device: Device, drawn: RandomScene, lanes: int | None = None) -> Frame:
    """Render a random scene with all layers; in float32 and without edges if the device has no float64. Arithmetic
    warnings are errors.

    lanes: None: the kind's.
    """
    kind, settings = drawn.kind, drawn.settings
    lanes = (lanes or kind.lanes) if device.is_cpu else None
    if not device.has_fp64:
        settings = replace(settings, precision="float32", edges=None)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        with Renderer(
            drawn.scene, device=device, settings=settings, forced=() if kind.specialize else OPTIONAL, lanes=lanes
        ) as renderer:
            return renderer.render()


def decided_by_alpha(scene: Scene, settings: Settings) -> Bools:
    """Return the pixels, (M, N) bool, with a sample whose owner depends on an alpha that float32 may put on the other
    side of the cutoff.

    Alpha is a mean of at most four texels with weights that double-single gives to 2^-22, and is rounded to float32:
    in total some 2^-21 of the largest alpha, 1. The margin is ten times that. Large texture coordinates add the error
    of a position in texels along both axes (kernels/texture.clh), times the step of alpha between texels, at most 1. With
    filter `nearest` alpha jumps where a position may be on either side of a texel's edge: 2^-24 of a texel is added, see
    `corners.uv_slack`.
    """

    def moved(sign: float, across: float = 0.0, down: float = 0.0) -> OracleFrame:
        meshes = []
        for mesh in scene.meshes:
            cutoff, texture, material = mesh.material.alpha_cutoff, mesh.material.texture, mesh.material
            if cutoff is not None and mesh.tests_alpha:
                reach = 0.0
                if texture is not None and mesh.uvs is not None:
                    reach = float(np.abs(usable_uvs(mesh.uvs)).max(initial=0.0)) * max(texture.image.shape[:2])
                margin = ALPHA_MARGIN + 2.0 * TEXEL_ERROR * reach
                material = replace(material, alpha_cutoff=float(np.clip(cutoff + sign * margin, 0.0, 2.0)))
            if texture is not None and mesh.uvs is not None and _alpha_jumps(mesh):
                most = np.abs(usable_uvs(mesh.uvs)).max(initial=1.0)
                off = 2.0 * TEXEL_ERROR * most + 2.0**-24 / np.array(texture.image.shape[1::-1])
                mesh = replace(mesh, uvs=mesh.uvs.astype(np.float64) + off * [across, down])
            meshes.append(replace(mesh, material=material))
        return oracle.render(replace(scene, meshes=tuple(meshes)), settings)

    less, others = moved(-1.0), [moved(1.0)]
    if any(map(_alpha_jumps, scene.meshes)):
        others += [moved(*way) for way in itertools.product((-1.0, 1.0), repeat=3)]
    different: Bools = np.zeros(less.id.shape, bool)
    for other in others:
        different |= (less.id != other.id) | (less.alpha != other.alpha) | (less.rgb != other.rgb).any(axis=-1)
    return different


def _alpha_jumps(mesh: Mesh) -> bool:
    """Return whether alpha jumps between the texels of a texture, and is tested or composited."""
    texture = mesh.material.texture
    return texture is not None and texture.filter == "nearest" and (mesh.tests_alpha or mesh.material.blend)


def problem(frame: Frame, expected: OracleFrame | None = None, tally: Tally | None = None) -> str:
    """Return what is wrong with a frame, "" if nothing.

    Ids and coverage must be exact except for proven ties, depths within their roundings, colors and further layers
    within their bounds, and all of them finite. Pixels that an alpha near a cutoff or a texel's edge decides are left out
    if the whole image differs. tally: counts what was compared.
    """
    scene, settings = frame.scene, frame.settings
    skip: Bools | None = None
    with np.errstate(all="ignore"):
        expected = oracle.render(scene, settings) if expected is None else expected
        layers = oracle.render_layers(scene, settings)

        def compare() -> oracle_bounds.Agreement:
            # In an image of a few pixels all may lie at a gate.
            found = oracle_bounds.assert_frame(frame, expected, scene, settings, gate_fraction=1.0, skip=skip)
            ties = oracle_bounds.assert_same_ids(frame, expected, scene, settings, skip=skip)
            assert_layers(frame, layers, scene, settings, skip=ties)
            return found

        try:
            try:
                found = compare()
            except AssertionError:
                if all(mesh.material.alpha_cutoff is None and not _alpha_jumps(mesh) for mesh in scene.meshes):
                    raise
                skip = decided_by_alpha(scene, settings)
                found = compare()
        except AssertionError as error:
            return " ".join(str(error).split())
    if tally is not None:
        alphas = 0 if skip is None else int(skip.sum())
        tally.pixels += frame.alpha.size
        tally.covered += int((frame.alpha > 0.0).sum())
        tally.gates += int(found.gates.sum())
        tally.ties += int(found.ties.sum()) - alphas
        tally.alphas += alphas
    return ""


def scene_problem(device: Device, drawn: RandomScene, tally: Tally | None = None) -> str:
    """Render a scene and return what is wrong with the frame, or why rendering failed; "" if nothing."""
    try:
        frame = draw(device, drawn)
        if drawn.again and device.is_cpu:
            other = draw(device, drawn, drawn.kind.other_lanes)
            if tally is not None:
                tally.again += 1
            if reason := different_bits(frame, other):
                return f"with {drawn.kind.other_lanes} lanes: {reason}"
    except Exception as error:  # the scene is valid: any exception is a finding
        return f"{type(error).__name__}: {' '.join(str(error).split())}"
    return problem(frame, tally=tally)


def different_bits(one: Frame, other: Frame) -> str:
    """Return a description of where the bits of two frames differ; "" if nowhere."""
    for name, a, b in (("rgba", one.rgba, other.rgba), *((k, one[k], other[k]) for k in one.layers)):
        if a.tobytes() != b.tobytes():
            pixels = [np.ascontiguousarray(x).reshape(*one.alpha.shape, -1).view(np.uint8) for x in (a, b)]
            row, column = np.argwhere((pixels[0] != pixels[1]).any(axis=-1))[0].tolist()
            values = f"{a[row, column].tolist()} and {b[row, column].tolist()}"
            return f"{name} has other bits, first at row, column {(row, column)}: {values}"
    return ""


def shrink(drawn: Any, failing: Callable[[Any], bool], seconds: float = SHRINKING) -> str:
    """Return a description of the smallest part of a failing scene that still fails.

    drawn: a RandomScene, or another dataclass with a scene. The first mesh stays: it keeps the program the same.
    """
    end = time.perf_counter() + seconds

    def attempt(scene: Scene) -> bool:
        nonlocal drawn
        if time.perf_counter() > end or not failing(replace(drawn, scene=scene)):
            return False
        drawn = replace(drawn, scene=scene)
        return True

    for kind in ("meshes", "lights"):
        for k in reversed(range(1, len(getattr(drawn.scene, kind)))):
            items = getattr(drawn.scene, kind)
            fewer: dict[str, Any] = {kind: (*items[:k], *items[k + 1 :])}
            attempt(replace(drawn.scene, **fewer))
    for k in range(1, len(drawn.scene.meshes)):
        step = len(drawn.scene.meshes[k].faces) // 2
        while step:
            start = 0
            while start < len(drawn.scene.meshes[k].faces) > 1:
                if not attempt(_without(drawn.scene, k, slice(start, start + step))):
                    start += step
            step //= 2
    faces = [len(mesh.faces) for mesh in drawn.scene.meshes]
    return f"so do meshes of {faces} faces with {len(drawn.scene.lights)} lights"


def _without(scene: Scene, k: int, faces: slice) -> Scene:
    """Return the scene without these faces of mesh k."""
    mesh, meshes = scene.meshes[k], list(scene.meshes)
    names = ("faces", "normal_faces", "uv_faces", "tangent_faces")
    kept: dict[str, Any] = {
        n: np.delete(getattr(mesh, n), faces, axis=0) for n in names if getattr(mesh, n) is not None
    }
    meshes[k] = replace(mesh, **kept)
    return replace(scene, meshes=tuple(meshes))


def scene_failures(device: Device, numbers: Iterable[int], seed: int = 0, tally: Tally | None = None) -> list[Failure]:
    """Return the failures among random scenes."""
    found = []
    for number in numbers:
        drawn = scene_of(number, seed)
        reason = scene_problem(device, drawn, tally)
        if tally is not None:
            tally.scenes += 1
        if reason:
            shrunk = shrink(drawn, lambda smaller: bool(scene_problem(device, smaller)))
            found.append(Failure("scene", number, reason, shrunk))
    return found


def file_failures(numbers: Iterable[int], seed: int = 0) -> list[Failure]:
    """Return the failures among mutated files."""
    reasons = ((number, file_mutations.problem(number, seed)) for number in numbers)
    return [Failure("file", number, reason) for number, reason in reasons if reason]
