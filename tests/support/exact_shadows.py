"""Shadows in exact integer arithmetic, by the definition in kernels/shadow_predicate.clh: `dark`, `lit`, or `either` where a
determinant is within twice the kernel's bound without being 0."""

from typing import NamedTuple

import numpy as np

from clshade.pipeline.hierarchy import CasterFrame
from clshade.pipeline.struct_layout import RECEIVER_UNITS, SHADOW_GRID

Array = np.ndarray
LIT, DARK, EITHER = 0, 1, 2
_SCALE = 1 << 180  # every float32 of a light is a multiple of 1 / _SCALE, but for those of less than 2^-149
_ONE = 22, 48  # 22 * 2^-48 of the magnitude: of one determinant
_TWO = 25, 48
_CENTROID = 31, 48

_integers = np.frompyfunc(int, 1, 1)


def integers(pairs: Array) -> Array:
    """Return (..., 3) Python integers of pairs (..., 6): coordinates in units of the grid."""
    return _integers((pairs[..., :3].astype(np.float64) + pairs[..., 3:]) / SHADOW_GRID)


def cross(a: Array, b: Array) -> tuple[Array, Array]:
    """Return cross products (..., 3), and the sums of the magnitudes of each component's terms."""
    left, right = a[..., [1, 2, 0]] * b[..., [2, 0, 1]], a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
    return left - right, abs(left) + abs(right)


def dot(normal: tuple[Array, Array], v: Array) -> tuple[Array, Array]:
    return (normal[0] * v).sum(axis=-1), (normal[1] * abs(v)).sum(axis=-1)


class Signs(NamedTuple):
    """The signs that the kernel may find: both are the same where that is certain."""

    one: Array
    alternative: Array


def _sign(value: Array) -> Array:
    return np.asarray(value > 0, int) - np.asarray(value < 0, int)


def signs(value: Array, magnitude: Array, error: tuple[int, int]) -> Signs:
    """Return the signs of values with a relative error of error[0] * 2^-error[1]: 0 of 0, 0 or its own of a small one."""
    exact = _sign(value)
    small = abs(value) << error[1] <= 2 * error[0] * magnitude
    return Signs(np.where(np.asarray(small, bool), 0, exact), exact)


def _opposite(a: Signs, b: Signs) -> tuple[Array, Array]:
    """Return where the signs may be opposite, and where they must."""
    products = [x * y for x in a for y in b]
    return np.any([p < 0 for p in products], axis=0), np.all([p < 0 for p in products], axis=0)


def _alike(a: Signs, b: Signs) -> tuple[Array, Array]:
    """Return where the signs may be alike or one of them 0, and where they must."""
    products = [x * y for x in a for y in b]
    return np.any([p >= 0 for p in products], axis=0), np.all([p >= 0 for p in products], axis=0)


class ExactShadows:
    """Triangles, and the shadows that they cast. vertices: (V, 3) float64. faces: (F, 3)."""

    def __init__(self, vertices: Array, faces: Array) -> None:
        self.frame = CasterFrame.around(np.asarray(vertices, np.float64))
        self.faces = np.asarray(faces)
        pairs = self.frame.pairs(vertices)
        self.corners = integers(pairs)[self.faces]
        rank = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)[self.faces]
        self.forward = rank < np.roll(rank, -1, axis=1)  # sides that lead from the end that comes first
        a, b, c = np.moveaxis(self.corners, 1, 0)
        self.normals = cross(b - a, c - a)

    def of(self, points: Array, receivers: Array, light: Array) -> Array:
        """Return LIT, DARK or EITHER for points (K, 3) on faces (K,) and a light (4,)."""
        row = self.frame.light(np.asarray(light, np.float64))[0]
        position = np.array([_exact(high) + _exact(low) for high, low in zip(row["high"], row["low"], strict=True)])
        at = integers(self.frame.pairs(points))
        return np.array([self._one(p, r, position, _exact(row["w"])) for p, r in zip(at, receivers, strict=True)])

    def _one(self, point: Array, receiver: int, light: Array, w: int) -> int:
        per_unit = round(1 / SHADOW_GRID)
        toward = light * per_unit - w * point  # times _SCALE / SHADOW_GRID
        receiver_normal = self.normals[0][receiver], self.normals[1][receiver]
        first = self.corners[receiver, 0]

        def light_side(normal: tuple[Array, Array], corner: Array) -> Signs:
            d, of_d = dot(normal, toward)
            p, of_p = dot(normal, corner - point)
            return signs(np.array(d - w * p), np.array(of_d + w * of_p), _TWO)

        side = light_side(receiver_normal, first)
        heights = [signs(*dot(receiver_normal, self.corners[:, k] - first), _ONE) for k in range(3)]
        above = [np.array([side[i] * h[j] > 0 for h in heights]).any(axis=0) for i in (0, 1) for j in (0, 1)]
        may, must = np.any(above, axis=0), np.all(above, axis=0)

        a = self.corners[:, 0]
        of_light = light_side(self.normals, a)
        height, magnitude = dot(self.normals, a - point)
        bound = _ONE[0] * magnitude + (RECEIVER_UNITS * abs(self.normals[0]).sum(axis=-1) << 48)  # times 2^48
        exact, size = _sign(-height), abs(height) << 48
        near = size <= 2 * bound, 2 * size <= bound  # may be, must be
        centroid = (self.corners[receiver] - a[:, None]).sum(axis=1)
        of_sum = (self.normals[1] * abs(self.corners[receiver] - a[:, None]).sum(axis=1)).sum(axis=-1)
        of_centroid = signs((self.normals[0] * centroid).sum(axis=-1), of_sum, _CENTROID)
        direct = _opposite(of_light, Signs(exact, exact))
        central = _opposite(of_light, of_centroid)
        near_may, near_must = (np.asarray(mask, bool) for mask in near)
        may &= (direct[0] & ~near_must) | (central[0] & near_may)
        must &= (direct[1] | near_must) & (central[1] | ~near_may)
        touching_may, touching_must = np.zeros((2, len(self.faces)), bool)
        for k in range(3):
            forward, ends = self.forward[:, k, None], (self.corners[:, k], self.corners[:, (k + 1) % 3])
            start, end = np.where(forward, *ends), np.where(forward, *ends[::-1])
            turn = np.where(self.forward[:, k], 1, -1)
            toward_inside = Signs(turn * of_light.one, turn * of_light.alternative)
            volume, magnitude = dot(cross(start - point, end - start), toward)
            direct = _alike(toward_inside, signs(volume, magnitude, _ONE))
            central = _alike(toward_inside, self._centroid_sides(receiver, start, end - start, toward, w, point))
            size = abs(volume) << _ONE[1]
            off = RECEIVER_UNITS * abs(cross(end - start, toward)[0]).sum(axis=-1) << _ONE[1]
            upper, lower = (_ONE[0] * magnitude + np.where(mask, off, 0) for mask in (near_may, near_must))
            zero_may, zero_must = np.asarray(size <= 2 * upper, bool), np.asarray(2 * size <= lower, bool)
            tie_may, tie_must = near_may & zero_may, near_must & zero_must
            may &= (direct[0] & ~tie_must) | (central[0] & tie_may)
            must &= (direct[1] | tie_must) & (central[1] | ~tie_may)
            touching_may |= zero_may
            touching_must |= zero_must
        beside_may, beside_must = self._beside(toward, w, point)
        may &= ~(touching_must & beside_must)
        must &= ~(touching_may & beside_may)
        may[receiver] = must[receiver] = False
        return DARK if must.any() else EITHER if may.any() else LIT

    def _beside(self, toward: Array, w: int, point: Array) -> tuple[Array, Array]:
        """Return where, seen along an axis, all corners may lie on one side of the line, and where they must."""
        corners = self.corners - point
        value, magnitude = cross(corners, np.broadcast_to(toward, corners.shape))
        off = abs(toward) + w * abs(corners)
        bound = _ONE[0] * magnitude + (RECEIVER_UNITS * (off[..., [1, 0, 0]] + off[..., [2, 2, 1]]) << _ONE[1])

        def one_side(beyond: Array) -> Array:
            return (abs(np.where(np.asarray(beyond, bool), _sign(value), 0).sum(axis=1)) == 3).any(axis=-1)

        size = abs(value) << _ONE[1]
        return one_side(2 * size >= bound), one_side(size >= 2 * bound)

    def _centroid_sides(self, receiver: int, start: Array, side: Array, toward: Array, w: int, point: Array) -> Signs:
        """Return on which sides of planes through the light and triangles' sides a receiver's centroid lies."""
        moved = w * (start - point)
        light, of_light = toward - moved, abs(toward) + abs(moved)
        normal = cross(side, light)[0], cross(abs(side), of_light)[1]
        offsets = self.corners[receiver] - start[:, None]
        return signs(-dot(normal, offsets.sum(axis=1))[0], dot(normal, abs(offsets).sum(axis=1))[1], _CENTROID)


def _exact(number: np.float32) -> int:
    """Return a float32 in units of 1 / _SCALE."""
    numerator, denominator = float(number).as_integer_ratio()
    return numerator * (_SCALE // denominator)
