"""Error against stiffness, of this renderer and of the same computation in plain float32."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ... import oracle
from ...base.arrays import Array, Bools, Floats
from ...images import figures
from ...oracle import coverage, shade, terms, transform
from ...scene.model import Scene, Settings
from ..check import oracle_bounds
from .cases import flat, lit
from .cases.bench import Bench, expected_light
from .cases.light import DISTANCES, exact_highlights, in_the_lobe, lobe_error, near_light, unit
from .cases.surfaces import centered

F = np.float32
FAN = 0.2  # angle of the fan of needles, radians


@dataclass(frozen=True)
class Curve:
    """One plot. ours, naive, bound: the error at each stiffness; bound may be empty."""

    title: str
    x_label: str
    y_label: str
    stiffness: tuple[float, ...]
    ours: tuple[float, ...]
    naive: tuple[float, ...]
    bound: tuple[float, ...] = ()
    least: float = 0.0  # zero is drawn at this value


def measure(bench: Bench) -> tuple[Curve, ...]:
    """Measure the four curves of the figure."""
    return exponent(bench), offset(bench), needles(bench), distance(bench)


# Light


def naive_light(points: Array, normals: Array, position: Array, n: float, kd: float, ks: float) -> Floats:
    """Evaluate the reflection model in plain float32, (K,): directions divided by their lengths, pow of R.V."""
    points, normals, position = F(points), F(normals), F(position)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        to_eye, to_light = (v / np.sqrt((v * v).sum(axis=1, dtype=F))[:, None] for v in (-points, position - points))
        cosine = (normals * to_light).sum(axis=1, dtype=F)
        mirrored = F(2) * cosine[:, None] * normals - to_light
        base = np.maximum((mirrored * to_eye).sum(axis=1, dtype=F), F(0))
        highlight = np.where((cosine > 0) & (base > 0), np.power(base, F(n)), F(0))
    shine: Floats = (F(kd) * np.maximum(cosine, F(0)) + F(ks) * highlight).astype(np.float64)
    return shine


def exponent(bench: Bench, step: float = 0.5) -> Curve:
    """Measure the highlight's error for n from 1 to 1e9, in steps of 10^step."""
    powers = tuple(10.0**p for p in np.arange(0.0, 9.01, step))
    ours, naive = [], []
    for n in powers:
        points, normals, light = in_the_lobe(n, 300)
        exact = exact_highlights(points, normals, light, n)
        found = bench.light(points, normals, (light[None], np.ones((1, 3))), n=n, kd=0.0)[:, 0]
        scale = math.sqrt(n) * oracle_bounds.HALF_ULP
        ours.append(lobe_error(found.astype(np.float64), exact, n) * scale)
        naive.append(lobe_error(naive_light(points, normals, light, n, 0.0, 1.0), exact, n) * scale)
    bound = tuple(16.0 * math.sqrt(n) * oracle_bounds.HALF_ULP for n in powers)
    labels = "specular exponent n", "largest relative error"
    return Curve("Highlight", *labels, powers, tuple(ours), tuple(naive), bound)


def distance(bench: Bench) -> Curve:
    """Measure the error at n = 1000 at a thousand points of a sheet, relative to the light budget."""
    n = 1000.0
    rng = np.random.default_rng(24)
    x, y = rng.uniform(-1, 1, (2, 1000))
    points = np.stack([x, y, 0.15 * (1.0 - x * x - 0.5 * y * y)], axis=1)
    points[:100] = [0.013, 0.021, 0.15 * (1.0 - 0.013**2 - 0.5 * 0.021**2)] + points[:100] * 1e-6
    normals = unit(np.stack([0.3 * points[:, 0], 0.15 * points[:, 1], np.ones(1000)], axis=1)).astype(F)
    eye = np.array([0.3, 0.2, 5.0])
    seen = (points - eye).astype(F).astype(np.float64)
    ours, naive = [], []
    for reach in DISTANCES:
        position = (near_light(reach)[0][:1] - eye).astype(F).astype(np.float64)
        lights = position, np.ones((1, 3))
        expected = expected_light(seen, normals, lights, n)
        at = terms.Directions.at(seen, normals.astype(np.float64), np.zeros(3), position[0])
        gate = np.minimum(np.abs(at.n_l), np.abs(terms.mirrored(at)[0])) < shade.GATE
        budget = np.where(gate, 1e30, expected.budget[0, :, 0])
        found = bench.light(seen, normals, lights, n=n)[:, 0].astype(np.float64)
        plain = naive_light(seen, normals, position, n, 1.0, 1.0)
        ours.append(_largest(np.abs(found - expected.rgb[0, :, 0]) / budget))
        naive.append(_largest(np.abs(plain - expected.rgb[0, :, 0]) / budget))
    return Curve(
        "Light distance",
        "distance of the light",
        "largest error / light budget, n = 1000",
        DISTANCES,
        tuple(ours),
        tuple(naive),
        least=1e-9,
    )


def _largest(values: Array) -> float:
    return float(np.where(np.isfinite(values), values, 1.0).max())


# Geometry


def naive_ids(scene: Scene) -> Array:
    """Return the owners (M, N), row 0 at the top, with a projection in float32 and painter's order."""
    mesh, camera = scene.meshes[0], scene.camera
    columns, rows = camera.resolution
    axes = transform.camera_frame(F(camera.eye), F(camera.lookat), camera.up).astype(F)
    points = (F(mesh.verts)[mesh.faces] - F(camera.eye)) @ axes.T
    z = points[..., 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        uv = (F(camera.focal) * points[..., :2] / (z[..., None] * np.array(camera.plane[::-1], F)) + F(0.5)) * np.array(
            [columns, rows], F
        )
    usable = (z > 1e-3).all(axis=1) & (np.abs(uv) < 32767).all(axis=(1, 2))
    xy = np.where(usable[:, None, None], np.rint(uv * F(256)), 0).astype(np.int64)
    setup = coverage.setup(xy, columns, rows)
    order = coverage.painter_order(z.astype(np.float64), ~setup.culled)
    rank = np.full(columns * rows, len(order))
    for k, column, row, _ in coverage.samples(xy[order], setup.box[order]):
        np.minimum.at(rank, (rows - 1 - row) * columns + column, k)
    owners: Array = (np.append(order, -1)[rank] + 1).reshape(rows, columns)
    return owners


def offset(bench: Bench) -> Curve:
    shifts = tuple(10.0**p for p in range(10))
    settings = Settings.from_preset("course", layers=("Z", "id"))
    ours, naive = [], []
    for shift in shifts:
        scene = lit.shifted(centered(), 1.0, shift)
        expected = oracle.render(scene, settings).id
        ours.append(float((bench.draw(scene, settings=settings)["id"] != expected).sum()))
        naive.append(float((naive_ids(scene) != expected).sum()))
    labels = "offset of the whole scene", "wrong pixels of 3721"
    return Curve("Projection", *labels, shifts, tuple(ours), tuple(naive), least=0.5)


def _fan(count: int) -> tuple[Array, Array]:
    center, angle = np.array([10.1, 20.2]), np.linspace(0.7, 0.7 + FAN, count + 1)
    return np.concatenate([center[None], center + 650.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)]), angle


def naive_counts(fan: Array, angle: Array, inside: Array) -> Array:
    """Return how many needles cover each pixel of `inside` (M, N), (K,), by float32 edge functions of unsnapped
    positions; only the needles next to a pixel are tested."""
    row, column = np.nonzero(inside)
    x, y = column + 0.5, len(inside) - 0.5 - row
    step = (angle[-1] - angle[0]) / (len(angle) - 1)
    nearest = np.floor((np.arctan2(y - fan[0, 1], x - fan[0, 0]) - angle[0]) / step).astype(np.int64)
    px, py, corners = F(x), F(y), F(fan)
    count = np.zeros(len(row), np.int64)

    def positive(a: Array, b: Array) -> Bools:
        dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
        value = dx * (py - a[..., 1]) - dy * (px - a[..., 0])
        inside: Bools = (value > 0) | ((value == 0) & ((dy < 0) | ((dy == 0) & (dx < 0))))
        return inside

    for beside in range(-3, 4):
        k = nearest + beside
        real = (k >= 0) & (k < len(angle) - 1)
        first, second = (corners[np.where(real, k, 0) + 1 + i] for i in (0, 1))
        center = np.broadcast_to(corners[0], first.shape)
        count += real & positive(center, first) & positive(first, second) & positive(second, center)
    return count


def needles(bench: Bench) -> Curve:
    aspects = (10.0, 100.0, 1e3, 1e4, 1e5, 1e6)
    resolution = (540, 540)
    ours, naive = [], []
    for aspect in aspects:
        fan, angle = _fan(max(2, round(FAN * aspect)))
        k = np.arange(1, len(angle))[:, None]
        faces = np.concatenate([np.zeros_like(k), k, k + 1], axis=1)
        # Inside the fan, and clear of the chords of its rim.
        wedge = np.stack([fan[0], *(fan[0] + 0.99 * np.cos(FAN / 2) * (fan[[1, -1]] - fan[0]))])
        inside = flat.polygon_interior(wedge, resolution)
        ours.append(float(flat.drawn_once(bench, flat.scene_of(fan, faces, resolution), inside).wrong))
        naive.append(float((naive_counts(fan, angle, inside) != 1).sum()))
    labels = "aspect of the needles", f"pixels not drawn once, of {int(inside.sum())}"
    return Curve("Coverage", *labels, aspects, tuple(ours), tuple(naive), least=0.5)


def plot(curves: tuple[Curve, ...], path: Path, device: str) -> None:
    """Draw the figure as PNG."""
    figure = figures.blank(11.0, 8.0)
    for axes, curve in zip(figure.subplots(2, 2).flat, curves, strict=True):
        # Errors above ten times the correct value are all drawn alike.
        most = 10.0 if not curve.least else math.inf
        shown = [[min(max(v, curve.least), most) for v in values] for values in (curve.naive, curve.ours)]
        axes.loglog(curve.stiffness, shown[0], "o--", color=figures.OTHER, label="plain float32")
        axes.loglog(curve.stiffness, shown[1], "o-", color=figures.OURS, label="clshade")
        if curve.bound:
            axes.loglog(curve.stiffness, curve.bound, ":", color=figures.MUTED, label="bound 16 sqrt(n) 2^-24")
        if curve.least == 0.5:
            axes.axhline(0.5, color=figures.MUTED, lw=0.5)
            axes.text(curve.stiffness[0], 0.53, "none", color=figures.MUTED, fontsize=8)
        axes.set(title=curve.title, xlabel=curve.x_label, ylabel=curve.y_label)
        axes.grid(True, alpha=0.3)
        axes.legend()
    figure.suptitle(f"Error against stiffness, {device}")
    figures.save(figure, path)
