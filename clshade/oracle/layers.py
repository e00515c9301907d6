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
    """The layers and the measures of their errors. Leading axes (M, N), row 0 at the TOP; float64 unless stated; 0 for the
    background.

    N: (M, N, 3) unit normal in world space, or 0, turned by a normal map with shader pbr; flipped on the back of a
        two-sided material.
    P: (M, N, 3) visible position in world space, interpolated in perspective, as Z is, whatever the setting.
    albedo: (M, N, 3) the factor of the light: vertex color times material color times texel.
    uv: (M, N, 2) the mesh's texture coordinates, not wrapped.
    object_id, material_id: (M, N) uint32, the number of the object, from 1, and of its material: equal materials have one
        number, counted from 1 in the order of the meshes.
    instance_id: (M, N) uint32, the number of the placement, from 1, mesh by mesh.
    barycentrics: (M, N, 3) barycentric coordinates, in the order of the face's corners in the mesh.
    scalar: (M, N) the scalar that the settings name, NaN where there is none.
    AO: (M, N) the share of the rays of ambient occlusion that meet nothing; 0 without.

    Measures of errors: normal_length (M, N) before normalizing, 1 where the corners' normals are all 0;
    normal_error (M, N) of the corners' normals, see `corners.Corners`; reach (M, N) the largest coordinate of the face's
    corners relative to the eye; most_uv, most_scalar (M, N) of its corners'; budget, jump (M, N, 3) of albedo, see
    frame.OracleFrame;
    weight_condition (M, N), see `Hits.condition`; open_spread (M, N), open_rounding (M, N), see `AmbientVisibility`.
    """

    N: Floats
    P: Floats
    albedo: Floats
    uv: Floats
    object_id: UInt32s
    material_id: UInt32s
    barycentrics: Floats
    scalar: Floats
    AO: Floats
    instance_id: UInt32s
    normal_length: Floats
    normal_error: Floats
    reach: Floats
    most_uv: Floats
    most_scalar: Floats
    budget: Floats
    jump: Floats
    weight_condition: Floats
    open_spread: Floats
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
    different: list[Material] = []
    numbers = []
    for mesh in scene.meshes:
        number = next((k for k, material in enumerate(different) if equal(mesh.material, material)), len(different))
        if number == len(different):
            different.append(mesh.material)
        numbers.append(number + 1)
    return np.array(numbers, np.uint32)


def objects(scene: Scene) -> UInt32s:
    """Return (meshes, 2) uint32: the numbers of each mesh's object and of its first instance, both from 1."""
    numbers = np.zeros((len(scene.meshes), 2), np.uint32)
    parts: dict[str | int, list[int]] = {}
    for number, mesh in enumerate(scene.meshes):
        parts.setdefault(mesh.part_of or number, []).append(number)
    first = 1
    for number, members in enumerate(parts.values(), 1):
        numbers[members] = number, first
        first += max(len(np.asarray(scene.meshes[member].instances)) for member in members)
    return numbers


def instance_numbers(scene: Scene) -> UInt32s:
    """Return (F,) uint32: the number of the face's placement, from 1."""
    numbers = [np.zeros(0, np.uint32)]
    for first, mesh in zip(objects(scene)[:, 1].tolist(), scene.meshes, strict=True):
        of_mesh = np.arange(first, first + len(np.asarray(mesh.instances)), dtype=np.uint32)
        numbers.append(np.repeat(of_mesh, len(mesh.faces)))
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
        some = covered[start : start + BATCH]
        place = np.broadcast_to(pixels.shot.samples[0].place, (len(some), 2))
        hits = Hits.at(pixels.shot, owner[some], pixels.column[some], pixels.row[some], place)
        batches.append(vars(_layers_of(hits, scene)))
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
