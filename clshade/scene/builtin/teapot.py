"""Martin Newell's teapot (University of Utah, 1975): its patches, its surface, and the images painted on it.

Units and axes of the tables are Newell's: z up from the table at 0 to 3.15, spout towards +x, handle towards -x, in the
proportions that became customary (lower than the pot itself). The 28 bicubic Bezier patches and the 4 of the bottom
are stored in compact form: rotational parts as a profile, symmetric parts as one half.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.arrays import Floats, Floats32, Reals

# One quarter of a surface of revolution. A row (radius, inner, height) stands for the four control points (radius, 0),
# (radius, inner), (inner, radius), (0, radius) at that height. Each patch runs outwards along the outside of the pot.
RIM = ((1.4, 0.784, 2.4), (1.3375, 0.749, 2.53125), (1.4375, 0.805, 2.53125), (1.5, 0.84, 2.4))
BODY_UPPER = ((1.5, 0.84, 2.4), (1.75, 0.98, 1.875), (2.0, 1.12, 1.35), (2.0, 1.12, 0.9))
BODY_LOWER = ((2.0, 1.12, 0.9), (2.0, 1.12, 0.45), (1.5, 0.84, 0.225), (1.5, 0.84, 0.15))
BOTTOM = ((1.5, 0.84, 0.15), (1.5, 0.84, 0.075), (1.425, 0.798, 0.0), (0.0, 0.0, 0.0))
KNOB = ((0.0, 0.0, 3.15), (0.8, 0.45, 3.15), (0.0, 0.0, 2.85), (0.2, 0.112, 2.7))
LID = ((0.2, 0.112, 2.7), (0.4, 0.224, 2.55), (1.3, 0.728, 2.55), (1.3, 0.728, 2.4))

# One half, y <= 0, of the patches symmetric about the plane y = 0: four rows along the tube of four points (x, y, z)
# around it. Handle: from its upper end to its lower end. Spout: from the body to the mouth.
HANDLE_UPPER = (
    ((-1.6, 0.0, 2.025), (-1.6, -0.3, 2.025), (-1.5, -0.3, 2.25), (-1.5, 0.0, 2.25)),
    ((-2.3, 0.0, 2.025), (-2.3, -0.3, 2.025), (-2.5, -0.3, 2.25), (-2.5, 0.0, 2.25)),
    ((-2.7, 0.0, 2.025), (-2.7, -0.3, 2.025), (-3.0, -0.3, 2.25), (-3.0, 0.0, 2.25)),
    ((-2.7, 0.0, 1.8), (-2.7, -0.3, 1.8), (-3.0, -0.3, 1.8), (-3.0, 0.0, 1.8)),
)
HANDLE_LOWER = (
    ((-2.7, 0.0, 1.8), (-2.7, -0.3, 1.8), (-3.0, -0.3, 1.8), (-3.0, 0.0, 1.8)),
    ((-2.7, 0.0, 1.575), (-2.7, -0.3, 1.575), (-3.0, -0.3, 1.35), (-3.0, 0.0, 1.35)),
    ((-2.5, 0.0, 1.125), (-2.5, -0.3, 1.125), (-2.65, -0.3, 0.9375), (-2.65, 0.0, 0.9375)),
    ((-2.0, 0.0, 0.9), (-2.0, -0.3, 0.9), (-1.9, -0.3, 0.6), (-1.9, 0.0, 0.6)),
)
SPOUT_LOWER = (
    ((1.7, 0.0, 1.425), (1.7, -0.66, 1.425), (1.7, -0.66, 0.6), (1.7, 0.0, 0.6)),
    ((2.6, 0.0, 1.425), (2.6, -0.66, 1.425), (3.1, -0.66, 0.825), (3.1, 0.0, 0.825)),
    ((2.3, 0.0, 2.1), (2.3, -0.25, 2.1), (2.4, -0.25, 2.025), (2.4, 0.0, 2.025)),
    ((2.7, 0.0, 2.4), (2.7, -0.25, 2.4), (3.3, -0.25, 2.4), (3.3, 0.0, 2.4)),
)
SPOUT_UPPER = (
    ((2.7, 0.0, 2.4), (2.7, -0.25, 2.4), (3.3, -0.25, 2.4), (3.3, 0.0, 2.4)),
    ((2.8, 0.0, 2.475), (2.8, -0.25, 2.475), (3.525, -0.25, 2.49375), (3.525, 0.0, 2.49375)),
    ((2.9, 0.0, 2.475), (2.9, -0.15, 2.475), (3.45, -0.15, 2.5125), (3.45, 0.0, 2.5125)),
    ((2.8, 0.0, 2.4), (2.8, -0.15, 2.4), (3.2, -0.15, 2.4), (3.2, 0.0, 2.4)),
)


# The surface


def parts(level: int) -> dict[str, Floats]:
    """Return body, seat, lid, handle and spout, y up, each patch cut into level x level cells: positions and unit normals
    of grids of points, (2, rows+1, columns+1, 3).

    (Down the rows) x (along the columns) points outwards. Points on shared borders of patches are equal bit for bit.
    The seat is an addition: a flat ring, one cell wide, that closes the gap between Newell's rim and lid.
    """
    seat = np.linspace(LID[3], RIM[0], 4)
    return {
        "body": _joined([_round(p, level, level) for p in (RIM, BODY_UPPER, BODY_LOWER, BOTTOM)]),
        "seat": _joined([_round(seat, 1, level)]),
        "lid": _joined([_round(p, level, level) for p in (KNOB, LID)]),
        "handle": _joined([_mirrored(p, level) for p in (HANDLE_UPPER, HANDLE_LOWER)]),
        "spout": _joined([_mirrored(p, level) for p in (SPOUT_LOWER, SPOUT_UPPER)]),
    }


def _bernstein(count: int) -> tuple[Floats, Floats]:
    """Return cubic Bernstein polynomials and their derivatives at 0, 1/count ... 1, (count+1, 4); exactly symmetric."""
    t = np.arange(count + 1) / count
    s = t[::-1]
    return (
        np.stack([s * s * s, 3.0 * s * s * t, 3.0 * t * t * s, t * t * t], axis=1),
        np.stack([-3.0 * s * s, 3.0 * s * (s - 2.0 * t), 3.0 * t * (2.0 * s - t), 3.0 * t * t], axis=1),
    )


def _mix(weights: Floats, points: Floats) -> Floats:
    """Return (K, ...) sums of four (4, ...) points by (K, 4) weights, added in the same order for every point."""
    a, b, c, d = (weights[:, k].reshape(-1, *[1] * (points.ndim - 1)) * points[k] for k in range(4))
    return np.asarray((a + d) + (b + c))


def _bezier(points: Floats, rows: int, columns: int) -> Floats:
    """Evaluate the patch of (4, 4, 3) control points, (2, rows+1, columns+1, 3); its normal is (d/drow) x (d/dcolumn).

    In a row of coincident control points, a pole, d/dcolumn is 0; its direction's limit is that of the next row.
    """
    (over, over_slope), (along, along_slope) = (_bernstein(count) for count in (rows, columns))
    across = points.swapaxes(0, 1)
    positions = _mix(over, _mix(along, across).swapaxes(0, 1))
    by_row = _mix(over_slope, _mix(along, across).swapaxes(0, 1))
    by_column = _mix(over, _mix(along_slope, across).swapaxes(0, 1))
    for row, control, neighbor in ((0, 0, 1), (-1, 3, 2)):
        if (points[control] == points[control, 0]).all():
            positions[row] = points[control, 0]
            by_column[row] = _mix(along_slope, points[neighbor])
    normals = np.cross(by_row, by_column)
    return np.stack([positions, normals / np.sqrt((normals * normals).sum(axis=2, keepdims=True))])


def _round(profile: Any, rows: int, columns: int) -> Floats:
    """Revolve a quarter's profile about z: four patches, 4*columns cells around."""
    radius, inner, height = np.array(profile).T
    zero = np.zeros(4)
    quarter = [(radius, zero, height), (radius, inner, height), (inner, radius, height), (zero, radius, height)]
    x, y, z = np.moveaxis(_bezier(np.moveaxis(np.array(quarter), 2, 0), rows, columns)[:, :, :-1], -1, 0)
    quarters = [np.stack(axes, axis=-1) for axes in ((x, y, z), (-y, x, z), (-x, -y, z), (y, -x, z))]
    return np.concatenate([*quarters, quarters[0][:, :, :1]], axis=2)


def _mirrored(half: Any, level: int) -> Floats:
    """Return one half of a tube, y <= 0, and its mirror image, 2*level cells around."""
    points = np.array(half)
    first, second = (_bezier(p, level, level) for p in (points[:, ::-1], points * [1.0, -1.0, 1.0]))
    return np.concatenate([first, second[:, :, 1:]], axis=2)


def _joined(patches: Sequence[Floats]) -> Floats:
    """Join patches, each beginning with the last row of the one before, and turn them from z up to y up."""
    x, y, z = np.moveaxis(np.concatenate([patches[0], *(patch[:, 1:] for patch in patches[1:])], axis=1), -1, 0)
    return np.stack([x, z, 0.0 - y], axis=-1)


# Its shadows on the floor

_REACH, _CELLS = 8.0, 128  # half the side of the square of floor that can be in shadow, and its cells a side


def shadows(lights: Sequence[Floats], points: Floats) -> list[Floats]:
    """Return, for each light (3,), the softened fraction (K,) of it that the pot hides from points on the floor.

    points: (K, 3) on the floor y = 0.
    """
    pot = [positions for positions, _ in parts(24).values()]
    at = [np.clip(_cells(points[:, k]) - 0.5, 0.0, _CELLS - 1.001) for k in (0, 2)]
    (i, j), (u, v) = zip(*((c.astype(np.int64), c % 1.0) for c in at), strict=True)
    hidden = []
    for light in lights:
        cover = _cover(pot, light)
        top, bottom = (cover[row, i] * (1.0 - u) + cover[row, i + 1] * u for row in (j, j + 1))
        hidden.append(top * (1.0 - v) + bottom * v)
    return hidden


def _cells(coordinate: Floats) -> Floats:
    return (coordinate + _REACH) * (_CELLS / (2.0 * _REACH))


def _cover(pot: Sequence[Floats], light: Floats) -> Floats:
    """Return (_CELLS, _CELLS), rows along z: the hidden fraction of each cell of the floor, seen from a light.

    The surface's quads, projected from the light, add their areas to the cells that contain their centers; the surface
    is closed, so each cell is counted at least twice.
    """
    total = np.zeros(_CELLS * _CELLS)
    for grid in pot:
        stretch = light[1] / (light[1] - grid[..., 1])
        x, z = (_cells(light[k] + (grid[..., k] - light[k]) * stretch) for k in (0, 2))
        (ax, bx), (az, bz) = ((c[1:, 1:] - c[:-1, :-1], c[1:, :-1] - c[:-1, 1:]) for c in (x, z))
        area = np.abs(ax * bz - az * bx) / 4.0
        column, row = (np.floor((c[1:, 1:] + c[:-1, :-1]) / 2.0).astype(np.int64) for c in (x, z))
        inside = (column >= 0) & (column < _CELLS) & (row >= 0) & (row < _CELLS)
        total += np.bincount((row * _CELLS + column)[inside], area[inside], _CELLS * _CELLS)
    cover = np.minimum(total, 1.0).reshape(_CELLS, _CELLS)
    for axis in (0, 1) * 4:
        cover = (np.roll(cover, 1, axis) + 2.0 * cover + np.roll(cover, -1, axis)) / 4.0
    return cover


# The images. Distances are in the units of the surface; ink is 0 for none, about 1 for a full stroke.


def body_image() -> Floats32:
    """Return (512, 512, 3): a quarter of the body, 3 wide, 4.45 from inside the rim to the center of the bottom."""
    scale = (3.0 / 512, 4.45 / 512)
    x, y = (np.arange(512) + 0.5) * scale[0], (np.arange(340)[:, None] + 0.5) * scale[1]
    ink = np.tile(
        _lines(y, (0.15, 0.1), (0.34, 0.03), (0.72, 0.025), (0.79, 0.06), (2.06, 0.06), (2.13, 0.025), (2.75, 0.12)),
        (1, 512),
    )
    band = slice(38, 76)
    scallop = 0.38 + 0.22 * np.sqrt(np.abs(np.sin(5.0 / 3.0 * np.pi * x))) - y[band]
    ink[band] += _stroke(scallop, 0.035) + 0.5 * smoothstep(0.04, 0.07, scallop) * (y[band] > 0.35)
    band = slice(250, 310)
    ink[band] += _petals(2.0 * x, y[band], 2.2, 2.68)
    band = slice(110, 216)
    ink[band] += 0.9 * _stroke((1.42 + 0.36 * np.sin(2.0 / 3.0 * np.pi * x) - y[band]) * 0.85, 0.035)
    for turn, start in ((1.0, 0.0), (-1.0, 1.5)):  # the second half of the scroll is the first upside down
        for at, rise, angle, length in ((0.06, 0.06, -0.75, 0.33), (0.02, 0.0, 1.5, 0.4), (-0.15, -0.12, 3.6, 0.36)):
            _leaf(ink, scale, (start + at, 1.42 + turn * rise), turn * angle, length)
        _flower(ink, scale, (start + 0.75, 1.42 - 0.12 * turn), 0.4)
    painted = _glazed(ink, 1)
    return np.concatenate([painted, np.broadcast_to(painted[-1], (512 - len(painted), 512, 3))])  # the foot is plain


def lid_image() -> Floats32:
    """Return (256, 256, 3): a quarter of the lid, 2.25 from the top of the knob to the edge."""
    x, y = (np.arange(256) + 0.5) / 256, (np.arange(256)[:, None] + 0.5) * (2.25 / 256)
    ink = _lines(y, (0.0, 0.56), (0.66, 0.05), (0.93, 0.08), (1.03, 0.03), (1.95, 0.05), (2.1, 0.12))
    return _glazed(ink + _petals(3.0 * x, y, 1.86, 1.08), 2)


def tube_image() -> Floats32:
    """Return (256, 128, 3): handle or spout, once around (columns), 4 from end to end: a winding stem on each side."""
    x, y = (np.arange(128) + 0.5) / 64 % 1.0, (np.arange(256)[:, None] + 0.5) / 64
    ink = 0.9 * _stroke(0.5 + 0.16 * np.sin(2.0 * np.pi * y) - x, 0.05, 0.03)
    ink += _lines(y, (0.3, 0.12), (0.45, 0.04), (3.55, 0.04), (3.7, 0.12), (4.0, 0.2))
    for k in range(1, 7):
        for side in (0.5, 1.5):
            _leaf(ink, (1 / 64, 1 / 64), (side, 0.5 + 0.5 * k), 1.57 + 0.8 * (-1.0) ** k, 0.4)
    return _glazed(ink, 3)


def marble_image() -> Floats32:
    """Return (384, 384, 3): two by two tiles of a darker and a lighter marble."""
    x = (np.arange(384) + 0.5) / 384
    y = x[:, None]
    noise = _clouds(384, 4, 10)
    light = (x < 0.5) ^ (y < 0.5)
    veins = 1.0 - np.abs(np.sin(2.0 * np.pi * np.where(light, x + 2.0 * y, 2.0 * x - y) + 0.9 * noise))
    veins = np.square(np.square(veins)) * veins * (0.35 + 0.65 * np.roll(noise, 150))
    stone = np.where(light, 0.34 - 0.16 * veins + 0.03 * noise, 0.20 + 0.14 * veins + 0.02 * noise)
    joint = smoothstep(0.004, 0.016, np.abs((2.0 * x + 0.5) % 1.0 - 0.5))
    return quantized((stone * (0.35 + 0.65 * joint * joint[:, None]))[..., None] * np.array([1.0, 0.95, 0.88]))


def swirl_image() -> Floats32:
    """Return (256, 256, 3): winding stripes, smooth enough for lookups at vertices only."""
    u, v = (np.arange(256) + 0.5) / 256, (np.arange(256)[:, None] + 0.5) / 256
    stripe = smoothstep(0.1, 0.9, 0.5 + 0.5 * np.sin(2.0 * np.pi * (4.0 * u + v)))[..., None]
    dark, light = np.array([[0.04, 0.29, 0.36], [0.55, 0.49, 0.36]])
    return quantized(stripe * light + (1.0 - stripe) * dark)


def smoothstep(edge0: float, edge1: float, x: Reals) -> Floats:
    """Return 0 on the side of edge0, 1 on that of edge1, and a cubic between."""
    t = np.clip((x - edge0) / (edge1 - edge0), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def quantized(colors: Floats) -> Floats32:
    """Round colors to multiples of 2^-12, so that the last bit of a machine's cosine does not show in a texture."""
    colors = colors * 4096.0
    return np.asarray(np.rint(colors, out=colors).astype(np.float32) * np.float32(1.0 / 4096.0))


def _clouds(size: int, seed: int, scale: int) -> Floats:
    """Return (size, size) smooth noise of about unit size, periodic, of up to `scale` waves per side.

    A sum of waves sampled at every fourth texel, with bilinear interpolation between.
    """
    rng = np.random.default_rng(seed)
    turn = 2.0 * np.pi * np.arange(size // 4) / (size // 4)
    noise = np.zeros((size // 4, size // 4))
    for _ in range(4 * scale):
        (i, j), (right, down) = rng.integers(0, scale + 1, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
        noise += np.cos(i * turn + right) / (1.0 + math.hypot(i, j)) * np.cos(j * turn + down)[:, None]
    for _ in range(2):
        step = (np.roll(noise, -1, axis=0) - noise) / 4.0
        finer = np.empty((size, noise.shape[1]))
        for k in range(4):
            finer[k::4] = noise + k * step
        noise = np.ascontiguousarray(finer.T)
    return noise


def _glazed(ink: Floats, seed: int) -> Floats32:
    """Return cobalt ink under a white glaze: the light reflected through the ink, with slight brush variation."""
    rows, columns = ink.shape
    passed = np.exp(-ink * (1.0 + 0.18 * _clouds(columns, seed, 8)[np.arange(rows) % columns]))
    cubed = passed * passed * passed
    return quantized(np.stack([0.80 * cubed * passed, 0.80 * cubed, 0.77 * passed], axis=2))


def _stroke(distance: Reals, width: float, soft: float = 0.02) -> Floats:
    return 1.0 - smoothstep(width / 2.0 - soft, width / 2.0 + soft, np.abs(distance))


def _lines(y: Reals, *strokes: tuple[float, float]) -> Floats:
    return np.asarray(np.sum([_stroke(y - at, width) for at, width in strokes], axis=0))


def _petals(x: Reals, y: Reals, tip: float, base: float) -> Floats:
    """Return a row of pointed petals, one per unit of x, from their tips at y = tip to y = base."""
    t = np.clip((y - tip) / (base - tip), 0.0, 1.0)
    edge = 0.46 * np.sqrt(t) * (1.3 - 0.3 * t) - np.abs(x % 1.0 - 0.5)
    inside = (y > min(tip, base)) & (y < max(tip, base))
    return np.asarray(inside * (_stroke(edge, 0.05, 0.05) + smoothstep(0.1, 0.16, edge) * (0.25 + 0.55 * (1.0 - t))))


def _window(ink: Floats, scale: Sequence[float], at: Sequence[float], reach: float) -> tuple[Any, Reals, Reals]:
    """Return the index of the texels within `reach` of a point (columns repeat), and their x and y offsets from it."""
    columns, rows = (
        np.arange(math.floor((c - reach) / unit), math.ceil((c + reach) / unit))
        for c, unit in zip(at, scale, strict=True)
    )
    rows = rows[(rows >= 0) & (rows < len(ink))]
    dx, dy = (columns + 0.5) * scale[0] - at[0], (rows[:, None] + 0.5) * scale[1] - at[1]
    return np.ix_(rows, columns % ink.shape[1]), dx, dy


def _leaf(ink: Floats, scale: Sequence[float], at: Sequence[float], angle: float, length: float) -> None:
    """Paint a leaf that starts at a point in direction `angle`, darker towards its tip, with a light vein."""
    window, dx, dy = _window(ink, scale, at, length)
    along = (dx * math.cos(angle) + dy * math.sin(angle)) / length
    across = np.abs(dy * math.cos(angle) - dx * math.sin(angle)) / length
    inside = smoothstep(0.0, 0.06, 0.9 * along * (1.0 - along) - across)
    leaf = inside * (0.35 + 0.4 * along + 0.2 * smoothstep(0.01, 0.04, across))
    ink[window] = np.maximum(ink[window], leaf)


def _flower(ink: Floats, scale: Sequence[float], at: Sequence[float], radius: float) -> None:
    """Paint three rings of petals, each dark at its edge, over the existing ink."""
    window, dx, dy = _window(ink, scale, at, 1.2 * radius)
    distance, angle = np.hypot(dx, dy) / radius, np.arctan2(dy, dx)
    flower = np.zeros(distance.shape)
    for size, petals, turn in ((1.0, 8, 0.0), (0.68, 8, 0.39), (0.38, 5, 0.0)):
        edge = size * (0.8 + 0.2 * np.abs(np.cos(0.5 * petals * (angle + turn)))) - distance
        petal = 0.2 + 0.7 * smoothstep(0.26, 0.0, edge) ** 2
        flower += smoothstep(-0.025, 0.025, edge) * (petal - flower)
    flower += 0.8 * smoothstep(0.14, 0.08, distance)
    clear = smoothstep(1.15, 1.05, distance)
    ink[window] = ink[window] * (1.0 - clear) + clear * flower
