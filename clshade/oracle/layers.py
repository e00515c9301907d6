"""The layers of a frame besides Z and id: properties of the surface at each pixel's sample nearest the center."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..base.arrays import Bools, Floats, Integers, UInt32s
from ..scene.model import Material, Scene, Settings
from ..scene.scalar_colors import without_colors
from . import ambient_occlusion, coverage, shade
from .corners import interpolated
from .frame import (
    BATCH,
    Prepared,
    face_weight_steps,
    face_weights,
    layer_owners,
    opaque_test,
    owners,
    prepare,
    samples_of,
    weight_condition,
)
from .maps import maps, turned_length, turned_normals
from .microfacet import REACH
from .pixels import blend, seen_at_pixels, shade_pixels
from .transform import SAMPLE_STEPS, mirroring
from .vectors import length, unit

# The background of what is not 0 there.
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
    weight_condition (M, N), see `weight_condition`; open_spread (M, N), open_rounding (M, N), see
    `ambient_occlusion.Openness`.
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
    for field in fields(Material):
        if field.name != "texture" and np.any(getattr(a, field.name) != getattr(b, field.name)):
            return False
    if a.texture is None or b.texture is None:
        return a.texture is b.texture
    same_use = all(getattr(a.texture, name) == getattr(b.texture, name) for name in ("wrap", "lookup", "filter"))
    return same_use and np.array_equal(a.texture.image, b.texture.image)


def material_numbers(scene: Scene) -> UInt32s:
    """Return (meshes,) uint32: 1 for the first mesh's material, and the next number for each that equals none before
    it."""
    different: list[Material] = []
    numbers = []
    for mesh in scene.meshes:
        known = [k for k, material in enumerate(different) if equal(mesh.material, material)]
        if not known:
            different.append(mesh.material)
        numbers.append(known[0] + 1 if known else len(different))
    return np.array(numbers, np.uint32)


def objects(scene: Scene) -> UInt32s:
    """Return (meshes, 2) uint32: the number of each mesh's object, and that of its first instance, both from 1."""
    found = np.zeros((len(scene.meshes), 2), np.uint32)
    parts: dict[str | int, list[int]] = {}
    for number, mesh in enumerate(scene.meshes):
        parts.setdefault(mesh.part_of or number, []).append(number)
    first = 1
    for number, members in enumerate(parts.values(), 1):
        found[members] = number, first
        first += max(len(np.asarray(scene.meshes[each].instances)) for each in members)
    return found


def instance_numbers(scene: Scene) -> UInt32s:
    """Return (F,) uint32: the number of the face's placement, from 1."""
    found = [np.zeros(0, np.uint32)]
    for first, mesh in zip(objects(scene)[:, 1].tolist(), scene.meshes, strict=True):
        own = np.arange(first, first + len(np.asarray(mesh.instances)), dtype=np.uint32)
        found.append(np.repeat(own, len(mesh.faces)))
    return np.concatenate(found)


def render_layers(scene: Scene, settings: Settings) -> OracleLayers:
    """Render the layers of a scene's own camera."""
    columns, rows = scene.camera.resolution
    at = np.divmod(np.arange(rows * columns), columns)
    found = sample_layers(scene, settings, *at)
    grid = (getattr(found, field.name) for field in fields(OracleLayers))
    return OracleLayers(*(values.reshape(rows, columns, *values.shape[1:]) for values in grid))


def sample_layers(scene: Scene, settings: Settings, rows: Integers, columns: Integers) -> OracleLayers:
    """Render the layers of some pixels only: rows (from the TOP) and columns, both (K,); leading axis (K,)."""
    camera = scene.camera
    own, scene = scene, without_colors(scene, settings.scalars)
    columns = np.asarray(columns, np.int64)
    upward = camera.resolution[1] - 1 - np.asarray(rows, np.int64)
    view = samples_of(scene, settings, prepare(scene, settings))[0]
    opaque = opaque_test(scene, settings, view)
    owner = owners(view, settings.visibility, columns, upward, opaque, camera.orthographic)
    owner, _ = layer_owners(scene, settings, owner, (columns, upward))
    shown = np.flatnonzero(owner >= 0)
    found: OracleLayers | None = None
    for start in range(0, max(len(shown), 1), BATCH):  # at least one batch, of no pixels in an empty image
        some = shown[start : start + BATCH]
        batch = _batch(scene, own, settings, view, owner[some], columns[some], upward[some])
        found = found or _background(owner.shape, batch)
        for field in fields(OracleLayers):
            getattr(found, field.name)[some] = getattr(batch, field.name)
    assert found is not None
    return found


def _background(shape: tuple[int, ...], batch: OracleLayers) -> OracleLayers:
    """Return the layers where there is no surface, with the components and types of those of a batch."""
    found = {}
    for name, value in vars(batch).items():
        found[name] = np.full((*shape, *value.shape[1:]), BACKGROUND.get(name, 0), value.dtype)
    return OracleLayers(**found)


def _batch(
    scene: Scene, own: Scene, settings: Settings, view: Prepared, piece: Integers, column: Integers, row: Integers
) -> OracleLayers:
    """Render pixels (column, row from the bottom) of pieces, (K,) each. own: the scene with its own materials."""
    corners, face, eye = view.corners, view.pieces.face[piece], scene.camera.eye
    edges = coverage.edge_functions(view.pieces.xy[piece], column, row)
    weights = face_weights(scene, settings, view, piece, edges)
    behind = view.setup.area[piece] < 0
    mesh = corners.mesh[face]

    two_sided = np.array([m.material.two_sided for m in scene.meshes], bool)[mesh]
    normal = blend(weights, corners.normals[face])
    normal = np.where((behind & two_sided)[:, None], -normal, normal)
    steps = None
    if settings.texture_filter == "trilinear":
        steps = face_weight_steps(scene, settings, view.pieces, piece, view.pieces.xy[piece], column, row)
    reach = np.abs(corners.world[face] - eye).max(axis=(1, 2))
    condition = weight_condition(view, piece, reach, scene.camera.orthographic)
    any_normal = (corners.normals[face] != 0.0).any(axis=(1, 2))

    normal_length = np.where(any_normal, length(normal), 1.0)
    found = maps(scene, settings, corners, face, weights, steps, condition)
    normal_error = corners.normal_error[face]
    if found.turned.any():
        normal = turned_normals(normal, corners.tangents[face], weights, behind & two_sided, found)
        turned = turned_length(normal, found, REACH[settings.precision])
        normal_length = np.where(found.turned, turned, normal_length)
        normal_error = np.where(found.normal.spread.max(axis=1) > 0.0, np.inf, normal_error)

    on_piece = shade.barycentrics(edges, view.pieces.z[piece], "affine" if scene.camera.orthographic else "perspective")
    in_space = (on_piece[:, :, None] * view.pieces.weights[piece]).sum(axis=1)
    relative = corners.world[face] - eye

    unlit = shade_pixels(scene, replace(settings, shader="nolight"), corners, face, weights, behind, steps, condition)
    by_mesh = [np.repeat(mirroring(np.asarray(mesh.instances)), len(mesh.faces)) for mesh in scene.meshes]
    mirrored = np.concatenate([np.zeros(0, bool), *by_mesh])  # of a scene without meshes, too
    in_order = np.where(mirrored[face, None], weights[:, [0, 2, 1]], weights)
    # At most twice the largest number of the layer's type, as the layer interpolates them.
    most = np.inf if settings.precision == "float64" else np.ldexp(1.0, np.finfo(np.float32).maxexp + 1)
    scalars = np.clip(corners.scalars[face], -most, most)
    open_ = _open(scene, settings, view, face, behind, column, row)
    return OracleLayers(
        N=unit(normal),
        P=eye + blend(in_space, relative),
        albedo=unlit.rgb,
        uv=interpolated(weights, corners.uvs[face]),
        object_id=objects(scene)[mesh, 0],
        material_id=material_numbers(own)[mesh],
        barycentrics=in_order,
        scalar=4.0 * interpolated(weights, 0.25 * scalars[..., None])[:, 0],  # no difference overflows
        AO=open_.share,
        instance_id=instance_numbers(own)[face],
        normal_length=normal_length,
        normal_error=normal_error,
        reach=reach,
        most_uv=np.abs(corners.uvs[face]).max(axis=(1, 2)),
        most_scalar=np.abs(scalars).max(axis=1),
        budget=unlit.budget,
        jump=unlit.jump,
        weight_condition=condition,
        open_spread=open_.spread,
        open_rounding=np.full(len(face), open_.rounding),
    )


def _open(
    scene: Scene, settings: Settings, view: Prepared, face: Integers, behind: Bools, column: Integers, row: Integers
) -> ambient_occlusion.Openness:
    """Return the share of the rays of ambient occlusion that meet nothing, (K,)."""
    if "AO" not in settings.layers:
        return ambient_occlusion.Openness(np.zeros(len(face)), np.zeros(len(face)), 1.0)
    place = SAMPLE_STEPS * column + view.place[0], SAMPLE_STEPS * row + view.place[1]
    seen = seen_at_pixels(scene, view.corners, face, behind, place)
    return ambient_occlusion.openness(seen, scene, settings, REACH[settings.precision], place)
