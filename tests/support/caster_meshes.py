"""Meshes that cast shadows, and points on them."""

import numpy as np

Array = np.ndarray
Mesh = tuple[Array, Array]  # vertices (V, 3), faces (F, 3)


def face_points(mesh: Mesh, count: int, seed: int = 1, together: int = 1) -> tuple[Array, Array]:
    """Return points (K, 3) on random faces, and the faces (K,). together: how many in a row lie on one face."""
    rng = np.random.default_rng(seed)
    vertices, faces = mesh
    chosen = np.repeat(rng.integers(0, len(faces), count // together), together)
    return (vertices[faces[chosen]] * rng.dirichlet([1.0, 1.0, 1.0], count)[:, :, None]).sum(axis=1), chosen


def border_points(mesh: Mesh, count: int, seed: int = 2) -> tuple[Array, Array]:
    """Return points on vertices and edges of random faces."""
    rng = np.random.default_rng(seed)
    vertices, faces = mesh
    chosen = rng.integers(0, len(faces), count)
    part = rng.choice([0.0, 0.25, 0.5, 1.0], count)
    weights = rng.permuted(np.stack([part, 1.0 - part, np.zeros(count)], axis=1), axis=1)
    return (vertices[faces[chosen]] * weights[:, :, None]).sum(axis=1), chosen


def soup(count: int = 60, seed: int = 3) -> Mesh:
    """Return triangles that cross each other."""
    return np.random.default_rng(seed).normal(size=(3 * count, 3)), np.arange(3 * count).reshape(-1, 3)


def box() -> Mesh:
    """Return a closed cube from -1 to 1."""
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def sphere(rings: int = 6, sides: int = 8) -> Mesh:
    """Return a closed sphere of radius 1."""
    polar = np.linspace(0.0, np.pi, rings + 1)[1:-1, None]
    around = np.arange(sides) * 2.0 * np.pi / sides
    ring = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar) + 0.0 * around], -1)
    vertices = np.concatenate([[[0.0, 0.0, 1.0]], ring.reshape(-1, 3), [[0.0, 0.0, -1.0]]])
    last = len(vertices) - 1
    faces = [(0, 1 + i, 1 + (i + 1) % sides) for i in range(sides)]
    for r in range(rings - 2):
        for i in range(sides):
            a, b = 1 + r * sides + i, 1 + r * sides + (i + 1) % sides
            faces += [(a, a + sides, b + sides), (a, b + sides, b)]
    faces += [(last, last - sides + (i + 1) % sides, last - sides + i) for i in range(sides)]
    return vertices, np.array(faces)


def lattice(side: int = 6, turned: bool = False) -> Mesh:
    """Return a flat square of 2 side^2 triangles, axis-aligned, or turned by some angles."""
    steps = np.arange(side + 1) / side - 0.5
    x, y = np.meshgrid(steps, steps)
    vertices = np.stack([x.reshape(-1), y.reshape(-1), np.zeros(x.size)], axis=1)
    if turned:
        rotation, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
        vertices = vertices @ rotation.T
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    faces = np.concatenate([np.stack([a, a + 1, a + side + 2], 1), np.stack([a, a + side + 2, a + side + 1], 1)])
    return vertices, faces


def joined(*meshes: Mesh) -> Mesh:
    first = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    faces = [f + start for (_, f), start in zip(meshes, first, strict=False)]
    return np.concatenate([v for v, _ in meshes]), np.concatenate(faces)


def moved(mesh: Mesh, by: float, scale: float = 1.0) -> Mesh:
    return mesh[0] * scale + by, mesh[1]


def slivers(seed: int = 6) -> Mesh:
    """Return triangles of which one corner is within 1e-7 to 1e-15 of the opposite edge."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 40, 3))
    c = a + rng.random((40, 1)) * (b - a) + 10.0 ** rng.uniform(-15.0, -7.0, (40, 1)) * rng.normal(size=(40, 3))
    return np.stack([a, b, c], axis=1).reshape(-1, 3), np.arange(120).reshape(-1, 3)


def crumpled(side: int) -> Mesh:
    """Return a lattice with heights: close receivers and casters, as in images."""
    vertices, faces = lattice(side)
    vertices[:, 2] = 0.1 * np.random.default_rng(2).random(len(vertices))
    return vertices, faces
