"""Features: derive from scene and settings the macros (-D options) that leave unneeded work out of the kernels."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ..errors import InputError
from ..scene.lights import has_size, is_plain
from ..scene.model import Material, Mesh, Scene, Settings, Texture
from .maps import map_of, maps_of, textures_of, usable

# Choices of the settings and of the camera; 0 and 1 mean different images.
CHOICES = (
    "FAST",
    "DOUBLE",
    "SAMPLES",
    "SAMPLE_SHADING",
    "WEIGHTED",
    "PHONG",
    "PBR",
    "DEPTH_TEST",
    "PERSPECTIVE",
    "CENTROID",
    "TINTED",
    "CULL",
    "ORTHOGRAPHIC",
    "CORNER_COLORS",
    "BRIGHT",
    "LINES",
    "LINES_ONLY",
    "BACKDROP",
    "INSTANCES",  # the same image, from one copy of each mesh: see instances.py
)
# Work that a scene may not need: 1 is always correct and gives the same bits, 0 saves the work.
OPTIONAL = (
    "LIT",
    "AMBIENT",
    "DIFFUSE",
    "SPECULAR",
    "POWER",
    "EMISSION",
    "ENVIRONMENT",
    "LIGHT_SHAPES",
    "AREA_LIGHTS",
    "SHADOWS",
    "SHADOW_ALPHA",
    "AMBIENT_OCCLUSION",
    "TWO_SIDED",
    "NORMAL_INDICES",
    "VERTEX_COLORS",
    "SCALARS",
    "TEXTURED",
    "UV_INDICES",
    "MIPMAPS",
    "ALPHA_TEST",
    "NEAREST",
    "NORMAL_MAP",
    "OCCLUSION_MAP",
    "EMISSION_MAP",
    "ROUGHNESS_MAP",
    "UV_SETS",
    "BLEND",
    "VERTEX_ALPHA",
    "MATERIALS",
    "SIDES",
    "DOUBLE_POSITIONS",
    "BACKGROUND",
    "OWNERS",
    "SORTED",
)


@dataclass(frozen=True)
class Features:
    """The macros of one program, name -> 0 or 1, and the reason why each optional one that is 0 is left out."""

    values: tuple[tuple[str, int], ...]
    left_out: tuple[tuple[str, str], ...] = ()

    @cached_property
    def _table(self) -> dict[str, int]:
        return dict(self.values)

    def __getitem__(self, name: str) -> int:
        return self._table[name]

    @property
    def used(self) -> tuple[str, ...]:
        return tuple(name for name, value in self.values if value)

    def only(self, names: Iterable[str]) -> Features:
        """Return the features with all but `names` set to 0, for a program that reads no others."""
        kept = set(names)
        return Features(tuple((name, value if name in kept else 0) for name, value in self.values))

    def including(self, name: str) -> Features:
        """Return the features with an optional one that is not left out."""
        return Features(
            tuple((each, 1 if each == name else value) for each, value in self.values),
            tuple(reason for reason in self.left_out if reason[0] != name),
        )

    def counting(self) -> Features:
        """Return the features with the counts of rays, see shadow_counts.py."""
        return Features((*self.values, ("SHADOW_COUNTS", 1)), self.left_out)

    @property
    def counts(self) -> bool:
        """Whether rays are counted."""
        return "SHADOW_COUNTS" in self._table

    def options(self) -> list[str]:
        """Return -D options of the OpenCL build, each feature as 0 or 1."""
        return [f"-D{name}={value}" for name, value in self.values]


def texture_applies(mesh: Mesh) -> bool:
    """Return whether the mesh has both a texture and texture coordinates."""
    return mesh.material.texture is not None and mesh.uvs is not None


MaterialKey: TypeAlias = tuple[int, bool, bool, bool, frozenset[str]]


def material_key(mesh: Mesh) -> MaterialKey:
    """Return a key; meshes with the same key share a row of the material table."""
    return id(mesh.material), texture_applies(mesh), mesh.blends, mesh.tests_alpha, frozenset(maps_of(mesh))


def materials_of(scene: Scene) -> dict[MaterialKey, Material]:
    """Return the rows of the material table by key, in the order of the meshes with faces; at least one. Each has only
    what applies to its meshes: textures, transparency, alpha test."""
    table: dict[MaterialKey, Material] = {}
    for mesh in scene.meshes:
        key = material_key(mesh)
        if len(mesh.faces) and key not in table:
            own = usable(mesh)
            cutoff = own.alpha_cutoff if mesh.tests_alpha else None
            table[key] = replace(own, blend=mesh.blends, alpha_cutoff=cutoff)
    return table or {(0, False, False, False, frozenset()): Material()}


def replaces_colors(mesh: Mesh) -> bool:
    """Return whether texels replace the mesh's vertex colors."""
    return texture_applies(mesh) and mesh.material.texture.lookup == "course"  # type: ignore[union-attr]


def has_levels(texture: Texture) -> bool:
    """Return whether mip-map levels of a texture can be used: not with the course's lookup, nor with a single texel."""
    return texture.lookup == "standard" and max(texture.image.shape[:2]) > 1


def ignored(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """Return what the scene's file or the settings ask for but no render shows, a few words each."""
    plain = settings.texture_filter == "trilinear" and any(replaces_colors(mesh) for mesh in scene.meshes)
    looked_up = [texture for mesh in scene.meshes for texture in textures_of(mesh, maps=False)]
    smooth = settings.texture_at == "vertex" and any(texture.filter == "nearest" for texture in looked_up)
    unlit = scene.environment is not None and settings.shader != "pbr" and settings.background != "environment"
    words = (
        (plain, "the trilinear filter of textures with the course's lookup"),
        (smooth, "the filter nearest of textures that are looked up at vertices"),
        (unlit, "the environment, which only shader pbr shows"),
    )
    return (*scene.ignored, *(text for holds, text in words if holds))


def _is_white(mesh: Mesh) -> bool:
    return mesh.colors is None or not (mesh.colors != 1.0).any()


def _any_beyond_one(mesh: Mesh, at_corners: bool) -> bool:
    """Return whether colors beyond 1 may be interpolated. at_corners: texture_at vertex, where texels are interpolated
    too."""
    looked_up = at_corners and texture_applies(mesh)
    if mesh.colors is None and not looked_up:
        return False
    most = np.abs(mesh.material.color)
    with np.errstate(over="ignore"):
        if mesh.colors is not None and not replaces_colors(mesh):
            most = most * np.maximum(mesh.colors.max(axis=0, initial=0.0), -mesh.colors.min(axis=0, initial=0.0))
        if looked_up:
            most = most * np.abs(mesh.material.texture.image[..., :3]).max(axis=(0, 1))  # type: ignore[union-attr]
    return bool((most > 1.0).any())


def _any_nonzero(values: Iterable[np.ndarray]) -> bool:
    return any(value.any() for value in values)


def _first(*reasons: tuple[bool, str]) -> str:
    """Return the text of the first condition that holds; "" if none does."""
    return next((text for holds, text in reasons if holds), "")


def _unneeded_terms(materials: list[Material], ambient: np.ndarray, shader: str, shining: bool) -> dict[str, str]:
    """Return why each term of the reflection model is not needed; "" for one that is. shining: whether any light has an
    intensity other than 0."""
    unlit, model = (shader == "nolight", "shader nolight"), f"shader {shader}"
    dark = (unlit, (not shining, "no light shines"))
    if shader == "pbr":
        facets = [m.microfacets for m in materials]
        diffuse = any(
            (f.metallic < 1.0 or f.metallic_roughness_texture is not None) and m.diffuse.any()
            for f, m in zip(facets, materials, strict=True)
        )
        no_diffuse = _first(*dark, (not diffuse, "metals alone"))
        mirrors = any(f.metallic > 0.0 or f.specular > 0.0 for f in facets)
        no_specular = _first(*dark, (not mirrors, "specular is 0"))
        no_power, no_emission = model, _first((not _any_nonzero(f.emission for f in facets), "emission is 0"))
    else:
        no_diffuse = _first(*dark, (not _any_nonzero(m.kd for m in materials), "kd is 0"))
        no_specular = _first(*dark, (not _any_nonzero(m.ks for m in materials), "ks is 0"))
        no_power = _first(
            (bool(no_specular), f"no specular term: {no_specular}"),
            (not any(m.n != 1.0 and m.ks.any() for m in materials), "no exponent but 1"),
        )
        no_emission = model
    return {
        "LIT": _first(unlit),
        "AMBIENT": _first(
            unlit,
            (not ambient.any(), "no ambient light"),
            (not _any_nonzero(m.ka for m in materials), "ka is 0"),
            (not _any_nonzero(m.ka * ambient for m in materials), "ka*Ia is 0"),
        ),
        "DIFFUSE": no_diffuse,
        "SPECULAR": no_specular,
        "POWER": no_power,
        "EMISSION": no_emission,
    }


def shows_environment(scene: Scene, settings: Settings) -> bool:
    """Return whether an environment lights the scene."""
    return settings.shader == "pbr" and not no_environment(scene)


def no_environment(scene: Scene) -> str:
    """Return why no environment lights the scene, "" if one does."""
    environment = scene.environment
    return _first(
        (environment is None, "no environment"),
        (environment is not None and not (environment.intensity and environment.image.any()), "it is black"),
    )


def _unneeded_maps(meshes: list[Mesh], shader: str, terms: dict[str, str]) -> dict[str, str]:
    """Return the same for the maps of shader pbr. terms: of the reflection model."""
    model = (shader != "pbr", f"shader {shader}")
    unlit = terms["DIFFUSE"] and terms["SPECULAR"]
    reasons = {
        "NORMAL_MAP": (unlit, "normal_texture", "no normal map"),
        "OCCLUSION_MAP": (terms["AMBIENT"] if terms["ENVIRONMENT"] else "", "occlusion_texture", "no occlusion map"),
        "EMISSION_MAP": (terms["EMISSION"], "emission_texture", "no emission map"),
        "ROUGHNESS_MAP": (unlit, "metallic_roughness_texture", "no metallic-roughness map"),
    }
    return {
        feature: _first(model, (bool(without), without), (all(map_of(mesh, name) is None for mesh in meshes), words))
        for feature, (without, name, words) in reasons.items()
    }


def _unneeded_normals(scene: Scene, meshes: list[Mesh], unread: str) -> dict[str, str]:
    """Return the same for the features of normals. unread: why no normal is read; "" if some are."""
    return {
        "TWO_SIDED": unread or _first((not any(mesh.material.two_sided for mesh in meshes), "no two-sided material")),
        "NORMAL_INDICES": unread
        or _first((not any(uses_normal_indices(scene, mesh) for mesh in meshes), "a normal per vertex")),
    }


def shows_scalars(mesh: Mesh, settings: Settings) -> bool:
    """Return whether scalars color the mesh."""
    return settings.scalars is not None and settings.scalars.name in mesh.scalars


def casts_alpha(scene: Scene) -> bool:
    """Return whether some of what casts shadows may let light pass."""
    return any(mesh.blends or mesh.tests_alpha for mesh in scene.meshes if len(mesh.faces))


def finds_casters(features: Features) -> bool:
    """Return whether kernels follow rays to what casts shadows."""
    return bool(features["SHADOWS"] or features["AMBIENT_OCCLUSION"])


def looks_up(features: Features) -> bool:
    """Return whether textures are looked up at the pixels."""
    names = ("TEXTURED", "ALPHA_TEST", "BLEND", "NORMAL_MAP", "OCCLUSION_MAP", "EMISSION_MAP", "ROUGHNESS_MAP")
    return any(features[name] for name in names)


def looked_up_at_corners(scene: Scene, settings: Settings) -> bool:
    """Return whether textures are looked up at the corners of faces."""
    return settings.texture_at == "vertex" and any(texture_applies(mesh) for mesh in scene.meshes if len(mesh.faces))


def _unneeded_colors(meshes: list[Mesh], settings: Settings, at_corners: bool, own_corners: bool) -> dict[str, str]:
    """Return the same for vertex colors, scalars and textures at the pixels. at_corners: texture_at vertex. own_corners:
    whether corners have colors of their own for another reason."""
    bilinear = settings.texture_filter == "bilinear"
    no_scalars = _first(
        (settings.scalars is None, "no scalars asked for"),
        (not any(shows_scalars(mesh, settings) for mesh in meshes), "no face has the scalars"),
    )
    textured = any(map(texture_applies, meshes))
    own = [mesh for mesh in meshes if not replaces_colors(mesh)]
    white = all(map(_is_white, own)) and not _any_nonzero(mesh.material.color != 1.0 for mesh in meshes)
    no_texture = _first(
        (not any(mesh.material.texture is not None for mesh in meshes), "no texture"),
        (not textured, "no texture coordinates"),
    )
    looked_up = [texture for mesh in meshes for texture in textures_of(mesh, maps=settings.shader == "pbr")]
    no_lookup = "" if looked_up else no_texture
    return {
        "VERTEX_COLORS": _first(
            (at_corners, "texture_at vertex: they are in the corners' colors"),
            (own_corners, "they are in the corners' colors"),
            (not no_scalars, ""),
            (white and not all(map(_is_white, meshes)), "texels take the place of vertex colors"),
            (white, "no vertex or material colors other than white"),
        ),
        "SCALARS": no_scalars,
        "TEXTURED": _first((at_corners, "texture_at vertex: looked up at the corners")) or no_texture,
        "UV_INDICES": no_lookup
        or _first((all(mesh.uv_faces is None for mesh in meshes), "texture coordinates per vertex")),
        "MIPMAPS": no_lookup
        or _first(
            (bilinear, "texture_filter bilinear"),
            (not any(map(has_levels, looked_up)), "textures of one texel or with the course's lookup"),
        ),
        "NEAREST": no_lookup
        or _first((all(texture.filter != "nearest" for texture in looked_up), "no texture with the filter nearest")),
        "UV_SETS": no_lookup
        or _first((not any(texture.coordinates for texture in looked_up), "one set of coordinates")),
    }


def _unneeded_alpha(meshes: list[Mesh]) -> dict[str, str]:
    """Return the same for alpha."""
    tested, blended = any(mesh.tests_alpha for mesh in meshes), any(mesh.blends for mesh in meshes)
    counts = any(mesh.alphas is not None and (mesh.blends or mesh.tests_alpha) for mesh in meshes)
    return {
        "ALPHA_TEST": _first((not tested, "no alpha test")),
        "BLEND": _first((not blended, "nothing is transparent")),
        "VERTEX_ALPHA": _first((not counts, "no alpha at vertices counts")),
    }


def _culls(materials: list[Material], settings: Settings) -> bool:
    """Return whether all back faces are culled."""
    return settings.cull or all(material.sides == "front" for material in materials)


def _unneeded_input(
    scene: Scene, settings: Settings, materials: list[Material], *, double: bool, blended: bool, instanced: bool
) -> dict[str, str]:
    """Return the same for the remaining features. double: whether positions need float64. blended: whether lists may hold
    transparent triangles, which takes sorted ones, as do instances. instanced: as in `derive`."""
    return {
        "MATERIALS": _first((len(materials) < 2, "a single material")),
        "SIDES": _first(
            (_culls(materials, settings), "all that is seen from behind is culled"),
            (not any(m.sides == "front" for m in materials), "both sides of every material are drawn"),
        ),
        "DOUBLE_POSITIONS": _first(
            (instanced, "instances are placed where they are needed"), (not double, "float32 holds the positions")
        ),
        "BACKGROUND": _first(
            (scene.background is None, "no background"),
            (settings.background == "environment", "the environment is the background"),
            (not _any_nonzero([np.asarray(scene.background)]), "the background is black"),
        ),
        "OWNERS": _first((not settings.layers, "no layer asked for")),
        # Gouraud's shading lights the corners of the sorted triangles; kernels of 16 doubles do not order lists; lines need
        # the clipped triangles before the pixel stage.
        "SORTED": _first(
            (
                settings.visibility == "depth"
                and settings.shader != "gouraud"
                and settings.precision != "float64"
                and settings.edges is None
                and not blended
                and not instanced,
                "the depth test decides",
            ),
        ),
    }


def derive_alone(shader: str, material: Material, ambient: np.ndarray, shining: bool, bright: bool = False) -> Features:
    """Return the features of a single triangle or point with its own colors: preset `course`, no background.

    bright: whether colors beyond 1 are interpolated.
    """
    lit = shader != "nolight"
    values = {
        "PHONG": int(shader == "phong"),
        "CENTROID": 1,
        "VERTEX_COLORS": 1,
        "BRIGHT": int(bright and shader == "phong"),
        "SORTED": 1,
    }
    unneeded = _unneeded_terms([material], ambient, shader, lit and shining)
    values.update({name: int(not reason) for name, reason in unneeded.items()})
    return Features(tuple((name, values.get(name, 0)) for name in CHOICES + OPTIONAL))


def _choices(
    scene: Scene,
    settings: Settings,
    meshes: list[Mesh],
    *,
    culls: bool,
    at_corners: bool,
    own_corners: bool,
    relit: bool,
    instanced: bool,
) -> dict[str, bool]:
    """Return the values of CHOICES. at_corners: texture_at vertex. own_corners: whether corners have colors of their own
    for another reason. relit: whether lighting is forced on for shader nolight. instanced: as in `derive`."""
    return {
        "FAST": settings.precision == "fast",
        "DOUBLE": settings.precision == "float64",
        "SAMPLES": settings.samples > 1,
        "SAMPLE_SHADING": settings.samples > 1 and settings.sample_shading,
        "WEIGHTED": settings.samples > 1 and settings.resolve == "weighted",
        # Lighting that is forced on for nolight is done pixel by pixel.
        "PHONG": settings.shader == "phong" or (settings.shader == "nolight" and relit),
        "PBR": settings.shader == "pbr",
        "DEPTH_TEST": settings.visibility == "depth",
        "PERSPECTIVE": settings.interpolation == "perspective" and not scene.camera.orthographic,
        "CENTROID": settings.lighting_at == "centroid",
        "TINTED": settings.ambient == "tinted",
        "CULL": culls,
        "ORTHOGRAPHIC": scene.camera.orthographic,
        "CORNER_COLORS": at_corners or own_corners,
        # The error bound of phong and pbr is relative to the color at the pixel, that of the others to the brightest corner.
        "BRIGHT": settings.shader in ("phong", "pbr") and any(_any_beyond_one(mesh, at_corners) for mesh in meshes),
        "LINES": settings.edges is not None,
        "LINES_ONLY": settings.edges is not None and settings.edges.only,
        "BACKDROP": settings.background == "environment" and not no_environment(scene),
        "INSTANCES": instanced,
    }


def derive(
    scene: Scene,
    settings: Settings,
    *,
    double_positions: bool,
    scalars_at_corners: bool = False,
    instanced: bool = False,
    forced: Collection[str] = frozenset(),
) -> Features:
    """Return the features that this scene needs under these settings.

    double_positions: whether positions need float64. scalars_at_corners: whether the scalars that color faces differ
    between faces at a vertex.
    instanced: whether the scene's instances are drawn from one copy of each mesh.
    forced: OPTIONAL features to turn on even if the scene does not need them, to measure what leaving them out saves; the
    image stays the same, bit for bit. All of them together give a kernel for every scene.
    Raises InputError for another name.
    """
    unknown = sorted(set(forced) - set(OPTIONAL))
    if unknown:
        raise InputError(f"forced: expected names among {', '.join(OPTIONAL)}, found {unknown[0]}")
    lit = settings.shader != "nolight"
    materials = list(materials_of(scene).values())
    meshes = [mesh for mesh in scene.meshes if len(mesh.faces)]
    shining = lit and any(light.intensity.any() for light in scene.lights)
    shining = shining or shows_environment(scene, settings)
    at_corners = looked_up_at_corners(scene, settings)
    own_corners = scalars_at_corners and any(shows_scalars(mesh, settings) for mesh in meshes)
    culls, relit = _culls(materials, settings), "LIT" in forced
    corners = {"at_corners": at_corners, "own_corners": own_corners}
    choices = _choices(scene, settings, meshes, culls=culls, relit=relit, instanced=instanced, **corners)
    terms = _unneeded_terms(materials, scene.ambient, settings.shader, shining)
    terms["ENVIRONMENT"] = _first((settings.shader != "pbr", f"shader {settings.shader}")) or no_environment(scene)
    read = {name for name in ("DIFFUSE", "SPECULAR") if name in forced or not terms[name]}
    unread = (
        "" if read else _first((terms["DIFFUSE"] == terms["SPECULAR"], terms["DIFFUSE"]), (True, "kd and ks are 0"))
    )
    plain = all(is_plain(light) for light in scene.lights if light.intensity.any())
    sized = any(has_size(light) for light in scene.lights if light.intensity.any())
    unneeded_shadows = _first(
        (not settings.shadows, "no shadows asked for"),
        (bool(unread), unread),
        (not any(light.intensity.any() for light in scene.lights), "no light shines"),
        (not meshes, "no triangle"),
    )
    unneeded_occlusion = _first(
        (not settings.ambient_occlusion, "no ambient occlusion asked for"),
        (bool(terms["AMBIENT"] and terms["ENVIRONMENT"]), terms["AMBIENT"]),
        (not meshes, "no triangle"),
    )
    unneeded = {
        **terms,
        "LIGHT_SHAPES": unread or _first((plain, "only points without attenuation shine")),
        "AREA_LIGHTS": unread or _first((not sized, "no light has a size")),
        "SHADOWS": unneeded_shadows,
        "SHADOW_ALPHA": _first(
            (bool(unneeded_shadows and unneeded_occlusion), unneeded_shadows),
            (not casts_alpha(scene), "all that casts shadows is opaque"),
        ),
        "AMBIENT_OCCLUSION": unneeded_occlusion,
        **_unneeded_normals(scene, meshes, unread),
        **_unneeded_maps(meshes, settings.shader, terms),
        **_unneeded_colors(meshes, settings, **corners),
        **_unneeded_alpha(meshes),
    }
    blended = "BLEND" in forced or not unneeded["BLEND"]
    unneeded |= _unneeded_input(
        scene, settings, materials, double=double_positions, blended=blended, instanced=instanced
    )
    values = {name: int(choices[name]) for name in CHOICES}
    values.update({name: int(name in forced or not unneeded[name]) for name in OPTIONAL})
    left_out = tuple((name, unneeded[name]) for name in OPTIONAL if not values[name])
    return Features(tuple(values.items()), left_out)


def at_lanes(features: Features, own: int, chosen: int | None) -> Features:
    """Return the features for a device with its own number of lanes, and another one chosen for the pixels. Only with
    vectors do kernels set up faces in their order, and pixel stages order the lists of tiles themselves."""
    return features if min(own, chosen or own) > 1 else features.including("SORTED")


def uses_normal_indices(scene: Scene, mesh: Mesh) -> bool:
    """Return whether the mesh's own normals, indexed separately from its vertices, are used; course scenes always
    compute theirs."""
    return mesh.normals is not None and mesh.normal_faces is not None and scene.preset != "course"
