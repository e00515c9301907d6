"""Random scenes, each determined by its number: odd sizes, all settings, degenerate geometry, extreme values.

Building a kernel program takes seconds. So all that determines the program is a `Kind`, shared by the scenes of a
block; everything else differs from scene to scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.declare import declared
from ...scene.camera import Camera
from ...scene.edges import EDGE_KINDS, MAX_WIDTH, Edges
from ...scene.material import TERMS
from ...scene.model import WRAPS, Light, Lookup, Material, Mesh, PointLight, Scene, Settings, Texture, with_materials
from ...scene.settings import MAX_SAMPLES, PRESET_FIELDS, Preset
from .random_coincidences import aligned, coincident
from .random_environments import random_environment
from .random_extremes import stiffened
from .random_facets import with_facets
from .random_lights import replaced
from .random_maps import with_maps, with_nearest
from .random_scalars import random_map, random_scalars
from .random_shapes import SHAPES, Random, Shape, blob, triangles

BLOCK = 50  # consecutive scenes of one kind
LANES = (1, 4, 8, 16)  # pixels per vector; the last is a CPU's default
KINDS = 80  # number of kinds; then they repeat


@dataclass(frozen=True)
class Kind:
    """All that determines the kernel program.

    settings: fields of Settings. The flags are the features of the kind's scenes: if one is set, their first mesh or
    light has the feature; otherwise none has.

    specialize: whether the program leaves out unneeded features; only then the flags after it apply. Otherwise all
    optional features are compiled in, and scenes have them or not. lanes: pixels per vector on a CPU; None: the
    device's default. other_lanes: another number, for scenes that are drawn again to compare the bits. sampled: whether
    pixels have several samples. bright: whether colors exceed 1; with shader phong they otherwise do not.
    scalars: whether a color map shows scalars of one more mesh, of its "vertices" or of its faces' "corners".
    nearest: whether the first texture has that filter. maps: whether the shader is pbr, with maps. around:
    whether it is pbr, in an environment. shaped: whether lights have directions, cones or attenuation.
    transparent: whether materials blend, with alphas at vertices. facets: whether the shader is pbr, with parameters of its
    own rather than those that follow from Phong's.
    transparent: whether materials blend, with alphas at vertices. backdrop: whether an environment is the background.
    shadowed: whether lights reach only what no triangle hides. occluded: whether triangles nearby keep ambient light away.
    terms: of Phong's model that are not in every scene, by their coefficients.
    """

    settings: Settings
    preset: Preset
    front: bool
    two_sided: bool
    textured: bool
    alpha: bool
    normal_faces: bool
    uv_faces: bool
    orthographic: bool
    background: bool
    double: bool
    specialize: bool
    ambient: bool
    diffuse: bool
    specular: bool
    power: bool
    colored: bool
    several: bool
    lanes: int | None
    sampled: bool
    other_lanes: int = 1
    bright: bool = False
    scalars: str = ""
    lines: bool = False
    around: bool = False
    nearest: bool = False
    maps: bool = False
    shaped: bool = False
    transparent: bool = False
    facets: bool = False
    backdrop: bool = False
    shadowed: bool = False
    sized: bool = False
    occluded: bool = False
    terms: tuple[str, ...] = ()

    @property
    def dim(self) -> bool:
        """Whether no color may exceed 1."""
        return self.settings.shader in ("phong", "pbr") and not self.bright


@dataclass(frozen=True)
class RandomScene:
    """One random scene and how to draw it. again: also draw it with `kind.other_lanes` and compare all bits."""

    number: int
    kind: Kind
    scene: Scene
    settings: Settings
    again: bool


def kind_of(seed: int, block: int) -> Kind:
    """Return the kind of a block of scenes."""
    rng = np.random.default_rng([seed, block % KINDS, 0])

    def often(share: float) -> bool:
        return bool(rng.random() < share)

    fields: dict[str, Any] = {"shader": str(rng.choice(("phong", "phong", "gouraud", "nolight")))}
    base: Preset = "standard"
    kind_of_settings = str(rng.choice(("standard", "course", "mixed")))
    if kind_of_settings == "course":
        base = "course"
    elif kind_of_settings == "mixed":
        choices = {name: known.choices for name, known in declared(Settings).items() if name in PRESET_FIELDS["course"]}
        fields.update({name: str(rng.choice(values)) for name, values in choices.items()})
    settings = Settings.from_preset(base, layers="all", cull=often(0.15), **fields)
    preset: Preset = "course" if often(0.3) else "standard"
    lit, textured, specialize = settings.shader != "nolight", often(0.6), often(0.3)
    several = not specialize or often(0.6)
    kind = Kind(
        settings=settings,
        preset=preset,
        front=several and not settings.cull and often(0.25),
        two_sided=lit and often(0.4),
        textured=textured,
        alpha=textured and often(0.4),
        normal_faces=lit and preset == "standard" and often(0.3),
        uv_faces=textured and often(0.4),
        orthographic=often(0.25),
        background=often(0.7),
        double=often(0.7),
        specialize=specialize,
        ambient=often(0.7),
        diffuse=often(0.7),
        specular=often(0.7),
        power=often(0.7),
        colored=often(0.7),
        several=several,
        lanes=int(rng.choice((1, 4, 8))) if often(0.25) else None,
        sampled=often(0.3),
    )
    finer: dict[str, Any] = {"precision": "float64" if often(0.15) else "float32"}
    if kind.sampled:
        finer |= {"samples": 2, "sample_shading": often(0.3), "resolve": "weighted" if often(0.3) else "mean"}
    if textured and settings.texture_at == "pixel" and often(0.4):
        finer["texture_filter"] = "trilinear"
    # Further draws come last, so that numbers keep their meaning. fast has no bound for texture coordinates of any
    # size, see `oracle_bounds.allowed`.
    if often(0.3) and finer["precision"] == "float32" and not textured:
        finer["precision"] = "fast"
    other = int(rng.choice([lanes for lanes in LANES if lanes != (kind.lanes or LANES[-1])]))
    bright = kind.colored and often(0.5)
    scalars = str(rng.choice(("", "", "", "vertices", "corners")))
    if scalars:
        finer |= {"scalars": "data", "layers": "all"}
    kind = replace(kind, settings=replace(settings, **finer), other_lanes=other, bright=bright, scalars=scalars)
    if often(0.15):
        only = often(0.3)
        lined = replace(kind.settings, edges=Edges("all", only=only))
        kind = replace(kind, settings=lined, lines=True, background=kind.background or only)
    nearest = textured and often(0.3)
    maps = textured and settings.shader == "phong" and often(0.3)
    around = settings.shader == "phong" and often(0.2)
    if maps or around:
        kind = replace(kind, settings=replace(kind.settings, shader="pbr"), maps=maps, around=around)
    kind = replace(kind, nearest=nearest, shaped=lit and often(0.4))
    kind = replace(kind, transparent=often(0.3))
    if kind.settings.shader in ("phong", "pbr") and often(0.3):
        kind = replace(kind, settings=replace(kind.settings, shader="pbr"), facets=True)
    if often(0.15):
        shown = replace(kind.settings, background="environment")
        kind = replace(kind, settings=shown, backdrop=True, background=False)
    if lit and often(0.3):
        kind = replace(kind, settings=replace(kind.settings, shadows=True), shadowed=True)
    if lit and often(0.2):
        points = replace(kind.settings, light_samples=int(rng.choice((1, 2, 3, 5, 16))))
        kind = replace(kind, settings=points, sized=True)
    if lit and often(0.2):
        rays = replace(kind.settings, ambient_occlusion=int(rng.choice((1, 2, 3, 5))))
        kind = replace(kind, settings=rays, occluded=True)
    return replace(kind, terms=tuple(name for name in list(TERMS)[2:] if lit and often(0.3)))


def scene_of(number: int, seed: int = 0) -> RandomScene:
    """Return scene `number`; determined by number and seed."""
    kind = kind_of(seed, number // BLOCK)
    rng = np.random.default_rng([seed, number, 1])
    if not kind.specialize:  # the scene has optional features or not
        terms: dict[str, Any] = {
            name: bool(rng.random() < 0.8) for name in ("ambient", "diffuse", "specular", "power", "colored")
        }
        kind = replace(kind, **terms, several=True)
    camera, coincides = _camera(rng, kind), number % 4 == 3
    camera = aligned(camera) if coincides else camera
    materials = [_material(rng, kind, all_of_it=True)]
    if kind.several:
        materials += [_material(rng, kind) for _ in range(rng.integers(1, 4))]
        if kind.front:
            materials[1] = replace(materials[1], sides="both")
    meshes = [_mesh(rng, kind, materials[0], triangles(rng, 1), all_of_it=True)]
    for k in range(rng.integers(kind.several, 5)):
        # The second material's mesh needs faces: with a single material in use the program would differ.
        material = materials[1] if k == 0 and kind.several else materials[rng.integers(len(materials))]
        shape = blob if k == 0 else SHAPES[rng.integers(len(SHAPES))]
        meshes.append(_mesh(rng, kind, material, shape(rng, camera)))
    scale, shift = _extremes(rng, kind)
    scale, shift = (1.0, np.zeros(3)) if coincides else (scale, shift)
    points = [replace(light, position=light.position * scale + shift) for light in _lights(rng, kind, meshes)]
    lights: tuple[Light, ...] = tuple(points)
    for asked, stream in ((kind.shaped, 5), (kind.sized, 9)):
        if asked:
            own, center = np.random.default_rng([seed, number, stream]), camera.lookat * scale + shift
            lights = replaced(own, lights, points, stream == 9, scale, center)
    scene = Scene(
        tuple(_moved_mesh(mesh, scale, shift, kind.double) for mesh in meshes),
        replace(
            camera,
            eye=camera.eye * scale + shift,
            lookat=camera.lookat * scale + shift,
            plane=tuple((scale if kind.orthographic else 1.0) * np.array(camera.plane)),
        ),
        lights,
        rng.uniform(0.05, 1.0, 3) if kind.ambient else np.zeros(3),
        rng.choice((0.1, 1.0, 1e4)) * rng.uniform(0.1, 1.0, 3) if kind.background else _nothing(rng),
        kind.preset,
        f"fuzz {seed}/{number}",
    )
    near = None if rng.random() < 0.75 else scale * 10.0 ** rng.uniform(-6, 0.5)
    samples = int(rng.integers(2, 17)) if kind.sampled else 1
    if kind.sampled and rng.random() < 0.05:
        samples = int(rng.integers(17, MAX_SAMPLES + 1))
    if number % 2 == 0:
        scene = stiffened(np.random.default_rng([seed, number, 2]), scene, kind.double, kind.dim)
    if coincides:
        scene = coincident(np.random.default_rng([seed, number, 12]), scene)
    settings = replace(kind.settings, near=near, samples=samples)
    if kind.scalars:
        own = np.random.default_rng([seed, number, 3])
        mesh = _mesh(own, kind, materials[own.integers(len(materials))], blob(own, camera))
        mesh = replace(
            _moved_mesh(mesh, scale, shift, kind.double), scalars={"data": random_scalars(own, kind.scalars, mesh)}
        )
        scene = replace(scene, meshes=(*scene.meshes, mesh))
        settings = replace(settings, scalars=random_map(own, kind.scalars, mesh.scalars["data"]))
    if kind.nearest:
        scene = with_nearest(np.random.default_rng([seed, number, 5]), scene)
    if kind.maps:
        scene = with_maps(np.random.default_rng([seed, number, 6]), scene, kind.nearest)
    if kind.terms:
        scene = _with_terms(np.random.default_rng([seed, number, 11]), scene, kind.terms)
    if kind.facets:
        scene = with_facets(np.random.default_rng([seed, number, 8]), scene)
    if kind.around or kind.backdrop:
        scene = replace(scene, environment=random_environment(np.random.default_rng([seed, number, 7])))
    if kind.occluded:
        own = np.random.default_rng([seed, number, 10])
        distance = None if own.random() < 0.5 else scale * 10.0 ** own.uniform(-3, 3)
        settings = replace(settings, ao_distance=distance)
    if kind.lines:
        settings = replace(settings, edges=_edges(np.random.default_rng([seed, number, 4]), kind))
    return RandomScene(number, kind, scene, settings, again=number % 8 in (0, 1, 6, 7))  # half of each sort


def _edges(rng: Random, kind: Kind) -> Edges:
    """Return edges of some kinds, drawn with any width."""
    count = rng.integers(1, 4) if rng.random() < 0.7 else 0
    kinds = tuple(EDGE_KINDS[k] for k in rng.integers(0, len(EDGE_KINDS), count)) or ("all",)
    width = 10.0 ** rng.uniform(-1.5, 0.8) if rng.random() < 0.8 else rng.uniform(5.0, MAX_WIDTH)
    color = tuple((1.0 if kind.dim else 10.0) * rng.uniform(0.0, 1.0, 3))
    only = kind.settings.edges is not None and kind.settings.edges.only
    return Edges(kinds, float(rng.uniform(0.0, 180.0)), float(width), color, only=only)


def _nothing(rng: Random) -> Any:
    return None if rng.random() < 0.5 else np.zeros(3)


def _extremes(rng: Random, kind: Kind) -> tuple[float, Array]:
    """Return the scale and the translation of the scene."""
    scale, shift = 1.0, np.zeros(3)
    if rng.random() < 0.2:
        scale = 10.0 ** rng.uniform(-20, 20)
    if rng.random() < 0.2:
        shift = scale * 10.0 ** rng.uniform(0, 9 if kind.double else 3) * rng.normal(size=3)
    return scale, shift


# Camera and lights


def _size(rng: Random, most: int) -> int:
    """Return a number of columns or rows: any, or one near a multiple of the tile size."""
    if rng.random() < 0.3:
        return int(min(most, rng.choice((1, 2, 15, 16, 17, 31, 32, 33, 48, 49))))
    return int(rng.integers(1, most + 1))


def _camera(rng: Random, kind: Kind) -> Camera:
    columns, rows = _size(rng, 80), _size(rng, 60)
    eye = rng.normal(size=3)
    eye *= rng.uniform(2.0, 6.0) / np.linalg.norm(eye)
    up = rng.normal(size=3)
    if rng.random() < 0.3:  # axis-aligned: many exact values
        eye, up = np.array([0.0, 0.0, 4.0]), np.array([0.0, 1.0, 0.0])
    lookat = np.zeros(3) if rng.random() < 0.5 else 0.3 * rng.normal(size=3)
    height = rng.uniform(2.0, 5.0) if kind.orthographic else 1.0
    if rng.random() < 0.1:
        height *= 10.0 ** rng.uniform(-2, 2)
    width = height * columns / rows if rng.random() < 0.6 else height * rng.uniform(0.5, 2.0)
    principal = (0.5, 0.5) if rng.random() < 0.7 else tuple(rng.uniform(-0.3, 1.3, 2))
    return Camera(
        eye, lookat, up, rng.uniform(0.6, 2.5), (height, width), (columns, rows), principal, kind.orthographic
    )


def _lights(rng: Random, kind: Kind, meshes: list[Mesh]) -> list[PointLight]:
    """Return zero to five lights. The first is not black if the kind needs one."""
    found = []
    for _ in range(rng.integers(0, 6)):
        position = 3.0 * rng.normal(size=3)
        where = rng.random()
        if where < 0.1:
            position *= 10.0 ** rng.uniform(0, 9)
        elif where < 0.2:
            verts = meshes[rng.integers(len(meshes))].verts
            position = verts[rng.integers(len(verts))].astype(np.float64) if len(verts) else position
        elif where < 0.25:
            position = np.zeros(3)
        intensity = rng.uniform(0, 2, 3)
        how = rng.random()
        if how < 0.15:
            intensity *= 10.0 ** rng.uniform(-30, 30)
        elif how < 0.25:
            intensity[rng.random(3) < 0.6] = 0.0
        elif how < 0.3:
            intensity *= -1.0
        found.append(PointLight(position, intensity))
    if kind.specialize or kind.two_sided or kind.normal_faces:
        found.insert(0, PointLight(3.0 * rng.normal(size=3), rng.uniform(0.1, 1.0, 3)))
    return found


# Materials


def _coefficient(rng: Random, present: bool, needed: bool = False) -> Any:
    if not present or (not needed and rng.random() < 0.1):
        return 0.0
    value = rng.uniform(0.05, 1.0, 3) if rng.random() < 0.5 else rng.uniform(0.05, 1.0)
    return value * (rng.choice((1e-3, 5.0)) if rng.random() < 0.1 else 1.0)


def _with_terms(rng: Random, scene: Scene, names: tuple[str, ...]) -> Scene:
    """Return the scene with further coefficients of all materials; those of the first are not 0."""
    first = scene.meshes[0].material

    def changed(material: Material) -> Material:
        return replace(material, **{name: _coefficient(rng, True, material is first) for name in names})

    return with_materials(scene, changed)


def _exponent(rng: Random, kind: Kind, needed: bool) -> float:
    if not kind.power:
        return 1.0
    known = (2.0, 20.0, 200.0, 1e4, 1e9) if needed else (0.0, 0.5, 1.0, 2.0, 20.0, 200.0, 1e4, 1e9)
    return float(rng.choice(known)) if rng.random() < 0.6 else float(10.0 ** rng.uniform(0.1, 9))


def _texture(rng: Random, kind: Kind, all_of_it: bool) -> Texture:
    height, width = (int(size) for size in rng.choice((1, 1, 2, 3, 4, 5, 7, 16, 33), 2))
    if all_of_it and kind.settings.texture_filter == "trilinear":
        width = max(width, 2)  # a single texel needs no mipmap levels
    channels = 4 if kind.alpha and (all_of_it or rng.random() < 0.5) else 3
    image: Array = rng.uniform(0, 1, (height, width, channels)).astype(np.float32)
    if rng.random() < 0.3:
        image = (image * 255).astype(np.uint8)
    elif rng.random() < 0.2 and not kind.dim:
        image[..., :3] *= 20.0
    wraps = (WRAPS[rng.choice(len(WRAPS))], WRAPS[rng.choice(len(WRAPS))])
    lookup: Lookup = "course" if not all_of_it and rng.random() < 0.3 else "standard"
    return Texture(image, wraps, lookup)


def _material(rng: Random, kind: Kind, all_of_it: bool = False) -> Material:
    """Return a material. all_of_it: with every feature of the kind."""
    textured = kind.textured and (all_of_it or rng.random() < 0.6)
    tinted = kind.colored and (all_of_it or rng.random() < 0.4)
    return Material(
        ka=_coefficient(rng, kind.ambient, all_of_it),
        kd=_coefficient(rng, kind.diffuse, all_of_it),
        ks=_coefficient(rng, kind.specular, all_of_it),
        n=_exponent(rng, kind, all_of_it),
        texture=_texture(rng, kind, all_of_it) if textured else None,
        color=np.minimum(rng.uniform(0.1, 1.5, 3), 1.0 if kind.dim else np.inf) if tinted else 1.0,
        sides="front" if (kind.front and all_of_it) or (kind.front and rng.random() < 0.3) else "both",
        two_sided=kind.two_sided and (all_of_it or rng.random() < 0.5),
        alpha_cutoff=rng.uniform(0.1, 0.9) if kind.alpha and (all_of_it or rng.random() < 0.6) else None,
        blend=kind.transparent and (all_of_it or rng.random() < 0.6),
        opacity=float(rng.choice((1.0, 0.5, 0.25, 1e-7, rng.uniform(0.1, 1)))) if kind.transparent else 1.0,
    )


# Meshes


def _directions(rng: Random, count: int) -> Array:
    normals = rng.normal(size=(count, 3))
    if rng.random() < 0.3:
        normals *= 10.0 ** rng.uniform(-20, 20, (count, 1))
    if rng.random() < 0.3:
        normals[rng.random(count) < 0.2] = 0.0
    return normals


def _coordinates(rng: Random, count: int) -> Array:
    """Return texture coordinates in [0, 1] and beyond; or all equal, with any value."""
    uvs = rng.uniform(-1.5, 2.5, (count, 2)) if rng.random() < 0.6 else rng.uniform(0, 1, (count, 2))
    if rng.random() < 0.1:
        uvs *= 10.0 ** rng.uniform(0, 4)
    elif rng.random() < 0.1:
        uvs[:] = rng.choice((0.0, -0.0, 1.0, 1e30, np.nan, np.inf, -np.inf), 2)
    return uvs


def _placements(rng: Random, double: bool) -> Array | None:
    """Return one to three placements; without `double`, only those that map float32 values to float32 values."""
    if rng.random() < 0.6:
        return None
    found = []
    for _ in range(rng.integers(1, 4)):
        matrix = np.eye(4)
        if double:
            turn, _r = np.linalg.qr(rng.normal(size=(3, 3)))
            matrix[:3, :3] = turn * rng.uniform(0.3, 1.5, 3)
            matrix[:3, 3] = rng.normal(size=3)
        else:
            matrix[:3, :3] = np.diag(rng.choice((-1.0, 1.0), 3))[rng.permutation(3)]
        if rng.random() < 0.1:
            matrix[:3, rng.integers(3)] = 0.0  # flattened
        found.append(matrix)
    return np.array(found)


def _mesh(rng: Random, kind: Kind, material: Material, shape: Shape, all_of_it: bool = False) -> Mesh:
    verts, faces = shape
    fields: dict[str, Any] = {}
    if kind.colored and rng.random() < 0.7:
        most = rng.choice((1.0, 1.0, 1.0, 10.0))
        fields["colors"] = (1.0 if kind.dim else most) * rng.uniform(0, 1, (len(verts), 3))
    if kind.bright and all_of_it:
        fields["colors"] = 3.0 * rng.uniform(0.5, 1, (len(verts), 3))
    indexed = kind.normal_faces and (all_of_it or rng.random() < 0.5)
    if indexed or rng.random() < 0.4:
        fields["normals"] = _directions(rng, len(verts) + 3)
        if indexed:
            fields["normal_faces"] = rng.integers(0, len(verts) + 3, faces.shape)
    # With a single material every mesh has coordinates: without them, it would count as another material.
    if kind.textured and (all_of_it or not kind.several or rng.random() < 0.8):
        fields["uvs"] = _coordinates(rng, len(verts) + 3)
        if kind.uv_faces and (all_of_it or rng.random() < 0.5):
            fields["uv_faces"] = rng.integers(0, len(verts) + 3, faces.shape)
    if kind.transparent and (all_of_it or rng.random() < 0.5):
        fields["alphas"] = rng.uniform(0, 1, len(verts)) * (rng.random(len(verts)) < 0.8)
    if not all_of_it:
        fields["instances"] = _placements(rng, kind.double)
    return Mesh(verts, faces, material=material, **fields)


def _moved_mesh(mesh: Mesh, scale: float, shift: Array, double: bool) -> Mesh:
    """Return the mesh times `scale` plus `shift`, in float32 without `double`; placements are about the shifted
    origin."""
    verts = mesh.verts * scale
    placed = np.array(mesh.instances)
    if double:
        placed[:, :3, 3] *= scale
        placed[:, :3, 3] += shift
        if np.array_equal(np.asarray(mesh.instances), np.eye(4)[None]):
            return replace(mesh, verts=verts + shift, instances=None)
        return replace(mesh, verts=verts, instances=placed)
    return replace(mesh, verts=(verts + shift).astype(np.float32))
