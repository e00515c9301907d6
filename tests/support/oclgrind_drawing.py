"""Draw small images on Oclgrind, in the form named by the argument; test_oclgrind.py runs this in a child process.

`groups`: as on a GPU, a work-item per pixel. `vectors`: as on a CPU, four lanes and several tiles per work-item.
`planted`: kernels with one error each. Prints a line of JSON: the kernels that ran, and the largest color error.
"""

import json
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import oracle_asserts
import pyopencl as cl
from caster_meshes import face_points, joined, lattice, moved, sphere
from exact_shadows import DARK, LIT, ExactShadows
from oracle_asserts import assert_layers

from clshade import course, oracle
from clshade.measure.stability.cases import lit
from clshade.pipeline import buffers, launches, programs, triangle_source
from clshade.pipeline import draw as stages
from clshade.pipeline.hierarchy import Hierarchy
from clshade.pipeline.opencl.device import Device, open_device
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Scene, Texture
from clshade.scene.settings import Edges

# Rewrites of correct OpenCL C that Oclgrind 21.10 reports wrongly; each text must occur in the sources.


def rewritten(text: str) -> str:
    for original, instead in _ALL:
        if original in text:
            text = text.replace(original, instead)
            _said.add(original)
    return text


# Oclgrind evaluates a vector's `mask ? a : b` as `(a & mask) | (b & ~mask)`, which reads b even if the mask is all
# ones. If only an uninitialized b is initialized, the reports vanish and the image is the same.
_UNCHOSEN = (("    Surface s;\n", "    Surface s = {{(reals)(0.0f)}};\n"),)
# OpenCL 1.2 has no atomic load, so a word in which other work-items set bits is read by an ordinary one, which Oclgrind
# reports as a data race. An older value gives the same image: the kernel finds again what it does not know.
_LOADED = (("uint known = own[from / 32];", "uint known = atomic_or(own + from / 32, 0u);"),)
# It takes the ends of the halves of the vector in column_bits for uninitialized, of a mask whose 16 elements it takes for
# initialized one by one. Without these vectors the reports vanish, and what is uninitialized in a mask is reported still.
_HALVED = (
    (
        "    return BITS_OF_16(mask);\n",
        "    return (uint)({});\n".format(" | ".join(f"(mask.s{k:x} & {1 << k})" for k in range(16))),
    ),
)
_ALL = _UNCHOSEN + _LOADED + _HALVED
# If a buffer reuses the memory of an earlier, smaller one, Oclgrind takes its end for uninitialized though a kernel
# wrote it. Buffers are kept alive, so that none reuses another's memory.
_kept: list[Any] = []
_said: set[str] = set()
_flatten, _run = programs.flatten, launches.Stages.run
ran: dict[str, int] = {}


def launched(self: Any, name: str, *arguments: Any, **values: Any) -> Any:
    ran[name] = ran.get(name, 0) + 1
    return _run(self, name, *arguments, **values)


def empty(cls: type, device: Device, shape: Any, dtype: Any) -> Any:
    """Allocate uninitialized device memory, so that reads before the first write are reported."""
    made = cls.__new__(cls)
    made._device, made._queue, made.is_shared = device, device.queue, False
    made.array = np.zeros(shape, dtype)
    made.memory = cl.Buffer(device.context, cl.mem_flags.READ_WRITE, max(made.array.nbytes, 64))
    return made


def prepare() -> None:
    programs.flatten = lambda names: rewritten(_flatten(names))  # type: ignore[assignment]
    launches.Stages.run = launched  # type: ignore[method-assign]
    buffer = cl.Buffer

    def kept(*arguments: Any, **options: Any) -> Any:
        _kept.append(buffer(*arguments, **options))
        return _kept[-1]

    cl.Buffer = kept  # type: ignore[assignment, misc]
    # Oclgrind takes host memory that a buffer uses in place for uninitialized, so arrays are copied.
    buffers._coherent = lambda *_: False  # type: ignore[assignment]
    buffers.Buffer.empty = classmethod(empty)  # type: ignore[assignment, method-assign]
    # With the default sizes, so few triangles would fit in one chunk.
    stages._LEAST_CHUNK, stages._SCAN_RUN = 8, 2
    triangle_source.LEAST_COPIES, triangle_source._BLOCK, triangle_source._BLOCK_OF_GPU = 1, 40, 40


def scenes(form: str) -> list[tuple[Scene, dict[str, Any]]]:
    """Return small scenes that run all kernels; with vectors also all branches that a feature enables."""
    camera = Camera((0.3, 0.2, 3.0), (0.05, 0, 0), (0, 1, 0), 1.3, (1.0, 1.3), (19, 14))
    rng = np.random.default_rng(4)
    image = rng.uniform(0, 1, (3, 5, 4)).astype(np.float32)
    corners = rng.uniform(-0.5, 2.0, (36, 2))
    cut = Material(texture=Texture(image, ("mirror", "clamp")), alpha_cutoff=0.4, two_sided=True, sides="front")
    replaced = Material(texture=Texture(image[..., :3], lookup="course"), n=1.0)
    front = lit.blob(12, 3, uvs=corners, material=cut)
    behind = lit.blob(10, 5)
    around = replace(lit.blob(6, 7), verts=lit.blob(6, 7).verts + [0, 0, 2.8])  # crosses the near plane
    both = lit.scene_of(front, behind, around, camera=camera)
    plain = lit.scene_of(behind, around, camera=camera, background=None)
    textured = lit.scene_of(lit.blob(12, 3, uvs=corners, material=replaced), around, camera=camera)
    matt = Material(ka=0.5, kd=0.0, ks=0.0)
    unlit = lit.scene_of(
        lit.blob(12, 3, material=matt, normals=np.eye(3), normal_faces=np.zeros((12, 3), int)), camera=camera
    )
    places = np.tile(np.eye(4), (3, 1, 1))
    places[1:, :3, 3] = (0.4, 0.2, -0.5), (9.0, 0.0, -0.5)  # the last is beside the image
    places[1, 0, 0] = -0.7
    many = replace(both, meshes=(replace(front, instances=places), behind, replace(around, instances=places[:2])))
    flat = replace(camera, orthographic=True, plane=(3.0, 4.0), principal=(0.4, 0.55))
    each_kernel = [
        (both, {"shader": "phong"}),
        (both, {"shader": "gouraud"}),
        (both, {"shader": "nolight", "texture_filter": "trilinear"}),
        (textured, {"shader": "phong", "preset": "course"}),
        (replace(both, camera=flat), {"shader": "phong", "visibility": "painter"}),
        (both, {"shader": "pbr"}),
        (lit.scene_of(camera=camera, meshes=()), {"shader": "phong"}),
        (many, {"shader": "phong"}),
        (both, {"shader": "phong", "edges": Edges("all", width=2.5)}),
        (replace(plain, camera=flat), {"shader": "gouraud", "edges": Edges("all"), "samples": 4}),
        (
            replace(both, lights=(replace(both.lights[0], radius=0.2),)),
            {"shader": "phong", "shadows": True, "light_samples": 2},
        ),
    ]
    if form == "groups":  # these take twice as long
        return each_kernel
    return [
        *each_kernel,
        (textured, {"shader": "gouraud", "preset": "course"}),
        (unlit, {"shader": "gouraud"}),
        (unlit, {"shader": "phong"}),
        (plain, {"shader": "nolight", "interpolation": "affine", "cull": True}),
        (many, {"shader": "gouraud", "visibility": "painter"}),
    ]


def draw(form: str) -> float:
    device = open_device("oclgrind")
    assert device.platform == "Oclgrind", device
    # Oclgrind 21.10 aborts at a vector of 16 composed of four of 4.
    device = replace(device, lanes=4) if form == "vectors" else replace(device, is_cpu=False, setup_run=1, lanes=1)
    worst = 0.0
    for scene, options in scenes(form):
        with Renderer(scene, device=device, layers="all", **options) as renderer:
            for _ in range(2 if scene.background is None else 1):  # the second frame reuses all memory
                frame = renderer.render()
            expected = oracle.render(frame.scene, frame.settings)
            worst = max(worst, oracle_asserts.assert_frame(frame, expected, frame.scene, frame.settings).bounds)
            ties = oracle_asserts.assert_same_ids(frame, expected, frame.scene, frame.settings)
            layers = oracle.render_layers(frame.scene, frame.settings)
            assert_layers(frame, layers, frame.scene, frame.settings, skip=ties)
    mesh = joined(lattice(12), moved(sphere(), np.array([0.1, 0.2, 1.5]), 0.4))
    (points, faces), light = face_points(mesh, 40), np.array([0.2, 0.4, 9.0, 1.0])
    hierarchy = Hierarchy(device, *mesh)
    dark, expected = hierarchy.shadowed(points, faces, light), ExactShadows(*mesh).of(points, faces, light)
    assert not dark[expected == LIT].any()
    assert dark[expected == DARK].all()
    assert 5 < dark.sum() < 35
    course.shared_device = lambda: device  # type: ignore[assignment]
    up, eye = np.array([0.0, 0, 1]), np.array([0.0, 0, 5])
    lights = np.array([[1.0, 2, 3], [3.0, 1, 1]])
    assert np.isfinite(course.light(up, up, up, eye, 0.1, 0.5, 0.5, 20, lights, np.ones((2, 3)))).all()
    assert np.isfinite(course.bilerp(np.array([0.3, 0.6]), np.ones((3, 4, 3)))).all()
    assert len(_said) == len(_ALL), _said
    return worst


PLANTED = """
kernel void beyond(global const int *in, global int *out) { out[0] = in[get_global_size(0)]; }
kernel void raced(global const int *in, global int *out) { out[0] += in[get_global_id(0)]; }
kernel void unset(global const int *in, global int *out)
{
    int x;
    if (in[0] > 1000) x = 1;
    if (x) out[0] = 2;
}
"""


def plant() -> None:
    device = open_device("oclgrind")
    program = cl.Program(device.context, PLANTED).build()
    values, target = np.arange(8, dtype=np.int32), np.zeros(8, np.int32)
    flags = cl.mem_flags
    source = cl.Buffer(device.context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=values)
    out = cl.Buffer(device.context, flags.READ_WRITE | flags.COPY_HOST_PTR, hostbuf=target)
    kernels = {kernel.function_name: kernel for kernel in program.all_kernels()}
    for name, size in (("beyond", 8), ("raced", 8), ("unset", 1)):
        kernels[name](device.queue, (size,), (1,), source, out)
    device.queue.finish()


if __name__ == "__main__":
    if sys.argv[1] == "planted":
        plant()
        print("null")
    else:
        prepare()
        error = draw(sys.argv[1])
        print(json.dumps({"ran": ran, "error": error}))
