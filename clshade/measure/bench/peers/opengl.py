"""OpenGL through EGL, without a display: persistent buffers, the Phong model in the fragment shader, a float target.

`llvmpipe` is Mesa's software rasterizer, `opengl` the machine's default implementation.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ....base.arrays import Array
from ....scene.camera import Camera
from ....scene.lights import plain_lights
from ....scene.model import Scene
from .arrays import depths, mesh_arrays, view_axes
from .peer import MissingPeer

SOFTWARE = "LIBGL_ALWAYS_SOFTWARE"
DEBIAN = "apt install libegl1 libgl1-mesa-dri"
PIP = "pip install moderngl, or clshade's extra `peers`"
BACKEND: dict[str, Any] = {"backend": "egl"}
SLACK = 2.0  # margin factor of the near and far planes, within which the camera may move

VERTEX = """
#version 330
uniform mat4 to_clip;
in vec3 in_position, in_normal, in_color;
out vec3 position, normal, color;
#if TEXTURED
in vec2 in_uv;
out vec2 uv;
#endif
void main() {
    position = in_position;
    normal = in_normal;
    color = in_color;
#if TEXTURED
    uv = in_uv;
#endif
    gl_Position = to_clip * vec4(in_position, 1.0);
}
"""

FRAGMENT = """
#version 330
uniform vec3 eye, ambient, kd, ks;
uniform float n;
#if LIGHTS
uniform vec3 light_position[LIGHTS], light_intensity[LIGHTS];
#endif
#if TEXTURED
uniform sampler2D image;
in vec2 uv;
#endif
in vec3 position, normal, color;
out vec4 result;
void main() {
    vec3 to_eye = normalize(eye - position), unit = normalize(normal);
    vec3 diffuse = vec3(0.0), specular = vec3(0.0);
#if LIGHTS
    for (int i = 0; i < LIGHTS; ++i) {
        vec3 to_light = normalize(light_position[i] - position);
        float cosine = dot(unit, to_light);
        if (cosine > 0.0) {
            diffuse += cosine * light_intensity[i];
            float towards = dot(2.0 * cosine * unit - to_light, to_eye);
            if (towards > 0.0)
                specular += pow(towards, n) * light_intensity[i];
        }
    }
#endif
    vec3 surface = color;
#if TEXTURED
    surface *= texture(image, uv).rgb;
#endif
    result = vec4((ambient + kd * diffuse + ks * specular) * surface, 1.0);
}
"""


@contextmanager
def _only_software(wanted: bool) -> Iterator[None]:
    """Make Mesa use its software rasterizer for contexts created within the block, if `wanted`."""
    before = os.environ.get(SOFTWARE)
    if wanted:
        os.environ[SOFTWARE] = "1"
    try:
        yield
    finally:
        if wanted:
            os.environ.pop(SOFTWARE) if before is None else os.environ.update({SOFTWARE: before})


def _context(name: str) -> Any:
    try:
        import moderngl
    except ImportError:
        raise MissingPeer(f"{name}: moderngl is not installed ({PIP})") from None
    try:
        with _only_software(name == "llvmpipe"):
            context = moderngl.create_context(standalone=True, **BACKEND)
    except Exception as error:  # moderngl's library loader may raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MissingPeer(f"{name}: no OpenGL context by EGL: {reason} (on Debian: {DEBIAN})") from None
    renderer = context.info["GL_RENDERER"]
    if name == "llvmpipe" and name not in renderer:
        context.release()
        raise MissingPeer(f"{name}: expected Mesa's llvmpipe, found {renderer} (on Debian: {DEBIAN})")
    return context


def buffer_depth(buffer: Array, near: float, far: float) -> Array:
    """Return the depth (M, N), float64, of a depth buffer (M, N); +inf where it is 1, at the far plane."""
    z: Array = np.where(buffer < 1.0, near * far / (far - buffer.astype(np.float64) * (far - near)), np.inf)
    return z


class OpenGL:
    """Renderer of a scene held in buffers of an OpenGL context."""

    once = False

    def __init__(self, context: Any, scene: Scene) -> None:
        self.scene = scene
        self._mesh = mesh_arrays(scene)
        self._context = context
        info = self._context.info
        self.title = f"{info['GL_RENDERER']}, OpenGL {info['GL_VERSION']}"
        columns, rows = scene.camera.resolution
        self._image = np.zeros((rows, columns, 4), np.float32)
        self._target = context.framebuffer(
            [context.renderbuffer((columns, rows), 4, dtype="f4")], context.depth_renderbuffer((columns, rows))
        )
        z = depths(self._mesh.verts, scene.camera)
        self._range = float(z.min() / SLACK), float(z.max() * SLACK)
        background = np.zeros(3) if scene.background is None else scene.background
        self._clear = (*map(float, background), 0.0)
        self._program = self._made_program()
        self._vertices = self._made_vertices()

    def _made_program(self) -> Any:
        macros = {"TEXTURED": int(self._mesh.uvs is not None), "LIGHTS": len(self.scene.lights)}
        defined = "#version 330\n" + "".join(f"#define {name} {value}\n" for name, value in macros.items())
        sources = (text.replace("#version 330\n", defined).lstrip() for text in (VERTEX, FRAGMENT))
        program = self._context.program(*sources)
        material = self._mesh.material
        values = {"ambient": material.ka * self.scene.ambient, "kd": material.kd, "ks": material.ks}
        for name, value in values.items():
            program[name].value = tuple(map(float, value))
        program["n"].value = material.n
        for name, part in (("light_position", "position"), ("light_intensity", "intensity")):
            if self.scene.lights:
                lights = plain_lights("bench", self.scene.lights)
                table = np.array([getattr(light, part) for light in lights], np.float32)
                program[name].write(table.tobytes())
        return program

    def _made_vertices(self) -> Any:
        mesh, context = self._mesh, self._context
        parts = [mesh.verts, mesh.normals, mesh.colors]
        form, names = "3f 3f 3f", ["in_position", "in_normal", "in_color"]
        if mesh.uvs is not None:
            parts, form, names = [*parts, mesh.uvs], f"{form} 2f", [*names, "in_uv"]
            self._texture = self._made_texture()
        buffer = context.buffer(np.concatenate(parts, axis=1).tobytes())
        return context.vertex_array(self._program, [(buffer, form, *names)], context.buffer(mesh.faces.tobytes()))

    def _made_texture(self) -> Any:
        import moderngl

        texture = self._mesh.material.texture
        assert texture is not None
        rows, columns, channels = texture.image.shape
        made = self._context.texture((columns, rows), channels, texture.image.tobytes(), dtype="f4")
        made.filter = (moderngl.LINEAR, moderngl.LINEAR)
        made.repeat_x, made.repeat_y = (wrap == "repeat" for wrap in texture.wrap)
        made.use()
        return made

    def _to_clip(self, camera: Camera) -> Array:
        """Return the matrix (4, 4) from world space to clip space."""
        axes, scale = view_axes(camera)
        near, far = self._range
        lens = np.zeros((4, 4))
        lens[0, 0], lens[1, 1] = scale
        lens[2, 2:] = (far + near) / (far - near), -2.0 * far * near / (far - near)
        lens[3, 2] = 1.0
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes, -axes @ camera.eye
        return lens @ pose

    def draw(self, camera: Camera) -> Array:
        self._target.use()
        self._context.enable_only(self._context.DEPTH_TEST)
        self._program["to_clip"].write(np.ascontiguousarray(self._to_clip(camera).T, np.float32).tobytes())
        self._program["eye"].value = tuple(map(float, camera.eye))
        self._target.clear(*self._clear, depth=1.0)
        self._vertices.render()
        self._target.read_into(self._image, components=4, dtype="f4")
        return self._image[::-1]

    def depth(self) -> Array:
        """Return the depth of what `draw` has drawn, (M, N) float64, from the depth buffer; +inf where nothing is."""
        columns, rows = self.scene.camera.resolution
        buffer = np.frombuffer(self._target.read(components=1, attachment=-1, dtype="f4"), np.float32).reshape(
            rows, columns
        )[::-1]
        return buffer_depth(buffer, *self._range)

    def close(self) -> None:
        self._context.release()


def open_for(name: str, scene: Scene) -> OpenGL:
    context = _context(name)
    try:
        return OpenGL(context, scene)
    except Exception as error:
        context.release()
        import moderngl

        if isinstance(error, moderngl.Error):  # an image or a texture that is too large, or no float target
            raise MissingPeer(f"{name}: {' '.join(str(error).split())}") from None
        raise
