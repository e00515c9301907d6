"""A scene drawn by OpenGL through EGL, without a display: persistent buffers, the Phong model in the fragment shader, and a
float image in NumPy memory that is used again for every frame.

`llvmpipe` is Mesa's software rasterizer, `opengl` the machine's default implementation.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.arrays import Array, Floats
from ...errors import ClshadeError, InputError
from ...pipeline.features import FEATURES, WORK
from ...scene.camera import Camera
from ...scene.geometry import camera_axes, vertex_normals
from ...scene.lights import plain_lights
from ...scene.model import Mesh, Scene
from ...scene.texture import Texture

DEBIAN = "apt install libegl1 libgl1-mesa-dri"
PIP = "pip install moderngl, or clshade's extra `peers`"
BACKEND: dict[str, Any] = {"backend": "egl"}
SLACK = 2.0  # margin factor of the near and far planes, within which the camera may move

# What a scene to be drawn here needs of clshade, and may need.
NEEDED = ("PHONG", "DEPTH_TEST", "PERSPECTIVE", "TINTED", "LIT")
DRAWN = (
    *(*NEEDED, "BRIGHT", "AMBIENT", "DIFFUSE", "SPECULAR", "POWER", "TWO_SIDED", "NORMAL_INDICES", "VERTEX_COLORS"),
    *("TEXTURED", "UV_INDICES", "MATERIALS", "DOUBLE_POSITIONS", "BACKGROUND", "OWNERS"),
)

VERTEX = """
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
uniform vec3 eye, ambient, kd, ks;
uniform float n;
uniform vec3 light_position[LIGHTS], light_intensity[LIGHTS];
#if TEXTURED
uniform sampler2D image;
in vec2 uv;
#endif
in vec3 position, normal, color;
out vec4 result;
void main() {
    vec3 to_eye = normalize(eye - position), unit = normalize(normal);
#if TWO_SIDED
    if (!gl_FrontFacing)
        unit = -unit;
#endif
    vec3 diffuse = vec3(0.0), specular = vec3(0.0);
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
    vec3 surface = color;
#if TEXTURED
    surface *= texture(image, uv).rgb;
#endif
    result = vec4((ambient + kd * diffuse + ks * specular) * surface, 1.0);
}
"""


class MissingOpenGL(ClshadeError):
    """Error for OpenGL that is not installed or does not work; the message says what to install."""


def open_context(name: str) -> Any:
    """Return a context of moderngl for llvmpipe or opengl. Raises MissingOpenGL."""
    try:
        import moderngl
    except ImportError:
        raise MissingOpenGL(f"{name}: moderngl is not installed ({PIP})") from None
    if name == "llvmpipe":
        os.environ["LIBGL_ALWAYS_SOFTWARE"] = "1"  # Mesa reads it for each context
    try:
        context = moderngl.create_context(standalone=True, **BACKEND)
    except Exception as error:  # moderngl's library loader may raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MissingOpenGL(f"{name}: no OpenGL context by EGL: {reason} (on Debian: {DEBIAN})") from None
    renderer = context.info["GL_RENDERER"]
    if name == "llvmpipe" and name not in renderer:
        context.release()
        raise MissingOpenGL(f"{name}: expected Mesa's llvmpipe, found {renderer} (on Debian: {DEBIAN})")
    return context


def mesh_arrays(mesh: Mesh) -> tuple[Array, Array]:
    """Return a mesh with one index for all attributes of a vertex.

    Returns vertices, (V, 9 or 11) float32: position, unit normal or 0, color, and texture coordinates if it has a texture;
    and faces, (F, 3) int32.
    """
    normals = vertex_normals(mesh.verts, mesh.faces) if mesh.normals is None else mesh.normals
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    colors = (np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors) * mesh.material.color
    tables = [np.hstack([mesh.verts, colors]), normals]
    indices = [mesh.faces, mesh.faces if mesh.normal_faces is None else mesh.normal_faces]
    if mesh.material.texture is not None and mesh.uvs is not None:
        tables.append(mesh.uvs)
        indices.append(mesh.faces if mesh.uv_faces is None else mesh.uv_faces)
    if all(index is mesh.faces for index in indices):
        return np.hstack(tables).astype(np.float32), mesh.faces.astype(np.int32)
    corners = np.stack([index.reshape(-1) for index in indices], axis=1)
    unique, faces = np.unique(corners, axis=0, return_inverse=True)
    vertices = np.hstack([table[index] for table, index in zip(tables, unique.T, strict=True)])
    return vertices.astype(np.float32), faces.reshape(-1, 3).astype(np.int32)


def depths(mesh: Mesh, camera: Camera) -> Floats:
    """Return the camera z of the mesh's vertices."""
    z: Floats = (mesh.verts - camera.eye) @ camera_axes(camera)[2]
    return z


def check_drawn(scene: Scene, features: Sequence[str]) -> None:
    """Raise InputError for a scene that OpenGL does not draw here. features: those that clshade needs for it."""
    work = {name: WORK.get(name, name.lower().replace("_", " ")) for name in FEATURES}
    beyond = [*(f"no {work[name]}" for name in NEEDED if name not in features)]
    beyond += [work[name] for name in features if name not in DRAWN]
    if not scene.lights:
        beyond.append("no light")
    if any(not np.array_equal(mesh.instances, np.eye(4)[None]) for mesh in scene.meshes):
        beyond.append("meshes placed by matrices")
    if scene.camera.principal != (0.5, 0.5):
        beyond.append("a principal point beside the center")
    if any(depths(mesh, scene.camera).min(initial=1.0) <= 0.0 for mesh in scene.meshes):
        beyond.append("triangles behind the eye")
    if beyond:
        raise InputError(
            "bench: --against: expected a scene lit per pixel by point lights, as --look plain --preset standard shows it, "
            f"found {', '.join(beyond)}"
        )


class OpenGL:
    """A scene held in buffers of an OpenGL context, which it takes over. Raises MissingOpenGL for an image or a texture that
    is too large, or without float targets."""

    def __init__(self, context: Any, scene: Scene) -> None:
        import moderngl

        self._context, self._scene = context, scene
        visible = [mesh for mesh in scene.meshes if len(mesh.faces)]
        try:
            columns, rows = scene.camera.resolution
            self._image = np.zeros((rows, columns, 4), np.float32)
            color = context.renderbuffer((columns, rows), 4, dtype="f4")
            self._target = context.framebuffer([color], context.depth_renderbuffer((columns, rows)))
            self._parts = [self._part(mesh) for mesh in visible]
        except moderngl.Error as error:
            context.release()
            raise MissingOpenGL(f"OpenGL: {' '.join(str(error).split())}") from None
        self.title = f"{context.info['GL_RENDERER']}, OpenGL {context.info['GL_VERSION']}"
        z = np.concatenate([depths(mesh, scene.camera) for mesh in visible] or [np.ones(1)])
        self._range = float(z.min() / SLACK), float(z.max() * SLACK)
        background = np.zeros(3) if scene.background is None else scene.background
        self._clear = (*map(float, background), 0.0)

    def _part(self, mesh: Mesh) -> tuple[Any, Any, Any]:
        """Return a mesh's program, vertices and texture, which may be None."""
        context, (vertices, faces) = self._context, mesh_arrays(mesh)
        texture = mesh.material.texture if vertices.shape[1] == 11 else None
        program = self._program(mesh, texture is not None)
        form, names = "3f 3f 3f", ["in_position", "in_color", "in_normal"]
        if texture is not None:
            form, names = "3f 3f 3f 2f", [*names, "in_uv"]
        array = context.vertex_array(program, [(context.buffer(vertices), form, *names)], context.buffer(faces))
        return program, array, None if texture is None else self._texture(texture)

    def _program(self, mesh: Mesh, textured: bool) -> Any:
        lights, material = plain_lights("bench", self._scene.lights), mesh.material
        macros = {"TEXTURED": int(textured), "LIGHTS": len(lights), "TWO_SIDED": int(material.two_sided)}
        head = "#version 330\n" + "".join(f"#define {name} {value}\n" for name, value in macros.items())
        program = self._context.program(head + VERTEX, head + FRAGMENT)
        values: dict[str, Any] = {
            "ambient": material.ka * self._scene.ambient,
            "kd": material.kd,
            "ks": material.ks,
            "n": material.n,
        }
        values["light_position"] = [light.position for light in lights]
        values["light_intensity"] = [light.intensity for light in lights]
        for name, value in values.items():
            program[name].write(np.array(value, np.float32).tobytes())
        return program

    def _texture(self, texture: Texture) -> Any:
        import moderngl

        rows, columns, channels = texture.image.shape
        texture_object = self._context.texture((columns, rows), channels, texture.image.tobytes(), dtype="f4")
        texture_object.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture_object.repeat_x, texture_object.repeat_y = (wrap == "repeat" for wrap in texture.wrap)
        return texture_object

    def _to_clip(self, camera: Camera) -> Array:
        """Return the matrix (4, 4) from world space to clip space."""
        axes = camera_axes(camera)
        height, width = camera.plane
        near, far = self._range
        lens = np.diag([2.0 * camera.focal / width, 2.0 * camera.focal / height, 0.0, 0.0])
        lens[2, 2:] = (far + near) / (far - near), -2.0 * far * near / (far - near)
        lens[3, 2] = 1.0
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes, -axes @ camera.eye
        return lens @ pose

    def draw(self, camera: Camera) -> Array:
        """Render linear RGBA, (M, N, 4) float32, row 0 at the top; the next frame overwrites it."""
        to_clip, eye = (np.float32(values).tobytes() for values in (self._to_clip(camera).T, camera.eye))
        self._target.use()
        self._context.enable_only(self._context.DEPTH_TEST)
        self._target.clear(*self._clear, depth=1.0)
        for program, vertices, texture in self._parts:
            program["to_clip"].write(to_clip)
            program["eye"].write(eye)
            if texture is not None:
                texture.use()
            vertices.render()
        self._target.read_into(self._image, components=4, dtype="f4")
        return self._image[::-1]

    def close(self) -> None:
        self._context.release()
