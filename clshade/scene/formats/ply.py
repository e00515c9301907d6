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
from .. import framing
from ..geometry import against_normals, crease_normals, seamless_normals, vertex_normals
from ..model import MAX_FACES, Mesh, Scene, Texture
from ..triangulate import CUT_AS_FANS, Cuts, strips, triangulated
from .options import DEFAULT_MATERIAL, Options, linear_colors, mended_normals, warn_ignored
from .ply_parser import Element, PlyFile
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
    reader = _Reader(path, options)
    mesh = reader.mesh()
    scene = framing.framed((mesh,), mesh.name, options.resolution, up=options.up)
    return warn_ignored(scene, reader.owner, reader.ignored)


class _Reader:
    """Makes the Mesh of a file.

    faces: (F, 3) int32 indices into the file's vertices. polygon: (F,) the row in element face of each, -1 for triangles
    of strips. cuts: how the polygons are cut; None if there are strips. arrays: fields of the Mesh.
    """

    def __init__(self, path: Path, options: Options) -> None:
        self.path, self.owner, self.options = path, shown(path), options
        self.file = PlyFile(read_file(path, MAX_BYTES), self.owner)
        self.ignored: list[str] = []
        vertex, face = self.file.elements.get("vertex"), self.file.elements.get("face")
        if vertex is None or not vertex.rows:
            raise self.error("element vertex", "at least one vertex", "none")
        self.vertex, self.face = vertex, face if face is not None and face.rows else None
        verts = self._columns("x", "y", "z")
        if verts is None:
            raise self.error("element vertex", "properties x, y and z", ", ".join(vertex.columns) or "none")
        self.faces, self.polygon, self.cuts = self._faces(verts)
        self.arrays: dict[str, Any] = {"verts": verts, "faces": self.faces}

    def error(self, where: str, expected: str, found: str) -> Exception:
        return file_error(self.owner, where, expected, found)

    def mesh(self) -> Mesh:
        arrays, options = self.arrays, self.options
        arrays["normals"] = normals = self._columns("nx", "ny", "nz", finite=False)
        arrays["scalars"] = self._scalars(self.vertex)
        if normals is None and options.crease is not None:
            creased = crease_normals(arrays["verts"], arrays["faces"], options.crease)
            arrays["normals"], arrays["normal_faces"] = creased
        elif normals is None and options.weld:
            arrays["normals"] = seamless_normals(arrays["verts"], arrays["faces"])
        self._color()
        texture = self._texture()
        self._add_face_scalars()
        if normals is not None:
            self._turn_to_normals()
        blend = arrays["colors"] is not None and bool((arrays["colors"][:, 3] < 1.0).any())
        material = replace(options.lit(DEFAULT_MATERIAL), texture=texture, blend=blend)
        others = (name for name in self.file.elements if name not in ("vertex", "face", "tristrips"))
        self.ignored += [f"element {name[:32]}" for name in others]
        return Mesh(**arrays, material=material, name=os.path.splitext(os.path.basename(self.owner))[0])

    def _columns(self, *names: str, finite: bool = True) -> Array | None:
        """Return (rows, len(names)) values of scalar properties of vertices, float32 or float64; None unless all are
        there."""
        if not self.vertex.has(*names):
            return None
        columns = [self.vertex.columns[name] for name in names]
        single = all(column.dtype == np.float32 for column in columns)
        values = np.empty((self.vertex.rows, len(names)), np.float32 if single else np.float64)
        for number, column in enumerate(columns):
            values[:, number] = column
        if finite and not np.isfinite(values).all():
            row, number = np.argwhere(~np.isfinite(values))[0]
            where = f"element vertex: row {row}: {names[number]}"
            raise self.error(where, "a finite number", str(values[row, number]))
        return values

    def _faces(self, verts: Array) -> tuple[Array, Array, Cuts | None]:
        faces, polygons, cuts = [], [], None
        for element in (self.face, self.file.elements.get("tristrips")):
            if element is None or not element.rows:
                continue
            corners, lengths = self._corners(element, len(verts))
            if element is self.face:
                cuts = triangulated(verts, corners, lengths)
                if cuts.left:
                    self.ignored.append(CUT_AS_FANS)
                triangles, polygon = cuts.triangles(corners), cuts.polygon
            else:
                triangles = strips(np.insert(corners, np.cumsum(lengths)[:-1], -1))
                polygon = np.full(len(triangles), -1)
            faces.append(triangles)
            polygons.append(polygon)
        if not sum(map(len, faces)):
            raise self.error("element face", "at least one triangle, in faces or tristrips", "none")
        if len(faces) == 1:
            return faces[0], polygons[0], cuts
        return np.concatenate(faces), np.concatenate(polygons), None if len(faces[1]) else cuts

    def _corners(self, element: Element, count: int) -> tuple[Array, Array]:
        """Return the int32 indices below `count` of the corners of an element's polygons or strips, and how many each
        has."""
        where, is_face = f"element {element.name}", element is self.face
        lists = [element.columns[name] for name in _INDICES if isinstance(element.columns.get(name), tuple)]
        if not lists:
            expected = f"a list property {' or '.join(_INDICES)}"
            raise self.error(where, expected, ", ".join(element.columns) or "none")
        values, lengths = lists[0]
        least = 0 if is_face else -1
        whole = values.dtype.kind in "iu" or bool((values == np.floor(values)).all())
        if len(values) and not (whole and values.min() >= least and values.max() < count):
            place = int(np.argmin((values >= least) & (values < count) & (values == np.floor(values))))
            row = int(np.searchsorted(np.cumsum(lengths), place, side="right"))
            raise self.error(f"{where}: row {row}", f"indices from 0 to {count - 1}", f"{values[place]:g}")
        if is_face and lengths.min() < 3:
            row = int(np.argmax(lengths < 3))
            raise self.error(f"{where}: row {row}", "at least 3 corners", str(lengths[row]))
        if is_face and int(lengths.sum()) - 2 * len(lengths) > MAX_FACES:
            raise self.error(where, f"at most {MAX_FACES} triangles", "more")
        return values.astype(np.int32, copy=False), lengths

    def _turn_to_normals(self) -> None:
        """Reverse the faces that are clockwise as seen along the file's normals, which define the front; compute normals
        that are 0 or not finite."""
        arrays = self.arrays
        names = [name for name in ("faces", "normal_faces", "uv_faces") if arrays.get(name) is not None]
        name = "normal_faces" if "normal_faces" in names else "faces"
        against = against_normals(arrays["verts"], arrays["faces"], arrays["normals"], arrays[name])
        if against.any():
            arrays.update({key: np.where(against[:, None], arrays[key][:, [0, 2, 1]], arrays[key]) for key in names})
        where = f"{self.owner}: element vertex: nx, ny, nz"
        arrays["normals"], mended = mended_normals(
            arrays["verts"], arrays["faces"], arrays["normals"], arrays[name], where
        )
        if mended is not arrays[name]:
            arrays["normal_faces"] = mended

    def _linear(self, element: Element | None) -> Array | None:
        """Return (rows, 4) linear colors and alphas of an element, or None if it has none."""
        names = () if element is None else next((names for names in _COLORS if element.has(*names[:3])), ())
        if element is None or not names:
            return None
        kinds = {item.name: np.dtype(item.kind) for item in element.properties}
        values = np.ones((element.rows, 4))
        for number, name in enumerate(names if element.has(names[3]) else names[:3]):
            values[:, number] = element.columns[name]
            if kinds[name].kind in "iu":
                most = np.iinfo(kinds[name]).max if kinds[name].itemsize < 4 else 255
                values[:, number] = np.clip(values[:, number] / most, 0.0, 1.0)
        return linear_colors(values, self.options, f"{self.owner}: element {element.name}").astype(np.float32)

    def _color(self) -> None:
        """Set the colors of the vertices or, if they have none, of the faces, whose corners then get their own vertices."""
        arrays = self.arrays
        arrays["colors"], colors = self._linear(self.vertex), self._linear(self.face)
        if colors is None:
            return
        if arrays["colors"] is not None:
            self.ignored.append("colors of faces (the vertices have some)")
            return
        faces, verts = arrays["faces"], arrays["verts"]
        if arrays["normals"] is None:
            arrays["normals"] = vertex_normals(verts, faces)
        arrays.setdefault("normal_faces", faces)
        by_face = np.where(self.polygon[:, None] < 0, np.float32(1.0), colors[self.polygon])
        arrays.update(verts=verts[faces].reshape(-1, 3), colors=np.repeat(by_face, 3, axis=0))
        arrays["scalars"] = {name: values[faces].reshape(-1) for name, values in arrays["scalars"].items()}
        arrays["faces"] = np.arange(len(arrays["verts"]), dtype=np.int32).reshape(-1, 3)

    def _scalars(self, element: Element) -> dict[str, Array]:
        """Return the (rows,) values, float32 or float64, of an element's properties that mean nothing else."""
        is_vertex = element is self.vertex
        groups = [("x", "y", "z"), ("nx", "ny", "nz"), *_UVS] if is_vertex else []
        groups = [names for names in groups if element.has(*names)]
        groups += [names for names in _COLORS if element.has(*names[:3])][:1]
        meant = {name for names in groups for name in names}
        others = {name: column for name, column in element.columns.items() if name not in meant}
        lists = [name for name, column in others.items() if isinstance(column, tuple)]
        self.ignored += [f"list {name[:32]}" for name in lists if is_vertex or name not in (*_INDICES, "texcoord")]
        columns = [(name, column) for name, column in others.items() if name not in lists]
        if len(columns) > MAX_SCALARS:
            self.ignored.append(f"properties of element {element.name} beyond {MAX_SCALARS}")
        scalars = {}
        for name, column in columns[:MAX_SCALARS]:  # float32 holds every number of 16 bits
            single = column.dtype == np.float32 or (column.dtype.kind in "iu" and column.itemsize < 4)
            scalars[name] = column.astype(np.float32 if single else np.float64)
        return scalars

    def _add_face_scalars(self) -> None:
        """Add the scalars of the file's faces to those of its vertices; triangles of strips have none, NaN."""
        scalars, count = self.arrays["scalars"], len(self.arrays["verts"])
        for name, values in ({} if self.face is None else self._scalars(self.face)).items():
            by_face = np.where(self.polygon < 0, values.dtype.type(np.nan), values[self.polygon])
            if len(by_face) == count:  # as many as vertices: given per corner, they are not taken for theirs
                by_face = np.repeat(by_face[:, None], 3, axis=1)
            scalars[name if name not in scalars else f"face_{name}"] = by_face

    def _texture(self) -> Texture | None:
        """Return the texture, and set its coordinates; None if the file has no coordinates or no image."""
        texture = self.options.texture
        uvs, uv_faces = self._uvs()
        names = [match.group(1).strip() for match in map(_TEXTURE.fullmatch, self.file.comments) if match]
        if uvs is None:
            self.ignored.extend(["textures of faces without texture coordinates"] if names else [])
            if texture is not None:
                raise self.error("element vertex", "texture coordinates (s t, u v ...) for the texture", "none")
            return None
        if uv_faces is None and self.arrays["faces"] is not self.faces:
            uv_faces = self.faces
        uvs[:, 1] = 1.0 - uvs[:, 1]
        self.arrays.update(uvs=uvs, uv_faces=uv_faces)
        if texture is not None or not names:
            return texture
        if len(names) > 1:
            warnings.warn(f"{self.owner}: comment TextureFile: images after the first are not rendered", stacklevel=2)
        images = Images(self.path)
        image = images.find(names[0], self.owner, "comment TextureFile")
        return None if image is None else images.texture(image)

    def _uvs(self) -> tuple[Array | None, Array | None]:
        """Return (T, 2) coordinates, and for those of corners their (F, 3) indices."""
        listed = None if self.face is None else self.face.columns.get("texcoord")
        if self.face is not None and isinstance(listed, tuple) and self.cuts is not None:
            values, lengths = listed
            corners = self.cuts.counts
            if (lengths == 2 * corners).all():
                index = self.cuts.triangles(np.arange(int(corners.sum()), dtype=np.int32))
                return values.reshape(-1, 2).astype(np.float64), index
            row = int(np.argmax(lengths != 2 * corners))
            raise self.error(f"element face: row {row}: texcoord", "two values a corner", str(lengths[row]))
        tables = (self._columns(*names, finite=False) for names in _UVS)
        return next((table for table in tables if table is not None), None), None
