"""Measurements of meshes for tests of the built-in scenes: normals, volumes, seams, borders."""

import numpy as np

from clshade.scene.model import Mesh, Scene


def mesh_of(scene: Scene, name: str) -> Mesh:
    return next(mesh for mesh in scene.meshes if mesh.name == name)


def face_normals(mesh: Mesh) -> np.ndarray:
    """Return the face normals (F, 3), with lengths of twice the area."""
    a, b, c = (mesh.verts[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a)


def volume(verts: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (verts[faces[:, k]].astype(np.float64) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def welded(*meshes: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Merge meshes into one surface; only bit-identical positions are merged into one vertex."""
    starts = np.cumsum([0] + [len(mesh.verts) for mesh in meshes])
    verts = np.concatenate([mesh.verts for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)])
    verts, index = np.unique(verts, axis=0, return_inverse=True)
    return verts, index.reshape(-1)[faces]


def edge_keys(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a key for each directed edge, and the key of the opposite edge."""
    a = faces.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    size = int(a.max()) + 1
    return (a * size + b).ravel(), (b * size + a).ravel()


def border(faces: np.ndarray) -> int:
    """Return the number of boundary edges, those without an opposite edge; assert that no directed edge occurs
    twice."""
    there, back = edge_keys(faces)
    assert len(np.unique(there)) == len(there)
    return len(there) - int(np.isin(back, there).sum())


def euler(faces: np.ndarray) -> int:
    return len(np.unique(faces)) - len(np.unique(np.minimum(*edge_keys(faces)))) + len(faces)
