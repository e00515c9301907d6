"""Error and time of images that grow stiff, in every precision and in plain float32; the oracle says what is right."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ... import oracle
from ...base.arrays import Array, Floats32
from ...base.text_tables import digits
from ...images import figures
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.camera import Camera
from ...scene.geometry import camera_axes, vertex_normals
from ...scene.model import Material, Mesh, PointLight, Scene, Settings
from ...scene.settings import Precision
from ..report.measure import frame_ms
from ..report.power_law import Power, fitted
from ..results import Column, Results, Table
from .cases import lit
from .cases.flat import SUB
from .cases.light import unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIDE = 160  # pixels of the images
NEAR = 1e-2  # of the near plane: a scene's size says nothing about it here
FRAMES = 15  # of every way at every stiffness
PLAIN = "plain"  # float32
WAYS: dict[str, Precision] = {"standard": "float32", "float64": "float64"}  # and their precision
COLORS = {"standard": figures.OURS, "float64": "#2e8b57", PLAIN: figures.OTHER}
USELESS = 0.03  # RMS errors above this share of the light are of images that show nothing right, and follow no power
ABOUT = (
    f"RMS of |value - oracle| / light over an image of {SIDE}x{SIDE} pixels, light being the most that a point of the scene "
    "can send; plain: float32 from world coordinates on, in NumPy, nan where that draws nothing; wrong: pixels of wrong "
    "coverage; ms: of a frame"
)


@dataclass(frozen=True, eq=False)
class Axis:
    """What grows along an axis.

    values: of the stiffness. scene: draws one. power, plain_power: of the stiffness that errors follow in theory, ours and
    those of plain float32.
    """

    name: str
    label: str
    values: tuple[float, ...]
    scene: Callable[[float], Scene]
    power: float
    plain_power: float

    def own_error(self, value: float) -> float:
        """Return how large the oracle's own error may be."""
        return float(16.0 * value**self.power * 2.0**-53)


class Row(NamedTuple):
    """All ways at one stiffness, by their names.

    rms: error, NaN where the way cannot draw the scene. wrong: pixels of wrong coverage. ms: of a frame, without plain
    float32.
    """

    axis: Axis
    value: float
    rms: dict[str, float]
    wrong: dict[str, int]
    ms: dict[str, float]


# Scenes


def _square(normal: Array, eye: Array, light: Array, half: float, n: float) -> Scene:
    """Return a square of 2 `half` that fills the image; eye and light as seen from its center."""
    across = unit(np.cross(normal, [0.3, 1.0, 0.2]))
    up = np.cross(normal, across)
    center = np.array([0.3, 0.6, 0.2])
    corners = center + np.array([2.0 * half * (x * across + y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    material = Material(ka=0.1, kd=0.2, ks=0.8, n=n)
    mesh = Mesh(corners, faces, normals=np.tile(normal, (4, 1)), material=material)
    width = 2.0 * half / float(np.linalg.norm(eye))
    camera = Camera(center + eye, center, up, 1.0, (width, width), (SIDE, SIDE))
    return Scene((mesh,), camera, (PointLight(center + light, np.ones(3)),))


def highlight(n: float) -> Scene:
    """Return a highlight that fills the image, whatever its exponent: the lobe |R - V| < sqrt(2/n)."""
    eye, light = np.array([0.7, -0.4, 1.9]), np.array([-1.1, 0.8, 2.4])
    # A step x along the surface turns R - V by about x (1/|eye| + 1/|light|).
    turn = float(1.0 / np.linalg.norm(eye) + 1.0 / np.linalg.norm(light))
    return _square(unit(unit(eye) + unit(light)), eye, light, min(math.sqrt(2.0 / n) / turn, 0.5), n)


def near_light(nearness: float) -> Scene:
    """Return a light at a distance of 1/nearness before a square as large."""
    eye, light = np.array([0.7, -0.4, 1.9]), np.array([0.1, -0.2, 0.97]) / nearness
    return _square(np.array([0.0, 0.0, 1.0]), eye, light, 0.5 / nearness, 20.0)


def moved(distance: float) -> Scene:
    """Return a bent sheet with its camera and lights, all moved by the same vector of this length, without rounding."""
    camera = replace(lit.CAMERA, eye=np.array([0.25, 0.25, 5.0]), lookat=np.zeros(3), resolution=(SIDE, SIDE))
    lights = (PointLight(np.array([3.0, 4.0, 5.0]), np.ones(3)),)
    scene = Scene((lit.on_a_grid(lit.patch(cells=12), 20),), camera, lights)
    offset = np.round(distance * unit(np.array([2.0, -1.0, 2.0])))  # whole numbers: coordinates stay exact in float64
    return lit.shifted(scene, 1.0, offset)


def needle(aspect: float) -> Scene:
    """Return a triangle two units high and seen there, with two corners far to the left and right."""
    turned = np.array([[math.cos(0.3), math.sin(0.3), 0.0], [-math.sin(0.3), math.cos(0.3), 0.0]])
    corners = np.array([[-1.1 * aspect, -1.0], [0.9 * aspect, -1.0], [0.1, 1.0]]) * (1.0 + 2.0**-40)
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    mesh = Mesh(corners @ turned, np.array([[0, 1, 2]]), normals=normals, material=lit.MATERIAL)
    camera = replace(lit.CAMERA, lookat=lit.CAMERA.eye - [0.0, 0.0, 1.0], resolution=(SIDE, SIDE))
    return Scene((mesh,), camera, lit.LIGHTS)


DECADES = tuple(10.0**power for power in range(10))
AXES = (
    Axis("exponent", "exponent n of a highlight", DECADES, highlight, 0.5, 1.0),
    Axis("distance", "distance of everything from the origin", DECADES, moved, 0.0, 1.0),
    Axis("aspect", "longest edge / smallest height of a triangle", DECADES[:7], needle, 1.0, 1.0),
    Axis("nearness", "1 / distance of the light from the surface", DECADES[:7], near_light, 1.0, 1.0),
)


# Measuring


def measure(axis: Axis, value: float, device: Device) -> Row:
    """Measure every way at a value of the axis; float64 only if the device has it."""
    scene, standard = axis.scene(value), Settings.from_preset("standard", near=NEAR)
    expected = oracle.render(scene, standard)
    row = Row(axis, value, {}, {}, {})
    for way, precision in WAYS.items():
        if precision != "float64" or device.has_fp64:
            with Renderer(scene, settings=replace(standard, precision=precision), device=device) as renderer:
                row.rms[way], row.wrong[way] = errors(renderer.render().rgba, expected)
                row.ms[way] = float(np.median([frame_ms(renderer) for _ in range(FRAMES)]))
    with np.errstate(all="ignore"):
        row.rms[PLAIN], row.wrong[PLAIN] = errors(plain_float32(scene), expected)
    return row


def errors(rgba: Array | None, expected: oracle.OracleFrame) -> tuple[float, int]:
    """Return the RMS error of an image (M, N, 4), NaN without one, and its pixels of wrong coverage. Pixels that are not
    finite count as off by all the light."""
    if rgba is None:
        return np.nan, 0
    off = np.abs(np.asarray(rgba[..., :3], np.float64) - expected.rgb).max(axis=-1) / float(expected.budget.max())
    off = np.where(np.isfinite(off), off, 1.0)
    wrong = int(((rgba[..., 3] > 0.5) != (expected.alpha > 0.5)).sum())
    return float(np.sqrt(np.square(off).mean())), wrong


def power(rows: Sequence[Row], way: str, axis: Axis) -> Power | None:
    """Return the power of the stiffness that errors along an axis follow, without 0 and useless images; None for fewer than
    three."""
    useful = [(row.value, row.rms[way]) for row in rows if row.axis is axis and 0.0 < row.rms[way] < USELESS]
    return fitted(*zip(*useful, strict=True)) if len(useful) > 2 else None


# Plain float32


def plain_float32(scene: Scene) -> Floats32 | None:
    """Draw one mesh naively in float32 from world coordinates on. Return the image (M, N, 4), with corners on the
    oracle's grid of 1/65536 px; None where corners lie behind the eye."""
    mesh, camera = scene.meshes[0], scene.camera
    columns, rows = camera.resolution
    normals = vertex_normals(mesh.verts, mesh.faces) if mesh.normals is None else mesh.normals
    colors = np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors
    attributes = _float32(np.hstack([mesh.verts, normals, colors]))
    in_camera = (attributes[:, :3] - _float32(camera.eye)) @ _float32(camera_axes(camera)).T
    if in_camera[:, 2].min() <= 0.0:
        return None
    plane, size = _float32(camera.plane[::-1]), _float32(camera.resolution)
    uv = (_float32(camera.focal) * in_camera[:, :2] / in_camera[:, 2:] / plane + np.float32(0.5)) * size
    uv = np.rint(uv * np.float32(SUB)) / np.float32(SUB)
    centers = _float32(np.stack(np.meshgrid(np.arange(columns), np.arange(rows)[::-1]), axis=-1) + 0.5)
    image, nearest = np.zeros((rows, columns, 4), np.float32), np.zeros((rows, columns), np.float32)
    for face in mesh.faces:
        at = uv[face] - centers[..., None, :]
        edges = np.stack([_cross(at[..., i - 2, :], at[..., i - 1, :]) for i in range(3)], axis=-1)
        weights = edges / in_camera[face, 2]
        total = weights.sum(axis=-1)
        inverse = total / _cross(uv[face[1]] - uv[face[0]], uv[face[2]] - uv[face[0]])
        closer = (edges >= 0.0).all(axis=-1) & (inverse > nearest)
        nearest[closer] = inverse[closer]
        image[closer, :3] = _reflected(scene, (weights[closer] / total[closer, None]) @ attributes[face])
        image[closer, 3] = 1.0
    return image


def _reflected(scene: Scene, points: Array) -> Array:
    """Return the light of points (K, 9): position, normal and color."""
    material = scene.meshes[0].material
    position, normal, color = np.split(points, 3, axis=1)
    normal, to_eye = unit(normal), unit(_float32(scene.camera.eye) - position)
    total = _float32(material.ka * scene.ambient)
    for source in (light for light in scene.lights if isinstance(light, PointLight)):
        to_light = unit(_float32(source.position) - position)
        cosine = (normal * to_light).sum(axis=1, keepdims=True)
        toward = np.maximum(((2.0 * cosine * normal - to_light) * to_eye).sum(axis=1, keepdims=True), 0.0)
        shine = np.where(cosine > 0.0, toward ** np.float32(material.n), 0.0)
        diffuse = _float32(material.kd) * np.maximum(cosine, 0.0)
        total = total + _float32(source.intensity) * (diffuse + _float32(material.ks) * shine)
    return color * total


def _float32(values: object) -> Floats32:
    return np.asarray(values, np.float32)


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


# Tables and the figure


def run(device: Device, prefix: Path, formats: Sequence[str]) -> None:
    """Measure all axes, print the tables, and write them and the figure as PREFIX.csv and so on. Raises OutputError."""
    rows = [measure(axis, value, device) for axis in AXES for value in axis.values]
    tables = results(rows, device.title)
    print("\n".join(["", *tables.lines()]), flush=True)
    tables.write(prefix)
    chart = figure(rows, device.title)
    for kind in formats:
        figures.save(chart, f"{prefix}.{kind}")


def results(rows: Sequence[Row], device: str) -> Results:
    """Return the table of errors and times, and that of the powers that errors follow."""
    ways, axes = list(rows[0].rms), list(dict.fromkeys(row.axis for row in rows))
    two = partial(digits, count=2)
    wrong = [way for way in ways if any(row.wrong[way] for row in rows)]
    columns = (
        Column("axis", "axis", attrgetter("axis.name"), str),
        Column("value", "stiffness", attrgetter("value"), "{:g}".format),
        *(Column(way, f"rms_{way}", partial(_of_way, way, "rms"), two) for way in ways),
        Column("", "rms_oracle", lambda row: row.axis.own_error(row.value)),
        *(
            Column(f"{way} wrong", f"wrong_{way}", partial(_of_way, way, "wrong"), partial(digits, count=6))
            for way in wrong
        ),
        *(Column(f"{way} ms", f"ms_{way}", partial(_of_way, way, "ms"), two) for way in rows[0].ms),
    )
    fits = (
        Column("axis", "axis", attrgetter("name"), str),
        *(Column(way, "", partial(power, rows, way), _plus_or_minus) for way in ways),
        *(Column("", f"power_{way}", partial(_exponents, rows, way)) for way in ways),
        Column("theory", "theory", attrgetter("power"), str),
        Column("of plain", "theory_plain", attrgetter("plain_power"), str),
    )
    useless = f"images with errors above {USELESS:g} show nothing right, and are left out"
    notes = [*(f"{axis.name}: {axis.label}" for axis in axes), useless]
    tables = Table("Errors and times", columns, rows, ABOUT, left=2), Table("Powers", fits, axes, notes=notes)
    return Results("Error against stiffness", {"device": device}, tables)


def _of_way(way: str, name: str, row: Row) -> float:
    return getattr(row, name)[way]  # type: ignore[no-any-return]


def _exponents(rows: Sequence[Row], way: str, axis: Axis) -> dict[str, float] | None:
    fit = power(rows, way, axis)
    return None if fit is None else fit._asdict()


def _plus_or_minus(fit: Power | None) -> str:
    return "-" if fit is None else f"{round(fit.exponent, 2) + 0.0:.2f} +- {(fit.high - fit.low) / 2.0:.2f}"


def figure(rows: Sequence[Row], device: str) -> Figure:
    """Draw errors above, times below."""
    axes = list(dict.fromkeys(row.axis for row in rows))
    chart = figures.blank(4.2 * len(axes), 6.4)
    panels = chart.subplots(2, len(axes), squeeze=False, height_ratios=(2.2, 1.0))
    for axis, above, below in zip(axes, *panels, strict=True):
        some = [row for row in rows if row.axis is axis]
        for way in some[0].rms:
            style: dict[str, Any] = {
                "label": way,
                "color": COLORS[way],
                "marker": "x" if way == PLAIN else "o",
                "ms": 4,
            }
            above.plot(axis.values, [row.rms[way] for row in some], **style)
            if way in some[0].ms:
                below.plot(axis.values, [row.ms[way] for row in some], **style)
        errors = [axis.own_error(value) for value in axis.values]
        above.plot(axis.values, errors, "k:", label="oracle's own, at most")
        above.axhspan(USELESS, 30.0, color=figures.MUTED, alpha=0.15, lw=0, label="shows nothing right")
        above.set(xscale="log", yscale="log", ylim=(1e-18, 30.0), title=axis.name)
        below.set(xscale="log", yscale="log", xlabel=axis.label)
    panels[0][0].legend(fontsize=7.5, loc="lower right")
    panels[0][0].set_ylabel("RMS of |value - oracle| / light")
    panels[1][0].set_ylabel("time of a frame, ms")
    chart.suptitle(f"Error and time against stiffness\n{device}".replace("$", r"\$"), fontsize=10)
    return chart
