"""Error and time against stiffness along three axes: the exponent, the distance from the origin, the aspect of triangles.

Each scene is drawn in every precision, and in plain float32 for comparison. The oracle says what is right.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ... import oracle
from ...base.arrays import Array
from ...errors import InputError
from ...oracle import OracleFrame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.camera import Camera
from ...scene.model import Material, Mesh, PointLight, Scene, Settings
from ...scene.settings import Precision
from ..bench.peers.numpy_arrays import Projected, Vectorized
from ..report.measure import frame_ms
from ..report.power_law import Law, Power, fitted
from ..timing import Spread, in_turns, spread
from .cases import lit
from .cases.flat import SUB
from .cases.light import unit

SIDE = 160  # pixels of the images
NEAR = 1e-2  # of the near plane: a scene's size says nothing about it here
FRAMES, SECONDS = 15, 10.0  # of each way at each stiffness, all of an axis in turns
PLAIN = "plain float32"
WAYS: dict[str, Precision] = {"standard": "float32", "fast": "fast", "float64": "float64"}  # and their precision
USELESS = 0.03  # RMS errors above this share of the light are of images that show nothing right, and follow no power


class Point(NamedTuple):
    """One way at one stiffness.

    rms, largest: of |value - oracle| / the most light that a point can send, over all pixels; None where the way cannot draw
    the scene. wrong: pixels of wrong coverage. ms: milliseconds of a frame.
    """

    stiffness: float
    rms: float | None
    largest: float | None
    wrong: int | None
    ms: Spread | None


@dataclass(frozen=True, eq=False)
class Series:
    """One way along one axis."""

    way: str
    points: tuple[Point, ...]

    @property
    def fit(self) -> tuple[Point, ...]:
        """The points whose errors follow a power: neither 0 nor those of useless images."""
        return tuple(each for each in self.points if each.rms and each.rms < USELESS)

    def power(self) -> Power | None:
        """Return the power of the stiffness that errors follow; None for fewer than three."""
        found = self.fit
        return (
            fitted([each.stiffness for each in found], [each.rms or 0.0 for each in found]) if len(found) > 2 else None
        )

    def time_power(self) -> Power | None:
        """Return the power of the stiffness that times follow."""
        timed = [each for each in self.points if each.ms]
        times = [each.ms.median for each in timed if each.ms]
        return fitted([each.stiffness for each in timed], times) if len(timed) > 2 else None


@dataclass(frozen=True, eq=False)
class Axis:
    """What grows along an axis.

    name: for files. title, label: in words. stiffness: the values. scene: draws one. law: the power that theory gives for
    this renderer in float32; plain_law: for plain float32. own: the oracle's own error at a stiffness.
    """

    name: str
    title: str
    label: str
    stiffness: tuple[float, ...]
    scene: Callable[[float], Scene]
    law: Law
    plain_law: Law
    own: Callable[[float], float]
    own_about: str

    def expected(self, way: str) -> Law:
        return self.plain_law if way == PLAIN else self.law


# Scenes


def highlight(n: float) -> Scene:
    """Return a flat surface with a highlight that fills the image, whatever its exponent: the lobe |R - V| < sqrt(2/n)."""
    eye, light = np.array([0.7, -0.4, 1.9]), np.array([-1.1, 0.8, 2.4])
    reach = np.linalg.norm(eye), np.linalg.norm(light)
    normal = unit(unit(eye) + unit(light))
    across = unit(np.cross(normal, [0.3, 1.0, 0.2]))
    up = np.cross(normal, across)
    # A step x along the surface turns R - V by about x (1/reach + 1/reach).
    half = min(math.sqrt(2.0 / n) / float(1.0 / reach[0] + 1.0 / reach[1]), 0.5)
    corners = [2.0 * half * (x * across + y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh = Mesh(
        np.array(corners),
        np.array([[0, 1, 2], [0, 2, 3]]),
        normals=np.tile(normal, (4, 1)),
        material=Material(ka=0.1, kd=0.2, ks=0.8, n=n),
    )
    width = 2.0 * half / float(reach[0])
    camera = Camera(eye, np.zeros(3), up, 1.0, (width, width), (SIDE, SIDE))
    return Scene((mesh,), camera, (PointLight(light, np.ones(3)),), name="highlight")


def moved(distance: float) -> Scene:
    """Return a bent sheet with its camera and lights, all moved by the same vector of this length, without rounding."""
    camera = replace(lit.CAMERA, eye=np.array([0.25, 0.25, 5.0]), lookat=np.zeros(3), resolution=(SIDE, SIDE))
    lights = (PointLight(np.array([3.0, 4.0, 5.0]), np.ones(3)),)
    sheet = lit.on_a_grid(lit.patch(cells=12), 20)
    scene = Scene((sheet,), camera, lights, name="moved")
    whole = np.round(distance * unit(np.array([2.0, -1.0, 2.0])))  # whole numbers: coordinates stay exact in float64
    return lit.shifted(scene, 1.0, whole)


def needle(aspect: float) -> Scene:
    """Return a triangle two units high and seen there, with two corners far to the left and right."""
    turned = np.array([[math.cos(0.3), math.sin(0.3), 0.0], [-math.sin(0.3), math.cos(0.3), 0.0]])
    corners = np.array([[-1.1 * aspect, -1.0], [0.9 * aspect, -1.0], [0.1, 1.0]]) * (1.0 + 2.0**-40)
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    mesh = Mesh(corners @ turned, np.array([[0, 1, 2]]), normals=normals, material=lit.MATERIAL)
    eye = lit.CAMERA.eye
    camera = replace(lit.CAMERA, lookat=eye - [0.0, 0.0, 1.0], resolution=(SIDE, SIDE))
    return Scene((mesh,), camera, lit.LIGHTS, name="needle")


def decades(last: int) -> tuple[float, ...]:
    """Return the powers of ten from 1 to 10^last."""
    return tuple(10.0**power for power in range(last + 1))


HALF_ULP = 2.0**-53
ASPECT = Law(
    1.0, "the condition number of interpolating in float32", below="the rounding of other terms is larger at first"
)
AXES = (
    Axis(
        "exponent",
        "exponent of the highlight",
        "exponent n",
        decades(9),
        highlight,
        Law(0.5, "directions, whose errors a highlight amplifies by sqrt(n)", below="small exponents amplify nothing"),
        Law(1.0, "the rounding of R.V, which the power amplifies n times", below="small exponents amplify nothing"),
        lambda n: 16.0 * math.sqrt(n) * HALF_ULP,
        "16 sqrt(n) 2^-53",
    ),
    Axis(
        "distance",
        "distance from the origin",
        "distance of scene, camera and lights from the origin",
        decades(9),
        moved,
        Law(0.0, "coordinates taken relative to the eye in float64"),
        Law(1.0, "coordinates rounded relative to the origin", below="near the origin other roundings are larger"),
        lambda _: 16.0 * HALF_ULP,
        "16 * 2^-53",
    ),
    Axis(
        "aspect",
        "aspect of a triangle",
        "aspect: longest edge / smallest height",
        decades(6),
        needle,
        ASPECT,
        ASPECT,
        lambda aspect: 16.0 * aspect * HALF_ULP,
        "16 * aspect * 2^-53",
    ),
)


# Measuring


class _Drawn(NamedTuple):
    """One way at one stiffness: its point without times, and what draws a frame and returns its milliseconds."""

    way: str
    point: Point
    draw: Callable[[int], float] | None


def measure(axis: Axis, device: Device) -> list[Series]:
    """Measure every way along an axis, all frames in turns; float64 only if the device has it."""
    with ExitStack() as stack:
        drawn = [each for value in axis.stiffness for each in _at(axis.scene(value), value, device, stack)]
        turns = in_turns([each.draw for each in drawn if each.draw], FRAMES, SECONDS)
    times = (spread(ms) for ms in zip(*turns, strict=True))
    found: dict[str, list[Point]] = {}
    for way, point, draw in drawn:
        found.setdefault(way, []).append(point._replace(ms=next(times) if draw else None))
    return [Series(way, tuple(points)) for way, points in found.items()]


def _at(scene: Scene, stiffness: float, device: Device, stack: ExitStack) -> Iterator[_Drawn]:
    """Yield the ways at one stiffness; renderers stay open for the stack's block."""
    standard = Settings.from_preset("standard", near=NEAR)
    expected = oracle.render(scene, standard)
    for way, precision in WAYS.items():
        if way != "float64" or device.has_fp64:
            settings = replace(standard, precision=precision)
            renderer = stack.enter_context(Renderer(scene, settings=settings, device=device))
            image = renderer.render()
            point = _point(stiffness, image.rgb, image.alpha, expected)
            yield _Drawn(way, point, lambda _, renderer=renderer: frame_ms(renderer))  # type: ignore[misc]
    try:
        plain = PlainFloat32(scene)
    except InputError:  # rounded corners lie behind the eye
        yield _Drawn(PLAIN, Point(stiffness, None, None, None, None), None)
        return
    with np.errstate(all="ignore"):
        drawn = plain.draw(scene.camera)
    point = _point(stiffness, drawn[..., :3], drawn[..., 3], expected)
    yield _Drawn(PLAIN, point, partial(_plain_ms, plain, scene.camera))


class PlainFloat32(Vectorized):
    """A renderer in float32 from world coordinates on, with corners on the grid that the oracle has too."""

    def _project(self, camera: Camera) -> Projected:
        found = super()._project(camera)
        x, y = (np.rint(each * np.float32(SUB)) / np.float32(SUB) for each in (found.x, found.y))
        area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
        kept = np.flatnonzero(area > 0.0)
        return Projected(x[:, kept], y[:, kept], found.w[:, kept], area[kept], found.corners[:, kept])


def _plain_ms(plain: PlainFloat32, camera: Camera, _: int) -> float:
    start = time.perf_counter()
    with np.errstate(all="ignore"):
        plain.draw(camera)
    return (time.perf_counter() - start) * 1e3


def _point(stiffness: float, rgb: Array, alpha: Array, expected: OracleFrame) -> Point:
    """Return the errors of an image, without times. Pixels that are not finite count as off by all the light."""
    light = float(expected.budget.max())
    off = np.abs(np.asarray(rgb, np.float64) - expected.rgb).max(axis=-1) / light
    off = np.where(np.isfinite(off), off, 1.0)
    wrong = int(((np.asarray(alpha) > 0.5) != (expected.alpha > 0.5)).sum())
    return Point(stiffness, float(np.sqrt(np.square(off).mean())), float(off.max()), wrong, None)


def stats(axis: Axis, series: Sequence[Series]) -> dict[str, Any]:
    """Return the figures for JSON."""

    def fields(power: Power | None) -> dict[str, float] | None:
        return None if power is None else power._asdict()

    return {
        "axis": axis.name,
        "about": axis.title,
        "oracle": {"own_error": axis.own_about, "at": {f"{value:g}": axis.own(value) for value in axis.stiffness}},
        "ways": [
            {
                "way": each.way,
                "points": [{**point._asdict(), "ms": point.ms and point.ms._asdict()} for point in each.points],
                "power": fields(each.power()),
                "expected": axis.expected(each.way).exponent,
                "time_power": fields(each.time_power()),
            }
            for each in series
        ],
    }
