"""Scenes from PLY files, ascii and binary.

Own code on NumPy, because trimesh 5.2 silently returns no faces for triangle strips, accepts NaN, infinity and
indices out of range, doubles the precision of every position, and opens the textures that a comment names.
"""

from __future__ import annotations

import os
import re
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, read_file
from .. import framing, geometry
from ..model import MAX_FACES, Mesh, Scene, Texture
from ..normals import against_normals, crease_normals, seamless_normals
from ..triangulate import CUT_AS_FANS, Cuts, strips, triangulated
from .options import DEFAULT_MATERIAL, Options, linear_colors, mended_normals, warn_ignored
from .ply_parser import Element, read_ply_rows
from .texture import Images

MAX_BYTES = 1 << 31
MAX_SCALARS = 64  # of vertices, and of faces
_INDICES = ("vertex_indices", "vertex_index")
_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_COLORS = (
    ("red", "green", "blue", "alpha"),
    ("r", "g", "b", "a"),
    ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"),
)
_TEXTURE = re.compile(r"TextureFile\s+(.+)", re.IGNORECASE)


def read_ply(path: Path, options: Options) -> Scene:
    """Read a PLY file: one Mesh of its faces, followed by its triangle strips.

    Polygons are cut by `triangulate.triangulated`. Rendered: positions (as float32, or float64 where the file has
    double or text), normals, colors of vertices or of faces, texture coordinates of vertices or of the corners of faces
    (v = 0 is the bottom), and the image that a comment `TextureFile` names, in the file's folder. Colors, of integers
    value/255 (65535), are decoded by `options.linear_colors`; those with alpha below 1 blend. Faces with a color each get
    vertices of their own. Normals that are 0 or not finite are computed. Without normals the surface is smooth, across
    seams with options.weld, except for edges above options.crease; faces that are clockwise as seen along the file's
    normals are reversed. All other properties of vertices and faces that are numbers become Mesh.scalars; where a face's
    has the name of a vertex's, it is `face_` and that name.
    Other elements are listed in Scene.ignored.
    """
    owner = shown(path)
    elements, comments = read_ply_rows(read_file(path, MAX_BYTES), owner)
    vertex = elements.get("vertex")
    if vertex is None or not vertex.rows:
        raise file_error(owner, "element vertex", "at least one vertex", "none")
    verts = _columns(vertex, ("x", "y", "z"), owner)
    if verts is None:
        raise file_error(owner, "element vertex", "properties x, y and z", ", ".join(vertex.columns) or "none")
    ignored: list[str] = []
    faces, polygon, cuts = _faces(elements, verts, ignored, owner)
    arrays: dict[str, Any] = {
        "verts": verts,
        "faces": faces,
        "normals": _columns(vertex, ("nx", "ny", "nz"), owner, finite=False),
    }
    by_file = arrays["normals"] is not None
    arrays["scalars"] = _scalars(vertex, ignored)
    _shade(arrays, options)
    _color(arrays, elements, polygon, options, ignored, owner)
    texture = _texture(arrays, elements, comments, options, path, faces, cuts, ignored)
    _add_face_scalars(arrays, elements.get("face"), polygon, ignored)
    if by_file:
        _turn_to_normals(arrays, f"{owner}: element vertex: nx, ny, nz")
    blend = arrays["colors"] is not None and bool((arrays["colors"][:, 3] < 1.0).any())
    material = replace(options.lit(DEFAULT_MATERIAL), texture=texture, blend=blend)
    name = os.path.splitext(os.path.basename(owner))[0]
    mesh = Mesh(**arrays, material=material, name=name)
    ignored += [f"element {key[:32]}" for key in elements if key not in ("vertex", "face", "tristrips")]
    scene = framing.framed((mesh,), name, options.resolution, up=options.up)
    return warn_ignored(scene, owner, ignored)


def _columns(element: Element, names: tuple[str, ...], owner: str, *, finite: bool = True) -> Array | None:
    """Return (rows, len(names)) values of scalar properties, float32 or float64; None unless all are there."""
    columns = [element.columns.get(name) for name in names]
    if any(column is None or isinstance(column, tuple) for column in columns):
        return None
    single = all(column.dtype == np.float32 for column in columns)  # type: ignore[union-attr]
    values = np.empty((element.rows, len(names)), np.float32 if single else np.float64)
    for number, column in enumerate(columns):
        values[:, number] = column
    if finite and not np.isfinite(values).all():
        row, number = np.argwhere(~np.isfinite(values))[0]
        where = f"element {element.name}: row {row}: {names[number]}"
        raise file_error(owner, where, "a finite number", str(values[row, number]))
    return values


def _faces(
    elements: dict[str, Element], verts: Array, ignored: list[str], owner: str
) -> tuple[Array, Array, Cuts | None]:
    """Return (F, 3) int32 indices into verts, the (F,) row in element face of each, and how the polygons are cut.

    The row is -1 for triangles of strips; the cuts are None if there are any.
    """
    faces, polygons, cuts, count = [], [], None, len(verts)
    face, strip = elements.get("face"), elements.get("tristrips")
    for element in (face, strip):
        if element is None or not element.rows:
            continue
        values, lengths = _lists(element, _INDICES, owner)
        least = 0 if element is face else -1
        whole = values.dtype.kind in "iu" or bool((values == np.floor(values)).all())
        if len(values) and not (whole and values.min() >= least and values.max() < count):
            where = np.flatnonzero(~((values >= least) & (values < count) & (values == np.floor(values))))
            row = int(np.searchsorted(np.cumsum(lengths), where[0], side="right"))
            expected = f"indices from 0 to {count - 1}"
            raise file_error(owner, f"element {element.name}: row {row}", expected, f"{values[where[0]]:g}")
        if element is face:
            if lengths.min() < 3:
                row = int(np.argmax(lengths < 3))
                raise file_error(owner, f"element face: row {row}", "at least 3 corners", str(lengths[row]))
            if int(lengths.sum()) - 2 * len(lengths) > MAX_FACES:
                raise file_error(owner, "element face", f"at most {MAX_FACES} triangles", "more")
            corners = values.astype(np.int32, copy=False)
            cuts = triangulated(verts, corners, lengths)
            if cuts.left:
                ignored.append(CUT_AS_FANS)
            triangles, polygon = cuts.triangles(corners), cuts.polygon
        else:
            ends = np.cumsum(lengths)[:-1]
            triangles = strips(np.insert(values.astype(np.int32), ends, -1))
            polygon = np.full(len(triangles), -1)
        faces.append(triangles)
        polygons.append(polygon)
    if not sum(map(len, faces)):
        raise file_error(owner, "element face", "at least one triangle, in faces or tristrips", "none")
    if len(faces) == 1:
        return faces[0], polygons[0], cuts
    return np.concatenate(faces), np.concatenate(polygons), None if len(faces[1]) else cuts


def _lists(element: Element, names: tuple[str, ...], owner: str) -> tuple[Array, Array]:
    for name in names:
        found = element.columns.get(name)
        if isinstance(found, tuple):
            return found
    expected = f"a list property {' or '.join(names)}"
    raise file_error(owner, f"element {element.name}", expected, ", ".join(element.columns) or "none")


def _shade(arrays: dict[str, Any], options: Options) -> None:
    """Compute normals by the crease angle if one is given, or across seams, if the file has none."""
    if arrays["normals"] is not None:
        return
    if options.crease is None:
        arrays["normals"] = seamless_normals(arrays["verts"], arrays["faces"]) if options.weld else None
    else:
        normals, normal_faces = crease_normals(arrays["verts"], arrays["faces"], options.crease)
        arrays.update(normals=normals, normal_faces=normal_faces)


def _turn_to_normals(arrays: dict[str, Any], where: str) -> None:
    """Reverse the faces that are clockwise as seen along the file's normals, which define the front; compute normals that
    are 0 or not finite."""
    normals, normal_faces = arrays["normals"], arrays.get("normal_faces")
    normal_faces = arrays["faces"] if normal_faces is None else normal_faces
    against = against_normals(arrays["verts"], arrays["faces"], normals, normal_faces)
    for name in ("faces", "normal_faces", "uv_faces"):
        if against.any() and arrays.get(name) is not None:
            arrays[name] = np.where(against[:, None], arrays[name][:, [0, 2, 1]], arrays[name])
    normal_faces = arrays["faces"] if arrays.get("normal_faces") is None else arrays["normal_faces"]
    arrays["normals"], mended = mended_normals(arrays["verts"], arrays["faces"], normals, normal_faces, where)
    if mended is not normal_faces:
        arrays["normal_faces"] = mended


def _linear(element: Element, options: Options, owner: str) -> Array | None:
    """Return (rows, 4) linear colors and alphas of an element, or None if it has none."""
    kinds = {item.name: np.dtype(item.kind) for item in element.properties}
    for names in _COLORS:
        if not _has(element, names[:3]):
            continue
        values = np.ones((element.rows, 4))
        for number, name in enumerate(names if _has(element, names[3:]) else names[:3]):
            values[:, number] = element.columns[name]
            if kinds[name].kind in "iu":
                most = np.iinfo(kinds[name]).max if kinds[name].itemsize < 4 else 255
                values[:, number] = np.clip(values[:, number] / most, 0.0, 1.0)
        return linear_colors(values, options, f"{owner}: element {element.name}").astype(np.float32)
    return None


def _color(
    arrays: dict[str, Any],
    elements: dict[str, Element],
    polygon: Array,
    options: Options,
    ignored: list[str],
    owner: str,
) -> None:
    """Set the colors of the vertices or, if they have none, of the faces, whose corners then get their own vertices."""
    arrays["colors"] = _linear(elements["vertex"], options, owner)
    face = elements.get("face")
    colors = None if face is None or not face.rows else _linear(face, options, owner)
    if colors is None:
        return
    if arrays["colors"] is not None:
        ignored.append("colors of faces (the vertices have some)")
        return
    faces, verts = arrays["faces"], arrays["verts"]
    if arrays["normals"] is None:
        arrays["normals"] = geometry.vertex_normals(verts, faces)
    if arrays.get("normal_faces") is None:
        arrays["normal_faces"] = faces
    own = np.where(polygon[:, None] < 0, np.float32(1.0), colors[polygon])
    arrays.update(verts=verts[faces].reshape(-1, 3), colors=np.repeat(own, 3, axis=0))
    arrays["scalars"] = {name: values[faces].reshape(-1) for name, values in arrays["scalars"].items()}
    arrays["faces"] = np.arange(len(arrays["verts"]), dtype=np.int32).reshape(-1, 3)


def _scalars(element: Element, ignored: list[str]) -> dict[str, Array]:
    """Return the (rows,) values, float32 or float64, of an element's properties that mean nothing else."""
    is_vertex = element.name == "vertex"
    known = [("x", "y", "z"), ("nx", "ny", "nz"), *_UVS] if is_vertex else []
    taken = {name for names in known if _has(element, names) for name in names}
    taken.update(next((names for names in _COLORS if _has(element, names[:3])), ()))
    lists = (name for name, column in element.columns.items() if isinstance(column, tuple))
    ignored.extend(f"list {name[:32]}" for name in lists if is_vertex or name not in (*_INDICES, "texcoord"))
    found = [name for name, column in element.columns.items() if name not in taken and not isinstance(column, tuple)]
    if len(found) > MAX_SCALARS:
        ignored.append(f"properties of element {element.name} beyond {MAX_SCALARS}")
    # float32 holds every number of 16 bits.
    columns = {name: element.columns[name] for name in found[:MAX_SCALARS]}
    singles = {n for n, c in columns.items() if c.dtype == np.float32 or (c.dtype.kind in "iu" and c.itemsize < 4)}
    return {name: column.astype(np.float32 if name in singles else np.float64) for name, column in columns.items()}


def _has(element: Element, names: tuple[str, ...]) -> bool:
    """Return whether the element has all these properties, as scalars."""
    return all(name in element.columns and not isinstance(element.columns[name], tuple) for name in names)


def _add_face_scalars(arrays: dict[str, Any], face: Element | None, polygon: Array, ignored: list[str]) -> None:
    """Add the scalars of the file's faces to those of its vertices; triangles of strips have none, NaN."""
    if face is None or not face.rows:
        return
    count = len(arrays["verts"])
    for name, values in _scalars(face, ignored).items():
        own = np.where(polygon < 0, values.dtype.type(np.nan), values[polygon])
        if len(own) == count:  # as many as vertices: given per corner, they are not taken for theirs
            own = np.repeat(own[:, None], 3, axis=1)
        arrays["scalars"][name if name not in arrays["scalars"] else f"face_{name}"] = own


def _texture(
    arrays: dict[str, Any],
    elements: dict[str, Element],
    comments: list[str],
    options: Options,
    path: Path,
    faces: Array,
    cuts: Cuts | None,
    ignored: list[str],
) -> Texture | None:
    """Return the texture, and set its coordinates in `arrays`; None if the file has no coordinates or no image.

    faces: (F, 3) indices into the file's vertices. cuts: see _faces.
    """
    owner = shown(path)
    uvs, uv_faces = _uvs(elements, cuts, owner)
    names = [match.group(1).strip() for match in map(_TEXTURE.fullmatch, comments) if match]
    if uvs is None:
        ignored.extend(["textures of faces without texture coordinates"] if names else [])
        if options.texture is not None:
            raise file_error(owner, "element vertex", "texture coordinates (s t, u v ...) for the texture", "none")
        return None
    if uv_faces is None and arrays["faces"] is not faces:
        uv_faces = faces
    uvs[:, 1] = 1.0 - uvs[:, 1]
    arrays.update(uvs=uvs, uv_faces=uv_faces)
    if options.texture is not None:
        return options.texture
    if not names:
        return None
    if len(names) > 1:
        warnings.warn(f"{owner}: comment TextureFile: images after the first are not rendered", stacklevel=2)
    images = Images(path)
    found = images.find(names[0], owner, "comment TextureFile")
    return None if found is None else images.texture(found)


def _uvs(elements: dict[str, Element], cuts: Cuts | None, owner: str) -> tuple[Array | None, Array | None]:
    """Return (T, 2) coordinates, and for those of corners their (F, 3) indices."""
    face = elements.get("face")
    listed = face.columns.get("texcoord") if face is not None else None
    if face is not None and isinstance(listed, tuple) and cuts is not None:
        values, lengths = listed
        corners = _lists(face, _INDICES, owner)[1]
        if (lengths == 2 * corners).all():
            index = cuts.triangles(np.arange(int(corners.sum()), dtype=np.int32))
            return values.reshape(-1, 2).astype(np.float64), index
        row = int(np.argmax(lengths != 2 * corners))
        raise file_error(owner, f"element face: row {row}: texcoord", "two values a corner", str(lengths[row]))
    for names in _UVS:
        values = _columns(elements["vertex"], names, owner, finite=False)
        if values is not None:
            return values, None
    return None, None
