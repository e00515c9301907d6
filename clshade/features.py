"""Leave out what a scene does not need: scene + settings -> feature mask -> -D options of the kernels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from .scene import Material, Mesh, Scene, Settings

# Choices of the settings and of the input's form; each has its own meaning whether 0 or 1.
CHOICES = (
    "FAST",
    "DOUBLE",
    "SAMPLES",
    "SAMPLE_SHADING",
    "WEIGHTED",
    "PHONG",
    "LIT",
    "DEPTH_TEST",
    "PERSPECTIVE",
    "CENTROID",
    "TINTED",
    "CULL",
    "SIDES",
    "TWO_SIDED",
    "ALPHA_TEST",
    "MIPMAPS",
    "ORTHOGRAPHIC",
    "BACKGROUND",
    "CORNER_COLORS",
    "NORMAL_INDICES",
    "UV_INDICES",
    "DOUBLE_POSITIONS",
)
# Work that a scene may not need: 1 never changes a bit of the image, 0 saves the work.
OPTIONAL = ("AMBIENT", "DIFFUSE", "SPECULAR", "POWER", "VERTEX_COLORS", "TEXTURED", "MATERIALS", "OWNERS")


@dataclass(frozen=True)
class Features:
    """The macros of one program, name -> 0 or 1, and why each optional one that is 0 was left out."""

    values: tuple[tuple[str, int], ...]
    left_out: tuple[tuple[str, str], ...] = ()

    def __getitem__(self, name: str) -> int:
        return dict(self.values)[name]

    @property
    def used(self) -> tuple[str, ...]:
        return tuple(name for name, value in self.values if value)

    def only(self, names: Iterable[str]) -> Features:
        """The same with every other feature 0: what a program that reads no other ones depends on."""
        kept = set(names)
        return Features(tuple((name, value if name in kept else 0) for name, value in self.values))

    def options(self) -> list[str]:
        """-D options of the OpenCL build, each feature as 0 or 1."""
        return [f"-D{name}={value}" for name, value in self.values]


def texture_applies(mesh: Mesh) -> bool:
    """Whether the mesh has both a texture and coordinates to look it up with."""
    return mesh.material.texture is not None and mesh.uvs is not None


def material_key(mesh: Mesh) -> tuple[int, bool]:
    """Meshes with the same key share a row of the material table."""
    return id(mesh.material), texture_applies(mesh)


def materials_of(scene: Scene) -> dict[tuple[int, bool], Material]:
    """The rows of the material table, by key, in the order of the meshes that are drawn; at least one."""
    table: dict[tuple[int, bool], Material] = {}
    for mesh in scene.meshes:
        if len(mesh.faces):
            key = material_key(mesh)
            table.setdefault(key, mesh.material if key[1] else replace(mesh.material, texture=None))
    return table or {(0, False): Material()}


def replaces_colors(mesh: Mesh) -> bool:
    """Whether texels take the place of the mesh's vertex colors."""
    return texture_applies(mesh) and mesh.material.texture.lookup == "course"  # type: ignore[union-attr]


def alpha_tested(mesh: Mesh) -> bool:
    """Whether some pixels of the mesh may be left out for their alpha."""
    texture = mesh.material.texture
    tested = mesh.uvs is not None and mesh.material.alpha_cutoff is not None
    return texture is not None and tested and texture.image.shape[2] == 4


def has_levels(mesh: Mesh) -> bool:
    """Whether a smaller image of the mesh's texture can be of use: the course's lookup knows none, nor does one texel."""
    texture = mesh.material.texture
    return texture_applies(mesh) and texture.lookup == "standard" and max(texture.image.shape[:2]) > 1  # type: ignore[union-attr]


def ignored(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """What the scene's file or the settings ask for and no render shows, a few words each."""
    plain = settings.texture_filter == "trilinear" and any(replaces_colors(mesh) for mesh in scene.meshes)
    return (*scene.ignored, *(("the trilinear filter of textures with the course's lookup",) if plain else ()))


def _is_white(mesh: Mesh) -> bool:
    return mesh.colors is None or not (mesh.colors != 1.0).any()


def _any_nonzero(values: Iterable[np.ndarray]) -> bool:
    return any(value.any() for value in values)


def _first(*reasons: tuple[bool, str]) -> str:
    """The first reason that holds; "" if none does."""
    return next((text for holds, text in reasons if holds), "")


def _unneeded_terms(materials: list[Material], ambient: np.ndarray, lit: bool, shining: bool) -> dict[str, str]:
    """Why each term of the reflection model is not needed; "" for one that is. shining: whether some light does."""
    dark = ((not lit, "shader nolight"), (not shining, "no light shines"))
    no_specular = _first(*dark, (not _any_nonzero(m.ks for m in materials), "ks is 0"))
    return {
        "AMBIENT": _first(
            (not lit, "shader nolight"),
            (not ambient.any(), "no ambient light"),
            (not _any_nonzero(m.ka for m in materials), "ka is 0"),
            (not _any_nonzero(m.ka * ambient for m in materials), "ka*Ia is 0"),
        ),
        "DIFFUSE": _first(*dark, (not _any_nonzero(m.kd for m in materials), "kd is 0")),
        "SPECULAR": no_specular,
        "POWER": _first(
            (bool(no_specular), f"no specular term: {no_specular}"),
            (not any(m.n != 1.0 and m.ks.any() for m in materials), "no exponent but 1"),
        ),
    }


def _unneeded_colors(meshes: list[Mesh], at_corners: bool) -> dict[str, str]:
    """Why vertex colors and textures are not needed at the pixels; "" for what is. at_corners: texture_at vertex."""
    textured = any(map(texture_applies, meshes))
    own = [mesh for mesh in meshes if not replaces_colors(mesh)]
    white = all(map(_is_white, own)) and not _any_nonzero(mesh.material.color != 1.0 for mesh in meshes)
    at_vertices = textured and at_corners
    return {
        "VERTEX_COLORS": _first(
            (at_vertices, "texture_at vertex: they are in the corners' colors"),
            (white and not all(map(_is_white, meshes)), "texels take the place of vertex colors"),
            (white, "no vertex or material colors other than white"),
        ),
        "TEXTURED": _first(
            (at_vertices, "texture_at vertex: looked up at the corners"),
            (not any(mesh.material.texture is not None for mesh in meshes), "no texture"),
            (not textured, "no texture coordinates"),
        ),
    }


def derive_alone(shader: str, material: Material, ambient: np.ndarray, shining: bool) -> Features:
    """The features of a triangle or point drawn by itself, with colors of its own: preset `course`, no background."""
    lit = shader != "nolight"
    values = {"PHONG": int(shader == "phong"), "LIT": int(lit), "CENTROID": 1, "VERTEX_COLORS": 1}
    unneeded = _unneeded_terms([material], ambient, lit, lit and shining)
    values.update({name: int(not reason) for name, reason in unneeded.items()})
    return Features(tuple((name, values.get(name, 0)) for name in CHOICES + OPTIONAL))


def derive(scene: Scene, settings: Settings, *, double_positions: bool, everything: bool = False) -> Features:
    """The features this scene needs under these settings.

    double_positions: whether vertex positions are kept as float64.
    everything: turn every optional feature on, to measure what leaving out saves; the image stays the same, bit for bit.
    """
    lit = settings.shader != "nolight"
    materials = list(materials_of(scene).values())
    meshes = [mesh for mesh in scene.meshes if len(mesh.faces)]
    shining = lit and any(light.intensity.any() for light in scene.lights)
    front_only = [m.sides == "front" for m in materials]
    textured = any(texture_applies(mesh) for mesh in meshes)
    at_corners = textured and settings.texture_at == "vertex"
    choices = {
        "FAST": settings.precision == "fast",
        "DOUBLE": settings.precision == "float64",
        "SAMPLES": settings.samples > 1,
        "SAMPLE_SHADING": settings.samples > 1 and settings.sample_shading,
        "WEIGHTED": settings.samples > 1 and settings.resolve == "weighted",
        "PHONG": settings.shader == "phong",
        "LIT": lit,
        "DEPTH_TEST": settings.visibility == "depth",
        "PERSPECTIVE": settings.interpolation == "perspective" and not scene.camera.orthographic,
        "CENTROID": settings.lighting_at == "centroid",
        "TINTED": settings.ambient == "tinted",
        "CULL": settings.cull or all(front_only),
        "SIDES": any(front_only) and not (settings.cull or all(front_only)),
        "TWO_SIDED": shining and any(m.two_sided for m in materials),
        "ALPHA_TEST": any(map(alpha_tested, meshes)),
        "MIPMAPS": settings.texture_filter == "trilinear" and any(map(has_levels, meshes)),
        "ORTHOGRAPHIC": scene.camera.orthographic,
        "BACKGROUND": scene.background is not None and bool(scene.background.any()),
        "CORNER_COLORS": at_corners,
        "NORMAL_INDICES": shining and any(uses_normal_indices(scene, mesh) for mesh in meshes),
        "UV_INDICES": textured and any(mesh.uv_faces is not None for mesh in meshes),
        "DOUBLE_POSITIONS": double_positions,
    }
    unneeded = {
        **_unneeded_terms(materials, scene.ambient, lit, shining),
        **_unneeded_colors(meshes, at_corners),
        "MATERIALS": _first((len(materials) < 2, "a single material")),
        "OWNERS": _first((not settings.layers, "no layer asked for")),
    }
    values = {name: int(choices[name]) for name in CHOICES}
    values.update({name: int(everything or not unneeded[name]) for name in OPTIONAL})
    if everything and at_corners:  # the corners' colors hold vertex colors and texels already
        values["VERTEX_COLORS"] = values["TEXTURED"] = 0
    left_out = tuple((name, unneeded[name]) for name in OPTIONAL if not values[name])
    return Features(tuple(values.items()), left_out)


def uses_normal_indices(scene: Scene, mesh: Mesh) -> bool:
    """Whether the mesh's own normals, indexed apart from its vertices, are used; course scenes always compute them."""
    return mesh.normals is not None and mesh.normal_faces is not None and scene.preset != "course"
