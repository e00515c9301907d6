"""The layers of a frame besides Z and id: properties of the surface at each pixel's sample nearest the center."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..base.arrays import Floats, Integers, UInt32s
from ..scene.model import Material, Scene, Settings
from .corners import blend, interpolated
from .frame import BATCH, Pixels, whole_image
from .microfacet import REACH, maps, shading_normals
from .pixels import shade_pixels
from .shot import Hits
from .transform import mirroring, unit
from .visibility import AmbientVisibility, ambient_visibility, pixel_receivers

# Values at the background, of layers whose value there is not 0.
BACKGROUND = {"scalar": np.nan, "normal_length": 1.0, "weight_condition": 1.0, "open_rounding": 1.0}


@dataclass(frozen=True, eq=False)
class OracleLayers:
    """The layers and the measures of their errors: (M, N) and the components, row 0 at the TOP; 0 for the background."""

    N: Floats  # 3, unit or 0, world space, as a normal map turns it; flipped on the back of a two-sided material
    P: Floats  # 3, world space, interpolated in perspective, as Z is, whatever the setting
    albedo: Floats  # 3, the factor of the light: vertex color times material color times texel
    uv: Floats  # 2, of the mesh, not wrapped
    object_id: UInt32s  # from 1
    material_id: UInt32s  # from 1 in the order of the meshes; equal materials have one number
    barycentrics: Floats  # 3, in the order of the face's corners in the mesh
    scalar: Floats  # that the settings name, NaN where there is none
    AO: Floats  # the share of the rays of ambient occlusion that meet nothing; 0 without
    instance_id: UInt32s  # from 1, mesh by mesh
    normal_length: Floats  # before normalizing, 1 where the corners' normals are all 0
    normal_error: Floats  # of the corners' normals, see `Corners`
    reach: Floats  # the largest coordinate of the face's corners relative to the eye
    most_uv: Floats  # of its corners
    most_scalar: Floats
    budget: Floats  # 3, of albedo, as jump, see `OracleFrame`
    jump: Floats
    weight_condition: Floats  # see `Hits.condition`
    open_spread: Floats  # see `AmbientVisibility`, as open_rounding
    open_rounding: Floats


def equal(a: Material, b: Material) -> bool:
    """Return whether two materials agree in everything, the texture's image included."""
    if any(np.any(getattr(a, f.name) != getattr(b, f.name)) for f in fields(Material) if f.name != "texture"):
        return False
    if a.texture is None or b.texture is None:
        return a.texture is b.texture
    alike = all(getattr(a.texture, name) == getattr(b.texture, name) for name in ("wrap", "lookup", "filter"))
    return alike and np.array_equal(a.texture.image, b.texture.image)


def material_numbers(scene: Scene) -> UInt32s:
    """Return (meshes,) uint32: 1 for the first mesh's material, and the next number for each that equals none before
    it."""
    materials = [mesh.material for mesh in scene.meshes]
    first = [next(k for k, other in enumerate(materials) if equal(material, other)) for material in materials]
    return np.asarray(np.unique(first, return_inverse=True)[1] + 1, np.uint32)


def objects(scene: Scene) -> UInt32s:
    """Return (meshes, 2) uint32: the numbers of each mesh's object and of its first instance, both from 1."""
    numbers = np.zeros((len(scene.meshes), 2), np.uint32)
    parts: dict[str | int, list[int]] = {}
    for number, mesh in enumerate(scene.meshes):
        parts.setdefault(mesh.part_of or number, []).append(number)
    first = 1
    for number, members in enumerate(parts.values(), 1):
        numbers[members] = number, first
        first += max(len(scene.meshes[member].instances) for member in members)
    return numbers


def instance_numbers(scene: Scene) -> UInt32s:
    """Return (F,) uint32: the number of the face's placement, from 1."""
    numbers = [np.zeros(0, np.uint32)]
    for (_, first), mesh in zip(objects(scene), scene.meshes, strict=True):
        numbers.append(np.repeat(first + np.arange(len(mesh.instances), dtype=np.uint32), len(mesh.faces)))
    return np.concatenate(numbers)


def render_layers(
    scene: Scene, settings: Settings, rows: Integers | None = None, columns: Integers | None = None
) -> OracleLayers:
    """Render the layers of pixels: rows (from the TOP) and columns, both (K,), with leading axis (K,); by default of all
    the image, (M, N)."""
    if rows is None or columns is None:
        return whole_image(scene, settings, render_layers)
    pixels = Pixels.of(scene, settings, rows, columns)
    owner, _ = pixels.layer_owner()
    covered = np.flatnonzero(owner >= 0)
    batches = []
    for start in range(0, max(len(covered), 1), BATCH):  # at least one batch, of no pixels in an empty image
        batches.append(vars(_layers_of(pixels.central_hits(covered[start : start + BATCH], owner), scene)))
    layers = {}
    for name, value in batches[0].items():
        layers[name] = np.full((len(owner), *value.shape[1:]), BACKGROUND.get(name, 0), value.dtype)
        layers[name][covered] = np.concatenate([batch[name] for batch in batches])
    return OracleLayers(**layers)


def _layers_of(hits: Hits, scene: Scene) -> OracleLayers:
    """Render layers. scene: with the meshes' own materials."""
    shot, corners, face, mesh, weights = hits.shot, hits.shot.corners, hits.face, hits.mesh, hits.weights
    settings, camera = shot.settings, shot.scene.camera
    mapped = maps(hits)
    _, normal, normal_length = shading_normals(hits, mapped)
    exchanged = mapped.turned.any() & (mapped.normal.spread.max(axis=1) > 0.0)
    interpolation = "affine" if camera.orthographic else "perspective"
    in_space = shot.weights(hits.piece, hits.edges, interpolation)
    unlit = shade_pixels(replace(hits, shot=replace(shot, settings=replace(settings, shader="nolight"))))
    mirrored = [np.repeat(mirroring(np.asarray(part.instances)), len(part.faces)) for part in shot.scene.meshes]
    swapped = np.concatenate([np.zeros(0, bool), *mirrored])[face, None]
    # At most twice the largest number of the layer's type, as the layer interpolates them.
    limit = np.inf if settings.precision == "float64" else np.ldexp(1.0, np.finfo(np.float32).maxexp + 1)
    scalars = np.clip(corners.scalars[face], -limit, limit)
    open_ = AmbientVisibility(np.zeros(len(face)), np.zeros(len(face)), 1.0)
    if "AO" in settings.layers:
        open_ = ambient_visibility(pixel_receivers(hits), settings, REACH[settings.precision], hits.position)
    return OracleLayers(
        N=unit(normal),
        P=camera.eye + blend(in_space, corners.world[face] - camera.eye),
        albedo=unlit.rgb,
        uv=interpolated(weights, corners.uvs[face]),
        object_id=objects(shot.scene)[mesh, 0],
        material_id=material_numbers(scene)[mesh],
        barycentrics=np.where(swapped, weights[:, [0, 2, 1]], weights),
        scalar=4.0 * interpolated(weights, 0.25 * scalars[..., None])[:, 0],  # no difference overflows
        AO=open_.share,
        instance_id=instance_numbers(scene)[face],
        normal_length=normal_length,
        normal_error=np.where(exchanged, np.inf, corners.normal_error[face]),
        reach=hits.reach,
        most_uv=np.abs(corners.uvs[face]).max(axis=(1, 2)),
        most_scalar=np.abs(scalars).max(axis=1),
        budget=unlit.budget,
        jump=unlit.jump,
        weight_condition=hits.condition,
        open_spread=open_.spread,
        open_rounding=np.full(len(face), open_.rounding),
    )
