"""Draw or compile the scenes of `bench --processors`, or time its workloads, and print the figures as JSON:
`python -m clshade.measure.bench.processors_apart draw|compile`, or `... time FRAMES`.

`bench --processors` runs it with the PoCL of another processor, in a process that this PoCL may take along.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import ClshadeError
from ...pipeline import programs, scene_buffers
from ...pipeline.effective_settings import effective_settings
from ...pipeline.features import at_lanes
from ...pipeline.launches import hierarchy_stages, scene_stages
from ...pipeline.layer_buffers import layer_features
from ...pipeline.opencl.device import Device, found_devices, open_untested, shared_device
from ...pipeline.renderer import Renderer
from ...scene.builtin.scenes import builtin
from ...scene.builtin.studio import studio
from ...scene.edges import Edges
from ...scene.lights import RectangleLight
from ...scene.metallic_roughness import MetallicRoughness
from ...scene.model import Material, Scene
from ...scene.settings import Layer
from ...scene.texture import Texture
from ..digest import digest
from . import bench
from .workloads import WORKLOADS

RESOLUTION = (161, 97)
TIMED = ("object-512", "lights-8")  # of WORKLOADS
PEER = "llvmpipe"
_LAYERS: tuple[Layer, ...] = ("Z", "id")
_COMMON: dict[str, Any] = {"resolution": RESOLUTION, "layers": _LAYERS}


def scenes() -> dict[str, tuple[Scene, dict[str, Any]]]:
    """Return scenes, by name, that need all kernels between them, each with the options of Renderer."""
    teapot, knot = builtin("teapot"), builtin("torus_knot", triangles=4000)
    shadows = {"shadows": True, "ambient_occlusion": 5, "light_samples": 4}
    lamp = RectangleLight((2.0, 6.0, 4.0), (1.0, 0.0, 0.0), (0.0, 0.6, -0.8), (9.0, 9.0, 9.0))
    height = tuple(replace(mesh, scalars={"height": mesh.verts[:, 1]}) for mesh in knot.meshes)
    lines = {"scalars": "height", "edges": Edges(("feature", "silhouette")), "samples": 4, "precision": "float64"}
    return {
        "phong": (teapot, {"texture_filter": "trilinear", "layers": (*_LAYERS, "N", "uv")}),
        "course": (teapot, {"preset": "course", "shader": "gouraud"}),
        "pbr": (_mapped(), {"preset": "pbr", "background": "environment", "shadows": False}),
        "shadows": (replace(teapot, lights=(*teapot.lights, lamp)), shadows),
        "blend": (_transparent(), {"shadows": True, "precision": "fast"}),
        "lines": (replace(knot, meshes=height), lines),
    }


def _mapped() -> Scene:
    """Return the course's object with all maps of shader pbr, in a studio."""
    scene = builtin("course", level=3)
    values = np.random.default_rng(1).uniform(0.0, 1.0, (4, 7, 5, 3)).astype(np.float32)
    normal, occlusion, emission, roughness = values
    normal[..., 2] = 1.0
    maps = MetallicRoughness(
        0.6,
        0.5,
        emission=0.3,
        normal_texture=Texture(normal),
        occlusion_texture=Texture(occlusion, wrap="clamp"),
        emission_texture=Texture(emission, wrap="mirror"),
        metallic_roughness_texture=Texture(roughness, filter="nearest"),
    )
    meshes = tuple(replace(mesh, material=Material(pbr=maps)) for mesh in scene.meshes)
    return replace(scene, meshes=meshes, environment=studio())


def _transparent() -> Scene:
    """Return quads one behind the other through which light passes, each of its own opacity at each corner."""
    scene = builtin("quads", count=7)
    (mesh,) = scene.meshes
    alphas = np.random.default_rng(2).uniform(0.2, 0.9, len(mesh.verts))
    return replace(scene, meshes=(replace(mesh, alphas=alphas, material=replace(mesh.material, blend=True)),))


def draw() -> dict[str, Any]:
    """Draw each scene once on the device that CLSHADE_DEVICE names; return what `_facts` does, seconds to the first
    frame, and a digest of each image with its layers."""
    start, first, images = time.perf_counter(), 0.0, {}
    for name, (scene, options) in scenes().items():
        with Renderer(scene, **{**_COMMON, **options}) as renderer:
            images[name] = digest(renderer.render())
        first = first or time.perf_counter() - start
    return {**_facts(shared_device(profiling=True)), "first_s": first, "images": images}


def _facts(device: Device) -> dict[str, Any]:
    """Return the device's version, which ends with the target's name, its lanes, and the compilers' warnings."""
    warned = [line for program in programs.built() for line in program.warnings]
    return {"version": device.version, "lanes": device.lanes, "warnings": warned}


def compile_alone() -> dict[str, Any]:
    """Compile all kernels of each scene's programs without launching any; return what `_facts` does."""
    info = next(info for info, _ in found_devices("pocl"))
    device = open_untested(info.index, info.name)
    for scene, options in scenes().values():
        chosen, settings = effective_settings(scene, **{**_COMMON, **options})
        packed = scene_buffers.pack(chosen, settings)
        features = at_lanes(packed.features, device.lanes, None)
        scene_stages(device, features, None, layer_features(features, packed.layers.asked))
    hierarchy_stages(device)
    for program in programs.built():
        kernel = next(iter(program.kernels.values()))
        assert kernel.program.binaries  # asked for its binary, PoCL compiles every kernel
    return _facts(device)


def timings(frames: int) -> dict[str, Any]:
    """Return ms a frame of each of TIMED, and how many times as fast as PEER that is, None where it cannot be had."""
    device = shared_device(profiling=True)
    found = {}
    for workload in (each for each in WORKLOADS if each.name in TIMED):
        result = bench.measure(workload, device, (PEER,), frames)
        if result.drawn is None:
            raise ClshadeError(result.failed)
        found[workload.name] = (result.drawn.ms, next((each.ratio for each in result.compared), None))
    return found


def main(arguments: Sequence[str]) -> int:
    what, *rest = arguments
    try:
        found = draw() if what == "draw" else compile_alone() if what == "compile" else timings(int(rest[0]))
        print(json.dumps(found))
    except ClshadeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
