"""Features: derive from scene and settings what kernels leave out, at compile time or at run time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any, TypeAlias

import numpy as np

from ..scene.camera import Camera
from ..scene.lights import Light
from ..scene.material import MAPS, POWERED, TERMS
from ..scene.model import Material, Mesh, Scene, Settings
from ..scene.settings import Shader
from .shading_tables import map_of, textures_of, usable


def texture_applies(mesh: Mesh) -> bool:
    """Return whether the mesh has both a texture and texture coordinates."""
    return mesh.material.texture is not None and mesh.uvs is not None


MaterialKey: TypeAlias = tuple[int, bool, bool, bool, frozenset[str]]


def material_key(mesh: Mesh) -> MaterialKey:
    """Return a key; meshes with the same key share a row of the material table."""
    maps = frozenset(name for name in MAPS if mesh.material.pbr is not None and map_of(mesh, name) is not None)
    return id(mesh.material), texture_applies(mesh), mesh.blends, mesh.tests_alpha, maps


def materials_of(scene: Scene) -> dict[MaterialKey, Material]:
    """Return the rows of the material table by key, in the order of the meshes with faces; at least one."""
    table: dict[MaterialKey, Material] = {}
    for mesh in scene.meshes:
        key = material_key(mesh)
        if len(mesh.faces) and key not in table:
            table[key] = usable(mesh)
    return table or {(0, False, False, False, frozenset()): Material()}


def replaces_colors(mesh: Mesh) -> bool:
    """Return whether texels replace the mesh's vertex colors."""
    return texture_applies(mesh) and mesh.material.texture.lookup == "course"  # type: ignore[union-attr]


def ignored(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """Return what the scene's file or the settings ask for but no render shows, a few words each."""
    names = list(scene.ignored)
    if settings.texture_filter == "trilinear" and any(map(replaces_colors, scene.meshes)):
        names.append("the trilinear filter of textures with the course's lookup")
    looked_up = [texture for mesh in scene.meshes for texture in textures_of(mesh, maps=False)]
    if settings.texture_at == "vertex" and any(texture.filter == "nearest" for texture in looked_up):
        names.append("the filter nearest of textures that are looked up at vertices")
    if scene.environment is not None and settings.shader != "pbr" and settings.background != "environment":
        names.append("the environment, which only shader pbr shows")
    return tuple(names)


def no_environment(scene: Scene) -> str:
    """Return why no environment lights the scene, "" if one does."""
    environment = scene.environment
    if environment is None:
        return "no environment"
    return "" if environment.intensity and environment.image.any() else "it is black"


def casts_alpha(scene: Scene) -> bool:
    """Return whether some of what casts shadows may let light pass."""
    return any(mesh.blends or mesh.tests_alpha for mesh in scene.meshes if len(mesh.faces))


def looked_up_at_corners(scene: Scene, settings: Settings) -> bool:
    """Return whether textures are looked up at the corners of faces."""
    return settings.texture_at == "vertex" and any(texture_applies(mesh) for mesh in scene.meshes if len(mesh.faces))


def uses_normal_indices(scene: Scene, mesh: Mesh) -> bool:
    """Return whether the mesh's own normals, indexed separately from its vertices, are used; course scenes always
    compute theirs."""
    return mesh.normals is not None and mesh.normal_faces is not None and scene.preset != "course"


def _any_beyond_one(mesh: Mesh, at_corners: bool) -> bool:
    """Return whether colors beyond 1 may be interpolated. at_corners: texture_at vertex, where texels are interpolated
    too."""
    looked_up = at_corners and texture_applies(mesh)
    if mesh.colors is None and not looked_up:
        return False
    largest = np.abs(mesh.material.color)
    with np.errstate(over="ignore"):
        if mesh.colors is not None and not replaces_colors(mesh):
            largest = largest * np.maximum(mesh.colors.max(axis=0, initial=0.0), -mesh.colors.min(axis=0, initial=0.0))
        if looked_up:
            largest = largest * np.abs(mesh.material.texture.image[..., :3]).max(axis=(0, 1))  # type: ignore[union-attr]
    return bool((largest > 1.0).any())


def unless(needed: object, reason: str) -> str:
    """Return why something is not needed, "" if it is."""
    return "" if needed else reason


@dataclass(eq=False)
class Drawn:
    """What is drawn, as _REASONS and the choices ask about it. Texts say why something is not needed, "" if it is.

    shining: whether any light has an intensity other than 0. double_positions: whether positions need float64.
    scalars_at_corners: whether the scalars that color faces differ between faces at a vertex. instanced: whether instances
    are drawn from one copy of each mesh. forced: OPTIONAL features that are on even if the scene does not need them, to
    measure what leaving them out saves, with the same bits; all together give a kernel for every scene.
    """

    scene: Scene
    settings: Settings
    materials: Sequence[Material]
    shining: bool
    double_positions: bool = False
    scalars_at_corners: bool = False
    instanced: bool = False
    forced: Collection[str] = ()

    def __post_init__(self) -> None:
        scalars, self.shader = self.settings.scalars, self.settings.shader
        self._reasons: dict[str, str] = {}
        self.meshes = [mesh for mesh in self.scene.meshes if len(mesh.faces)]
        self.looked_up = [texture for mesh in self.meshes for texture in textures_of(mesh, maps=self.shader == "pbr")]
        self.at_corners = looked_up_at_corners(self.scene, self.settings)
        self.mapped = scalars is not None and any(scalars.name in mesh.scalars for mesh in self.meshes)
        self.own_corners = self.scalars_at_corners and self.mapped  # whether corners have colors for another reason
        self.culls = self.settings.cull or all(material.sides == "front" for material in self.materials)
        self.unlit = unless(self.shader != "nolight", "shader nolight")
        self.not_pbr = unless(self.shader == "pbr", f"shader {self.shader}")
        textured = any(mesh.material.texture is not None for mesh in self.meshes)
        applies = any(map(texture_applies, self.meshes))
        self.no_texture = unless(textured, "no texture") or unless(applies, "no texture coordinates")
        self.no_lookup = unless(self.looked_up, self.no_texture)

    def why(self, name: str) -> str:
        """Return why a feature is not needed."""
        if name not in self._reasons:
            self._reasons[name] = _REASONS[name](self)
        return self._reasons[name]

    def needs(self, name: str) -> bool:
        return name in self.forced or not self.why(name)

    def no_term(self, name: str) -> str:
        """Return why one of TERMS is not needed."""
        if self.shader == "pbr" and name not in _TERMS_OF_PBR:
            return "shader pbr"
        facets = [m.microfacets for m in self.materials if self.shader == "pbr"]
        if not facets:
            needed, why = any(getattr(m, name).any() for m in self.materials), f"{name} is 0"
        elif name == "ks":
            needed, why = any(f.metallic > 0.0 or f.specular > 0.0 for f in facets), "specular is 0"
        else:
            based = [f.metallic < 1.0 or f.metallic_roughness_texture is not None for f in facets]
            needed = any(b and m.diffuse.any() for b, m in zip(based, self.materials, strict=True))
            why = f"{name} is 0" if any(based) else "metals alone"
        return self.unlit or unless(self.shining, "no light shines") or unless(needed, why)

    def no_terms(self, names: Sequence[str]) -> str:
        """Return why none of several terms is needed."""
        reasons = {self.why(TERMS[name].feature) for name in names}
        zero = f"{', '.join(names[:-1])} and {names[-1]} are 0"
        return min(reasons) if len(reasons) == 1 else unless("" in reasons, zero)

    def no_power(self) -> str:
        if self.shader == "pbr":
            return "shader pbr"
        if absent := self.no_terms(POWERED):
            return f"no specular term: {absent}"
        used = any(m.n != 1.0 and any(getattr(m, name).any() for name in POWERED) for m in self.materials)
        return unless(used, "no exponent but 1")

    @cached_property
    def no_normals(self) -> str:
        """Why no normal is read."""
        names = _TERMS_OF_PBR if self.shader == "pbr" else list(TERMS)
        return "" if any(self.needs(TERMS[name].feature) for name in names) else self.no_terms(names)

    def no_light(self, has: Callable[[Light], bool], why: str) -> str:
        """Return why nothing is needed that only some lights have."""
        return self.no_normals or unless(any(has(light) for light in self.scene.lights if light.intensity.any()), why)

    def no_colors(self) -> str:
        if self.at_corners:
            return "texture_at vertex: they are in the corners' colors"
        if self.own_corners:
            return "they are in the corners' colors"
        colored = [mesh for mesh in self.meshes if mesh.colors is not None and (mesh.colors != 1.0).any()]
        white = all(map(replaces_colors, colored)) and all((mesh.material.color == 1.0).all() for mesh in self.meshes)
        if not white or not self.why("SCALARS"):
            return ""
        return "texels take the place of vertex colors" if colored else "no vertex or material colors other than white"

    def no_map(self, name: str) -> str:
        """Return why one of MAPS is not needed."""
        reasons = [self.why(feature) for feature in MAPS[name].changes]
        present = any(map_of(mesh, name) is not None for mesh in self.meshes)
        return self.not_pbr or (reasons[-1] if all(reasons) else unless(present, f"no {MAPS[name].words}"))


_TERMS_OF_PBR = ["kd", "ks"]  # that shader pbr has, too

# Features that are choices of the settings or the camera, where 0 and 1 mean different images: whether they hold.
_CHOICES: dict[str, Callable[[Drawn], bool]] = {
    "DOUBLE": lambda d: d.settings.precision == "float64",
    "SAMPLES": lambda d: d.settings.samples > 1,
    # Lighting that is forced on for nolight is done pixel by pixel.
    "PHONG": lambda d: d.shader == "phong" or ("LIT" in d.forced and bool(d.unlit)),
    "PBR": lambda d: d.shader == "pbr",
    "DEPTH_TEST": lambda d: d.settings.visibility == "depth",
    "INSTANCES": lambda d: d.instanced,  # the same image, from one copy of each mesh: see triangle_source.py
    "CASTERS": lambda d: d.needs("SHADOWS") or d.needs("AMBIENT_OCCLUSION"),  # whether rays are followed to them
    "SAMPLE_SHADING": lambda d: d.settings.samples > 1 and d.settings.sample_shading,
    "WEIGHTED": lambda d: d.settings.samples > 1 and d.settings.resolve == "weighted",
    "PERSPECTIVE": lambda d: d.settings.interpolation == "perspective" and not d.scene.camera.orthographic,
    "CENTROID": lambda d: d.settings.lighting_at == "centroid",
    "TINTED": lambda d: d.settings.ambient == "tinted",
    "CULL": lambda d: d.culls,
    "ORTHOGRAPHIC": lambda d: d.scene.camera.orthographic,
    "CORNER_COLORS": lambda d: d.at_corners or d.own_corners,
    # The error bound of phong and pbr is relative to the color at the pixel, that of the others to the brightest corner.
    "BRIGHT": lambda d: d.shader in ("phong", "pbr") and any(_any_beyond_one(m, d.at_corners) for m in d.meshes),
    "LINES": lambda d: d.settings.edges is not None,
    "LINES_ONLY": lambda d: d.settings.edges is not None and d.settings.edges.only,
    "BACKDROP": lambda d: d.settings.background == "environment" and not no_environment(d.scene),
}

# The others, which a frame may do without: what is then left out, in a few words. 1 is always correct, with the same bits.
WORK = {
    "LIT": "lighting",
    "AMBIENT": "ambient light",
    **{term.feature: term.work for term in TERMS.values()},
    "POWER": "power of highlights",
    "EMISSION": "emission",
    "ENVIRONMENT": "image-based light",
    "LIGHT_SHAPES": "directions, cones and attenuation of lights",
    "AREA_LIGHTS": "points of lights of finite size",
    "SHADOWS": "shadows",
    "SHADOW_ALPHA": "shadows of what is not opaque",
    "AMBIENT_OCCLUSION": "ambient occlusion",
    "TWO_SIDED": "normals turned to the side seen",
    "NORMAL_INDICES": "indices of normals",
    "VERTEX_COLORS": "colors of vertices",
    "SCALARS": "color map",
    "TEXTURED": "texture lookups",
    "UV_INDICES": "indices of texture coordinates",
    "MIPMAPS": "mip-map levels",
    "ALPHA_TEST": "alpha test",
    "NEAREST": "nearest texels",
    **{f"{each.name}_MAP": f"{each.words}s" for each in MAPS.values()},
    "UV_SETS": "further texture coordinates",
    "BLEND": "transparent surfaces, in exact order",
    "VERTEX_ALPHA": "alpha at vertices",
    "MATERIALS": "material per face",
    "SIDES": "side of each material that is drawn",
    "DOUBLE_POSITIONS": "positions in float64",
    "BACKGROUND": "color of the background",
    "OWNERS": "owner of each pixel",
    "SORTED": "depth sort",
}

# Why what is drawn does without an optional feature, "" if it needs it.
_REASONS: dict[str, Callable[[Drawn], str]] = {
    "LIT": lambda d: d.unlit,
    "AMBIENT": lambda d: (
        d.unlit
        or unless(d.scene.ambient.any(), "no ambient light")
        or unless(any(m.ka.any() for m in d.materials), "ka is 0")
        or unless(any((m.ka * d.scene.ambient).any() for m in d.materials), "ka*Ia is 0")
    ),
    **{term.feature: partial(Drawn.no_term, name=name) for name, term in TERMS.items()},
    "POWER": Drawn.no_power,
    "EMISSION": lambda d: d.not_pbr or unless(any(m.microfacets.emission.any() for m in d.materials), "emission is 0"),
    "ENVIRONMENT": lambda d: d.not_pbr or no_environment(d.scene),
    "LIGHT_SHAPES": lambda d: d.no_light(lambda each: not each.is_plain, "only points without attenuation shine"),
    "AREA_LIGHTS": lambda d: d.no_light(lambda each: each.has_size, "no light has a size"),
    "SHADOWS": lambda d: (
        unless(d.settings.shadows, "no shadows asked for")
        or d.no_light(lambda each: True, "no light shines")
        or unless(d.meshes, "no triangle")
    ),
    "SHADOW_ALPHA": lambda d: (
        (d.why("AMBIENT_OCCLUSION") and d.why("SHADOWS"))
        or unless(casts_alpha(d.scene), "all that casts shadows is opaque")
    ),
    "AMBIENT_OCCLUSION": lambda d: (
        unless(d.settings.ambient_occlusion, "no ambient occlusion asked for")
        or (d.why("ENVIRONMENT") and d.why("AMBIENT"))
        or unless(d.meshes, "no triangle")
    ),
    "TWO_SIDED": lambda d: d.no_normals or unless(any(m.material.two_sided for m in d.meshes), "no two-sided material"),
    "NORMAL_INDICES": lambda d: (
        d.no_normals or unless(any(uses_normal_indices(d.scene, m) for m in d.meshes), "a normal per vertex")
    ),
    "VERTEX_COLORS": Drawn.no_colors,
    "SCALARS": lambda d: (
        unless(d.settings.scalars is not None, "no scalars asked for") or unless(d.mapped, "no face has the scalars")
    ),
    "TEXTURED": lambda d: unless(not d.at_corners, "texture_at vertex: looked up at the corners") or d.no_texture,
    "UV_INDICES": lambda d: (
        d.no_lookup or unless(any(m.uv_faces is not None for m in d.meshes), "texture coordinates per vertex")
    ),
    "MIPMAPS": lambda d: (
        d.no_lookup
        or unless(d.settings.texture_filter != "bilinear", "texture_filter bilinear")
        or unless(
            any(t.lookup == "standard" and max(t.texels.shape[:2]) > 1 for t in d.looked_up),
            "textures of one texel or with the course's lookup",
        )
    ),
    "ALPHA_TEST": lambda d: unless(any(m.tests_alpha for m in d.meshes), "no alpha test"),
    "NEAREST": lambda d: (
        d.no_lookup or unless(any(t.filter == "nearest" for t in d.looked_up), "no texture with the filter nearest")
    ),
    **{f"{each.name}_MAP": partial(Drawn.no_map, name=name) for name, each in MAPS.items()},
    "UV_SETS": lambda d: d.no_lookup or unless(any(t.coordinates for t in d.looked_up), "one set of coordinates"),
    "BLEND": lambda d: unless(any(m.blends for m in d.meshes), "nothing is transparent"),
    "VERTEX_ALPHA": lambda d: unless(
        any(m.alphas is not None and (m.blends or m.tests_alpha) for m in d.meshes), "no alpha at vertices counts"
    ),
    "MATERIALS": lambda d: unless(len(d.materials) > 1, "a single material"),
    "SIDES": lambda d: (
        unless(not d.culls, "all that is seen from behind is culled")
        or unless(any(m.sides == "front" for m in d.materials), "both sides of every material are drawn")
    ),
    "DOUBLE_POSITIONS": lambda d: (
        unless(not d.instanced, "instances are placed where they are needed")
        or unless(d.double_positions, "float32 holds the positions")
    ),
    "BACKGROUND": lambda d: (
        unless(d.scene.background is not None, "no background")
        or unless(d.settings.background != "environment", "the environment is the background")
        or unless(np.any(d.scene.background), "the background is black")
    ),
    "OWNERS": lambda d: unless(d.settings.layers, "no layer asked for"),
    # Gouraud's shading lights the corners of the sorted triangles; kernels of 16 doubles do not order lists; lines need the
    # clipped triangles before the pixel stage; lists of transparent triangles and of instances are sorted.
    "SORTED": lambda d: unless(
        d.settings.visibility != "depth"
        or d.shader == "gouraud"
        or d.settings.precision == "float64"
        or d.settings.edges is not None
        or d.needs("BLEND")
        or d.instanced,
        "the depth test decides",
    ),
}
FEATURES, OPTIONAL = (*_CHOICES, *WORK), tuple(WORK)
# Those of which there are programs with and without: leaving them out saves 5 % of some scene's frame.
# The others are conditions at run time (`NEEDS` in kernels/features.clh), or follow from tables.
COMPILED = ("DOUBLE", "SAMPLES", "PHONG", "PBR", "DEPTH_TEST", "INSTANCES", "CASTERS")
_BITS = {name: index for index, name in enumerate(name for name in FEATURES if name not in COMPILED)}
_RARE = (
    *("WEIGHTED", "CENTROID", "ORTHOGRAPHIC", "CORNER_COLORS", "BRIGHT", "LINES", "LINES_ONLY"),
    *("BACKDROP", "LIGHT_SHAPES", "AREA_LIGHTS", "SHADOWS", "SHADOW_ALPHA", "AMBIENT_OCCLUSION"),
    *("SCALARS", "ALPHA_TEST", "NEAREST", "UV_SETS", "BLEND", "VERTEX_ALPHA", "OWNERS", "SORTED"),
)
# What a first picture's program has besides what its scene needs: few instructions, and most scenes after it need no other.
COMMON = sum(1 << bit for name, bit in _BITS.items() if name not in _RARE)
# Of features in a row; kernels ask for one or any of them.
GROUPS = {"TERMS": [term.feature for term in TERMS.values()], "MAPS": [f"{each.name}_MAP" for each in MAPS.values()]}


def bit_definitions() -> str:
    """Return OpenCL C that numbers the features that are conditions at run time, for `NEEDS` and `NEEDS_ANY`."""
    lines = [f"#define BIT_{name} {index}\n" for name, index in _BITS.items()]
    for name, group in GROUPS.items():
        bits = [_BITS[feature] for feature in group]
        lines.append(f"#define FIRST_BIT_{name} {bits[0]}\n#define BITS_{name} {sum(1 << bit for bit in bits)}UL\n")
    return "".join(lines)


@dataclass(frozen=True)
class Features:
    """The features that a frame uses, in the order of FEATURES, and why each optional one of the others is left out."""

    used: tuple[str, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, names: Collection[str] = (), left_out: tuple[tuple[str, str], ...] = ()) -> Features:
        return cls(tuple(name for name in FEATURES if name in names), left_out)

    @cached_property
    def _values(self) -> dict[str, int]:
        return {name: int(name in self.used) for name in FEATURES}

    def __getitem__(self, name: str) -> int:
        return self._values[name]

    @cached_property
    def needs(self) -> int:
        """The member `needs` of structs.Image and structs.View."""
        return sum(1 << bit for name, bit in _BITS.items() if self[name])

    def compiled(self, names: Collection[str] = COMPILED) -> Features:
        """Return what a program is compiled with, of which it reads `names`: all that is a condition at run time is 0."""
        return Features.of({*self.used} & {*COMPILED} & {*names})

    def including(self, name: str) -> Features:
        """Return the features with an optional one that is not left out."""
        return Features.of({*self.used, name}, tuple(reason for reason in self.left_out if reason[0] != name))

    def needs_any(self, group: str) -> bool:
        """Return whether any feature of one of GROUPS is needed."""
        return any(self[name] for name in GROUPS[group])

    def options(self, needs: int = -1) -> list[str]:
        """Return -D options of the OpenCL build. needs: the conditions at run time that are compiled in."""
        left_out = sum(1 << bit for bit in _BITS.values()) & ~needs
        return [*(f"-D{name}={self[name]}" for name in COMPILED), f"-DLEFT_OUT={left_out}UL"]


def needs(word: int, name: str) -> bool:
    """Return whether a member `needs` has a feature's bit."""
    return bool(int(word) >> _BITS[name] & 1)


def looks_up(features: Features) -> bool:
    """Return whether textures are looked up at the pixels."""
    return features.needs_any("MAPS") or any(features[name] for name in ("TEXTURED", "ALPHA_TEST", "BLEND"))


_settings = cache(lambda shader: Settings(shader=shader))
_NOTHING = Scene((), Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, (1.0, 1.0)), ambient=1.0)


def derive_alone(shader: Shader, material: Material, shining: bool, bright: bool = False) -> Features:
    """Return the features of a single triangle or point with its own colors: preset `course`, no background, ambient light
    in its material. bright: whether colors beyond 1 are interpolated."""
    frame = Drawn(_NOTHING, _settings(shader), [material], shining)
    terms = ("LIT", "AMBIENT", *GROUPS["TERMS"], "POWER", "EMISSION")
    names = [name for name in terms if frame.needs(name)] + ["CENTROID", "VERTEX_COLORS", "SORTED"]
    return Features.of(names + ["PHONG"] * (shader == "phong") + ["BRIGHT"] * (shader == "phong" and bright))


def derive(scene: Scene, settings: Settings, **how: Any) -> Features:
    """Return the features that this scene needs under these settings. how: further fields of `Drawn`."""
    lit_around = settings.shader == "pbr" and not no_environment(scene)
    shining = lit_around or any(light.intensity.any() for light in scene.lights)
    frame = Drawn(scene, settings, list(materials_of(scene).values()), shining, **how)
    chosen = {name for name, holds in _CHOICES.items() if holds(frame)}
    needed = {name for name in OPTIONAL if frame.needs(name)}
    return Features.of(chosen | needed, tuple((name, frame.why(name)) for name in OPTIONAL if name not in needed))


def at_lanes(features: Features, device_lanes: int, chosen: int | None) -> Features:
    """Return the features for a device with its own number of lanes, and another one chosen for the pixels. Only kernels of
    several lanes set up faces in their order and order the lists of tiles themselves."""
    return features if min(device_lanes, chosen or device_lanes) > 1 else features.including("SORTED")
