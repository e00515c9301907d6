"""Random scenes against the float64 oracle: drawing, judging, and shrinking and saving what fails."""

import itertools
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from devices import rendered
from random_scenes import RandomScene, scene_of

from clshade import oracle
from clshade.base.arrays import Bools
from clshade.measure.check import check
from clshade.oracle import OracleFrame
from clshade.oracle.corners import usable_uvs
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame
from clshade.pipeline.opencl.device import Device
from clshade.scene.model import Mesh, Scene, Settings

ALPHA_MARGIN = 1e-5  # alpha this close to the cutoff may pass or fail in float32 (see `decided_by_alpha`)
TEXEL_ERROR = 2.0**-42  # of a position in texels, relative to the largest coordinate times the texture's size
SHRINKING = 20.0  # seconds spent on shrinking a failing scene


def scene_failures(device: Device, numbers: Iterable[int], seed: int = 0) -> list[str]:
    """Return what is wrong with random scenes, each with the file of the smallest part of it that fails too, and with the
    command that repeats it."""
    failures = []
    for number in numbers:
        drawn = scene_of(number, seed)
        reason = scene_problem(device, drawn)
        if reason:
            smallest = shrink(drawn, lambda smaller: bool(scene_problem(device, smaller)))
            path = Path(tempfile.mkdtemp(prefix="clshade-fuzz-")) / f"scene_{seed}_{number}.json"
            smallest.scene.to_json(path)
            command = f"python tests/fuzz/run.py --scenes {number}:{number + 1} --seed {seed} --device {device.index}"
            failures.append(f"scene {number} of seed {seed}: {reason}\n{about(smallest)}\n{path}\nagain: {command}")
    return failures


def about(drawn: RandomScene) -> str:
    """Return what a row of test_saved_scenes.py needs to know of a scene."""
    faces, standard = [len(mesh.faces) for mesh in drawn.scene.meshes], Settings.from_preset("standard")
    changes = {name: value for name, value in vars(drawn.settings).items() if value != getattr(standard, name)}
    forced = "no feature" if drawn.kind.specialize else "OPTIONAL"
    return f"so do meshes of {faces} faces with {len(drawn.scene.lights)} lights, {forced} forced, {changes}"


def scene_problem(device: Device, drawn: RandomScene) -> str:
    """Render a scene and return what is wrong with the frame, or why rendering failed; "" if nothing."""
    try:
        frame = draw(device, drawn)
        if drawn.again and device.is_cpu:
            reason = different_bits(frame, draw(device, drawn, drawn.kind.other_lanes))
            if reason:
                return f"with {drawn.kind.other_lanes} lanes: {reason}"
    except Exception as error:  # the scene is valid: any exception is a finding
        return f"{type(error).__name__}: {' '.join(str(error).split())}"
    return problem(frame)


def draw(device: Device, drawn: RandomScene, lanes: int | None = None) -> Frame:
    """Render a random scene with all layers; in float32 and without edges if the device has no float64. Arithmetic
    warnings are errors. lanes: None: the kind's."""
    kind, settings = drawn.kind, drawn.settings
    if not device.has_fp64:
        settings = replace(settings, precision="float32", edges=None)
    options: dict[str, Any] = {"settings": settings, "forced": () if kind.specialize else OPTIONAL}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        return rendered(drawn.scene, device=device, lanes=(lanes or kind.lanes) if device.is_cpu else None, **options)


def different_bits(one: Frame, second: Frame) -> str:
    for name, a, b in (("rgba", one.rgba, second.rgba), *((k, one[k], second[k]) for k in one.layers)):
        if a.tobytes() != b.tobytes():
            pixels = [np.ascontiguousarray(x).reshape(*one.alpha.shape, -1).view(np.uint8) for x in (a, b)]
            row, column = np.argwhere((pixels[0] != pixels[1]).any(axis=-1))[0].tolist()
            values = f"{a[row, column].tolist()} and {b[row, column].tolist()}"
            return f"{name} has other bits, first at row, column {(row, column)}: {values}"
    return ""


def problem(frame: Frame) -> str:
    """Return what is wrong with a frame, "" if nothing. Pixels that an alpha near a cutoff or a texel's edge decides
    are left out if there is a problem."""
    reason = check.problem(frame)
    if reason and any(mesh.material.alpha_cutoff is not None or _alpha_jumps(mesh) for mesh in frame.scene.meshes):
        return check.problem(frame, decided_by_alpha(frame.scene, frame.settings))
    return reason


def decided_by_alpha(scene: Scene, settings: Settings) -> Bools:
    """Return the pixels, (M, N) bool, with a sample whose owner depends on an alpha that float32 may put on the other
    side of the cutoff.

    Alpha is a mean of at most four texels with weights that double-single gives to 2^-22, and is rounded to float32:
    in total some 2^-21 of the largest alpha, 1. The margin is ten times that. Large texture coordinates add the error
    of a position in texels along both axes (kernels/texture.clh), times the step of alpha between texels, at most 1. With
    filter `nearest` alpha jumps where a position may be on either side of a texel's edge: 2^-24 of a texel is added, see
    `texture.uv_slack`.
    """

    def moved(sign: float, across: float = 0.0, down: float = 0.0) -> OracleFrame:
        meshes = []
        for mesh in scene.meshes:
            cutoff, texture, material = mesh.material.alpha_cutoff, mesh.material.texture, mesh.material
            looked_up = texture is not None and mesh.uvs is not None
            reach = np.abs(usable_uvs(mesh.uvs)).max(initial=0.0) if looked_up else 0.0
            size = np.array(texture.image.shape[1::-1]) if looked_up else np.ones(2)
            if cutoff is not None and mesh.tests_alpha:
                margin = ALPHA_MARGIN + 2.0 * TEXEL_ERROR * float(reach * size.max())
                material = replace(material, alpha_cutoff=float(np.clip(cutoff + sign * margin, 0.0, 2.0)))
            if looked_up and _alpha_jumps(mesh):
                off = 2.0 * TEXEL_ERROR * max(reach, 1.0) + 2.0**-24 / size
                mesh = replace(mesh, uvs=mesh.uvs.astype(np.float64) + off * [across, down])
            meshes.append(replace(mesh, material=material))
        return oracle.render(replace(scene, meshes=tuple(meshes)), settings)

    with np.errstate(all="ignore"):
        less, variants = moved(-1.0), [moved(1.0)]
        if any(map(_alpha_jumps, scene.meshes)):
            variants += [moved(*way) for way in itertools.product((-1.0, 1.0), repeat=3)]
    different: Bools = np.zeros(less.id.shape, bool)
    for variant in variants:
        different |= (less.id != variant.id) | (less.alpha != variant.alpha) | (less.rgb != variant.rgb).any(axis=-1)
    return different


def _alpha_jumps(mesh: Mesh) -> bool:
    texture = mesh.material.texture
    return texture is not None and texture.filter == "nearest" and (mesh.tests_alpha or mesh.material.blend)


def shrink(drawn: RandomScene, failing: Callable[[RandomScene], bool]) -> RandomScene:
    """Return the smallest part of a failing scene that still fails. The first mesh stays: it keeps the program the same."""
    end = time.perf_counter() + SHRINKING

    def attempt(**changed: Any) -> bool:
        nonlocal drawn
        smaller = replace(drawn, scene=replace(drawn.scene, **changed))
        if time.perf_counter() > end or not failing(smaller):
            return False
        drawn = smaller
        return True

    for kind in ("meshes", "lights"):
        for k in reversed(range(1, len(getattr(drawn.scene, kind)))):
            items = getattr(drawn.scene, kind)
            attempt(**{kind: (*items[:k], *items[k + 1 :])})
    for k in range(1, len(drawn.scene.meshes)):
        step = len(drawn.scene.meshes[k].faces) // 2
        while step:
            start = 0
            while start < len(drawn.scene.meshes[k].faces) > 1:
                if not attempt(meshes=without(drawn.scene.meshes, k, slice(start, start + step))):
                    start += step
            step //= 2
    return drawn


def without(meshes: tuple[Mesh, ...], k: int, faces: slice) -> tuple[Mesh, ...]:
    names = ("faces", "normal_faces", "uv_faces", "tangent_faces")
    indices = {name: getattr(meshes[k], name) for name in names if getattr(meshes[k], name) is not None}
    kept: Any = {name: np.delete(index, faces, axis=0) for name, index in indices.items()}
    return (*meshes[:k], replace(meshes[k], **kept), *meshes[k + 1 :])
