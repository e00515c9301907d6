"""Scenes from meshes of trimesh, Open3D and PyVista, which are known by their attributes: none of them is imported."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Array, Floats
from ...base.validation import choice, value_error
from ...images.decode import srgb_to_linear
from .. import framing
from ..camera import Camera, checked_resolution
from ..framing import UPS, Up
from ..geometry import crease_angle, crease_normals, vertex_normals
from ..model import MAX_FACES, Material, Mesh, MetallicRoughness, Scene, Texture
from .gltf_materials import phong
from .reading import DEFAULT_MATERIAL

_OWNER = "from_trimesh"
_KINDS = "a Trimesh or Scene of trimesh, a TriangleMesh of Open3D, or a PolyData of PyVista with triangles alone"
_UNSET_DIFFUSE = (102, 102, 102, 255)  # of trimesh's SimpleMaterial
_MATERIAL = replace(DEFAULT_MATERIAL, two_sided=True)


def scene_of(
    source: Any, *, resolution: tuple[int, int] | None = None, crease: float | None = None, up: Up = "y"
) -> Scene:
    """Return a scene of another library's mesh or meshes, see `Scene.from_trimesh`."""
    if resolution is not None:
        resolution = checked_resolution(_OWNER, resolution)
    degrees = None if crease is None else crease_angle(_OWNER, "crease", crease)
    choice(_OWNER, "up", up, UPS)
    is_scene = hasattr(source, "geometry") and hasattr(source, "graph")
    converted = [*_of_scene(source)] if is_scene else [_mesh(source, {})]
    meshes = tuple(mesh for mesh in converted if len(mesh.faces))
    camera = _camera(source, resolution) if is_scene else None
    if degrees is not None:
        creased = (crease_normals(mesh.verts, mesh.faces, degrees) for mesh in meshes)
        meshes = tuple(replace(m, normals=n, normal_faces=f) for m, (n, f) in zip(meshes, creased, strict=True))
    if not meshes:
        raise value_error(_OWNER, "source", "at least one triangle", source)
    if sum(len(mesh.faces) * len(np.asarray(mesh.instances)) for mesh in meshes) > MAX_FACES:
        raise value_error(_OWNER, "source", f"at most {MAX_FACES} triangles with instances", source)
    scene = framing.framed(meshes, meshes[0].name if len(meshes) == 1 else "", resolution, up=up, camera=camera)
    return replace(scene, preset="pbr") if any(mesh.material.pbr is not None for mesh in meshes) else scene


def _of_scene(source: Any) -> Iterator[Mesh]:
    """Yield the meshes of a scene of trimesh, each with all its placements; warn of other geometry."""
    placements: dict[str, dict[Any, Any]] = {}  # of each geometry, by node
    for node in source.graph.nodes_geometry:
        matrix, name = source.graph[node]
        placements.setdefault(name, {})[node] = matrix
    materials: dict[int, Material] = {}
    skipped = []
    for name, matrices in placements.items():
        geometry = source.geometry[name]
        if hasattr(geometry, "faces"):
            instances, names = np.stack(list(matrices.values())), tuple(map(str, matrices))
            yield replace(_mesh(geometry, materials), name=str(name), instances=instances, instance_names=names)
        else:
            skipped.append(f"{name} ({type(geometry).__name__})")
    if skipped:
        warnings.warn(f"{_OWNER}: not rendered: {', '.join(skipped)}", stacklevel=5)


def _camera(source: Any, resolution: tuple[int, int] | None) -> Camera | None:
    """Return the camera of a scene of trimesh, if it has one and says where it is."""
    if not getattr(source, "has_camera", False) or source.camera.name not in source.graph.nodes:
        return None
    columns, rows = (int(size) for size in source.camera.resolution)
    width, height = (2.0 * np.tan(np.radians(np.asarray(source.camera.fov, np.float64)) / 2.0)).tolist()
    pose = np.asarray(source.camera_transform, np.float64)
    eye, forward, up = pose[:3, 3], -pose[:3, 2], pose[:3, 1]
    center = np.asarray(source.centroid, np.float64)
    away = float((center - eye) @ forward)
    camera = Camera(eye, eye + forward * (away if away > 0.0 else 1.0), up, 1.0, (height, width), (columns, rows))
    return camera if resolution is None else camera.with_resolution(resolution)


def _mesh(source: Any, materials: dict[int, Material]) -> Mesh:
    """Return one mesh. materials: those converted before, by the id of the other library's."""
    if hasattr(source, "triangles") and hasattr(source, "vertex_colors"):
        return _of_open3d(source)
    if hasattr(source, "points") and "regular_faces" in dir(source):  # a property that raises for some meshes
        return _of_pyvista(source)
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        return _of_trimesh(source, materials)
    raise value_error(_OWNER, "source", _KINDS, source)


def _of_trimesh(source: Any, materials: dict[int, Material]) -> Mesh:
    visual: Any = getattr(source, "visual", None)
    kind = getattr(visual, "kind", None)
    name = (getattr(source, "metadata", None) or {}).get("name") or ""
    scalars = {  # attributes of a glTF file begin with an underscore
        name.removeprefix("_"): values.reshape(-1)
        for name, values in _arrays(source, "vertex_attributes").items()
        if values.size == len(values) == len(source.vertices)
    }
    normals = getattr(source, "vertex_normals", None)
    mesh = Mesh(source.vertices, source.faces, None, normals, material=_MATERIAL, name=str(name), scalars=scalars)
    if kind == "vertex":
        return replace(mesh, **_colored(visual.vertex_colors, mesh.material))
    if kind == "face":
        return _with_face_colors(mesh, np.asarray(visual.face_colors))
    if kind != "texture":
        return mesh
    material = visual.material
    if id(material) not in materials:
        if hasattr(material, "materials"):
            raise value_error(_OWNER, "visual.material", "one material for each mesh", material)
        convert = _metallic_roughness if hasattr(material, "baseColorFactor") else _simple
        materials[id(material)] = convert(material)
    uvs = None if visual.uv is None else np.asarray(visual.uv) * [1.0, -1.0] + [0.0, 1.0]  # v = 0 is the bottom there
    colors = getattr(visual, "vertex_attributes", {}).get("color")
    return replace(mesh, uvs=uvs, material=materials[id(material)], colors=None if colors is None else _linear(colors))


def _of_open3d(source: Any) -> Mesh:
    colors, normals = np.asarray(source.vertex_colors), np.asarray(source.vertex_normals)
    return Mesh(
        np.asarray(source.vertices),
        np.asarray(source.triangles),
        srgb_to_linear(np.clip(colors, 0.0, 1.0)) if len(colors) else None,
        normals if len(normals) else None,
        material=_MATERIAL,
    )


def _of_pyvista(source: Any) -> Mesh:
    try:
        faces = np.asarray(source.regular_faces)
    except ValueError:
        faces = np.zeros((0, 0))
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise value_error(_OWNER, "source", "triangles alone (PolyData.triangulate() makes them)", source)
    verts, points, cells = np.asarray(source.points), _arrays(source, "point_data"), _arrays(source, "cell_data")
    scalars = {name: values for name, values in points.items() if values.shape == (len(verts),)}
    if len(faces) != len(verts):  # of as many points as cells, numbers would count as those of points
        of_cells = {name: values for name, values in cells.items() if values.shape == (len(faces),)}
        scalars |= of_cells | scalars
    mesh = Mesh(verts, faces, None, points.get("Normals"), material=_MATERIAL, scalars=scalars)
    colors = (values for values in points.values() if values.dtype == np.uint8 and values.shape[1:] in ((3,), (4,)))
    return next((replace(mesh, **_colored(values, mesh.material)) for values in colors), mesh)


def _arrays(source: Any, kind: str) -> dict[str, Array]:
    """Return the arrays of numbers that have a name."""
    arrays = {str(name): np.asarray(values) for name, values in getattr(source, kind, {}).items()}
    return {name: values for name, values in arrays.items() if name and values.dtype.kind in "fiub"}


def _linear(colors: Any) -> Floats:
    """Return colors with alpha (K, 4): integers are decoded from sRGB, other numbers are linear."""
    array = np.asarray(colors)
    rgba = np.ones((len(array), 4))
    rgba[:, : array.shape[1]] = array / np.iinfo(array.dtype).max if array.dtype.kind == "u" else array
    if array.dtype.kind == "u":
        rgba[:, :3] = srgb_to_linear(rgba[:, :3])
    return rgba


def _colored(colors: Any, material: Material) -> dict[str, Any]:
    """Return the fields of a mesh that has colors at its vertices; those with alpha below 1 blend."""
    rgba = _linear(colors)
    blend = bool((rgba[:, 3] < 1.0).any())
    return {"colors": rgba, "material": replace(material, blend=blend)}


def _with_face_colors(mesh: Mesh, colors: Array) -> Mesh:
    """Return the mesh with a color for each face: every corner becomes a vertex, normals stay."""
    corners = mesh.faces.reshape(-1)
    normals = vertex_normals(mesh.verts, mesh.faces) if mesh.normals is None else mesh.normals
    changes: dict[str, Any] = {"normals": normals, "normal_faces": mesh.faces, "verts": mesh.verts[corners]}
    changes["faces"] = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    changes["scalars"] = {name: values[corners] for name, values in mesh.scalars.items()}
    return replace(mesh, **changes, **_colored(np.repeat(colors, 3, axis=0), mesh.material))


def _simple(source: Any) -> Material:
    """Return a Material for a SimpleMaterial, as for one of an MTL file."""
    kd = _factor(source.diffuse)
    texture = _texture(source.image, srgb=True)
    if texture is not None and tuple(np.asarray(source.diffuse).tolist()) == _UNSET_DIFFUSE:
        kd = np.append(DEFAULT_MATERIAL.kd, 1.0)
    return Material(
        _factor(source.ambient)[:3],
        kd[:3],
        _factor(source.specular)[:3],
        float(np.clip(source.glossiness, 0.0, 1e9)),
        texture,
        str(source.name or ""),
        two_sided=True,
        blend=bool(kd[3] < 1.0) or (texture is not None and texture.texels.shape[2] == 4),
        opacity=float(kd[3]),
    )


def _metallic_roughness(source: Any) -> Material:
    """Return a Material for a PBRMaterial, with glTF's defaults for what it leaves out."""

    def value(name: str, default: Any) -> Any:
        return default if getattr(source, name) is None else getattr(source, name)

    factor = _factor(value("baseColorFactor", np.ones(4)))
    metallic, roughness = (float(np.clip(value(f"{name}Factor", 1.0), 0.0, 1.0)) for name in ("metallic", "roughness"))
    mode = source.alphaMode or "OPAQUE"
    cutoff = float(value("alphaCutoff", 0.5)) if mode == "MASK" else 0.0
    texture = _texture(source.baseColorTexture, srgb=True)
    base = factor[:3] if texture is None else factor[:3] * texture.mean()
    facets = MetallicRoughness(
        metallic,
        roughness,
        _texture(source.metallicRoughnessTexture, srgb=False),
        emission=np.maximum(np.asarray(value("emissiveFactor", np.zeros(3)), np.float64), 0.0),
        normal_texture=_texture(source.normalTexture, srgb=False),
        occlusion_texture=_texture(source.occlusionTexture, srgb=False),
        emission_texture=_texture(source.emissiveTexture, srgb=True),
    )
    return Material(
        1.0,
        *phong(metallic, roughness, float(np.mean(base))),
        texture,
        str(source.name or ""),
        factor[:3],
        two_sided=True,
        alpha_cutoff=cutoff if cutoff > 0.0 else None,
        pbr=facets,
        blend=mode == "BLEND",
        opacity=float(np.clip(factor[3], 0.0, 1.0)) if mode != "OPAQUE" else 1.0,
    )


def _factor(factor: Any) -> Floats:
    """Return an RGBA factor (4,), linear; whole numbers count from 0 to 255."""
    array = np.asarray(factor)
    values = array / 255.0 if array.dtype.kind in "ui" else array.astype(np.float64)
    return np.append(values[:3], values[3] if len(values) > 3 else 1.0)


def _texture(image: Any, *, srgb: bool) -> Texture | None:
    """Return a Texture of an image of Pillow, or None."""
    if image is None:
        return None
    alpha = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
    pixels = np.asarray(image.convert("RGBA" if alpha else "RGB")) / 255.0
    if srgb:
        pixels[..., :3] = srgb_to_linear(pixels[..., :3])
    return Texture(pixels[..., :3] if alpha and (pixels[..., 3] == 1.0).all() else pixels)
