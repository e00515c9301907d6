"""A sheet of named views of a scene, with scale bars and axes, and the facts about it for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import atomic_files
from ..base.arrays import Bytes
from ..base.json_values import plain
from ..base.validation import arguments, flag, sequence, value_error
from ..images import exr, marks, png
from ..images.statistics import image_statistics
from ..images.tonemap import WHITE, Operator, over
from ..pipeline.frame import Frame
from ..pipeline.frame_files import output_paths
from ..pipeline.opencl.device import Device
from ..pipeline.renderer import render
from ..scene import geometry
from ..scene.adjust_camera import CAMERA, named_cameras, seen_by, towards_eye, units_per_pixel
from ..scene.camera import Camera
from ..scene.contents import instance_names, object_numbers, surface_facts
from ..scene.ground import objects_of
from ..scene.model import Scene
from ..scene.settings import FrameOptions

if TYPE_CHECKING:
    from typing_extensions import Unpack

DEFAULT_VIEWS = ("front", "right", "top", "iso")
MAX_PIXELS = 1 << 28  # of a sheet, as of a PNG that is read

_MIN_WIDTH = 240  # pixels of a panel: a smaller image stands in its middle
_MAX_BAR = 0.3  # of the image's width
_GAP, _PAD = 16, 8  # pixels


@dataclass(frozen=True)
class Sheet:
    """A drawn sheet.

    Attributes
    ----------
    picture : (M, N, 3) uint8 array
        The views with their titles.
    facts : dict
        What the JSON file holds, see clshade/view/README.md.
    """

    picture: Bytes
    facts: dict[str, Any]

    def save(self, path: str | Path) -> tuple[Path, Path]:
        """Write the picture and the facts to path.png and path.json, both or neither; return these paths.

        Parameters
        ----------
        path : str or path-like
            An extension .png or .json is dropped.
        """
        picture, facts = sheet_paths(path)
        text = json.dumps({**self.facts, "image": picture.name}, indent=2)
        with atomic_files.replacing_all(picture, facts) as (picture_file, facts_file):
            with atomic_files.naming(picture):
                png.encode(picture_file, self.picture)
            with atomic_files.naming(facts):
                facts_file.write(text.encode() + b"\n")
        return picture, facts


def sheet_paths(path: str | Path, argument: tuple[str, str] = ("Sheet.save", "path")) -> tuple[Path, Path]:
    """Return the paths that `Sheet.save` writes. Raises InputError as `output_paths` does, with `argument` in front."""
    path = Path(path)
    picture = output_paths(path.with_suffix("") if path.suffix.lower() == ".json" else path, argument)[1]
    return picture, picture.with_suffix(".json")


@arguments(scene=Scene, fixed_lights=flag)
def draw_sheet(
    scene: Scene,
    views: Sequence[str] = DEFAULT_VIEWS,
    *,
    device: Device | str | None = None,
    fixed_lights: bool = False,
    tonemap: Operator | None = None,
    exposure: float = 0.0,
    **options: Unpack[FrameOptions],
) -> Sheet:
    """Draw views of a scene side by side.

    Raises InputError if an argument is refused, or the sheet would have more than 2^28 pixels.

    Parameters
    ----------
    scene : Scene
        What to draw.
    views : sequence of str
        Names of `clshade.scene.adjust_camera.VIEWS`; each is drawn once. All but ``"camera"`` are parallel projections
        of one scale.
    device : Device or str, optional
        See `clshade.render`.
    fixed_lights : bool, default False
        Leave the lights where they are in the scene. Otherwise they turn with the view, so that each view is lit like
        the scene's own.
    tonemap, exposure
        See `Frame.to_png8`.
    **options
        Keywords of `clshade.render`; every view has the resolution.
    """
    names = () if isinstance(views, str) else sequence(views)
    if not names:
        raise value_error("draw_sheet", "views", "a sequence of names", views)
    cameras = named_cameras(scene, names, options.pop("resolution", None))
    layers = options.pop("layers", ())
    options["layers"] = (*((layers,) if isinstance(layers, str) else layers), "id")
    columns, rows = next(iter(cameras.values())).resolution
    layout, strip = _layout(columns, rows, len(cameras))
    facts = scene_facts(objects_of(scene))
    heading = _heading(facts, layout)
    layout = replace(layout, head=round((1.2 + marks.LINE * len(heading)) * layout.title_size))
    panels, views_facts = [], []
    for number, (name, camera) in enumerate(cameras.items()):
        frame = render(seen_by(scene, camera, fixed_lights=fixed_lights), device=device, **options)
        x, y = layout.corner(number, rows + strip)
        seen = {**view_facts(name, frame), "panel": [x + (layout.panel - columns) // 2, y, columns, rows]}
        panels.append(_panel(over(frame.to_png8(tonemap, exposure), WHITE), seen, camera, layout, strip))
        views_facts.append(seen)
    picture = marks.compose_sheet(panels, "\n".join(heading), layout)
    return Sheet(picture, {**facts, "views": views_facts, "size": [picture.shape[1], picture.shape[0]]})


def scene_facts(scene: Scene) -> dict[str, Any]:
    """Return name, bounding box, counts and area of a scene, for JSON."""
    low, high = geometry.bounding_box(scene)
    surface = surface_facts(scene)
    counted = ("triangles", "vertices", "positions", "shapes", "boundary_edges", "non_manifold_edges")
    facts: dict[str, Any] = plain(
        {
            "name": scene.name,
            "bounding_box": {"low": low, "high": high, "center": low / 2 + high / 2, "size": high - low},
            "counts": {
                **{name: getattr(surface, name) for name in counted},
                "objects": max(object_numbers(scene), default=0),
                "meshes": len(scene.meshes),
                "instances": len(instance_names(scene)),
                "materials": len({id(mesh.material) for mesh in scene.meshes}),
                "lights": len(scene.lights),
                "dropped_triangles": scene.nonfinite,
            },
            "closed": surface.closed,
            "surface_area": surface.area,
            "not_rendered": list(scene.ignored),
        }
    )
    return facts


def view_facts(name: str, frame: Frame) -> dict[str, Any]:
    """Return what a view shows, for JSON. The frame has the layer id."""
    camera, ids, face_count = frame.scene.camera, frame["id"], objects_of(frame.scene).face_count
    visible = np.zeros(frame.scene.face_count + 1, bool)
    visible[ids] = True
    alpha = np.where(ids > face_count, 0.0, frame.alpha)  # a ground is the last mesh
    x0, y0, x1, y1 = exr.drawn_window({"A": np.maximum(alpha, 0.0)})
    if name != CAMERA:
        title = f"{name}, seen from {towards_eye(camera)}"
    elif camera.orthographic:
        title = f"{name}, parallel projection"
    else:
        angle = math.degrees(2.0 * math.atan(camera.plane[0] / camera.focal / 2.0))
        title = f"{name}, perspective, {angle:.3g} degrees"
    scale = units_per_pixel(camera)
    max_length = _MAX_BAR * scale * camera.resolution[0]
    length = marks.round_length(max_length) if 0.0 < max_length < math.inf else 0.0
    facts: dict[str, Any] = plain(
        {
            "name": name,
            "title": title,
            "camera": {field.name: getattr(camera, field.name) for field in fields(camera)},
            "units_per_pixel": scale,
            "scale_holds": "everywhere" if camera.orthographic else "at the distance of the focal point",
            "scale_bar": {"length": length, "pixels": length / scale},
            "coverage": float(alpha.mean(dtype=np.float64)),
            "covered_box": [x0, y0, x1 - x0 + 1, y1 - y0 + 1] if alpha.any() else None,
            "visible_faces": int(np.count_nonzero(visible[1 : face_count + 1])),
            "triangles_in_view": frame.stats["visible"],
            "statistics": image_statistics(frame.rgb).stats(),
        }
    )
    return facts


def _layout(columns: int, rows: int, count: int) -> tuple[marks.Layout, int]:
    """Return the layout of a sheet, about 4:3, without room for its heading, and the height of the strip below each
    image. Raises InputError for a sheet of more than MAX_PIXELS."""
    width = max(columns, _MIN_WIDTH)
    strip = min(max(round(0.13 * width), 44), 100)

    def cost(across: int) -> float:
        """How far a grid is from 4:3, and how much of it is empty."""
        down = -(-count // across)
        ratio = across * width / (down * (rows + strip))
        return abs(math.log(ratio * 3.0 / 4.0)) + 0.25 * (across * down - count)

    across = min(range(1, count + 1), key=cost)
    size = min(max(width / 62.0, 8.0), 14.0)  # points
    layout = marks.Layout(across, width, _GAP, round(3.0 * size), 8, 0, size, size)
    height = layout.corner(-(-count // across) * across, rows + strip)[1]
    if height * across * (width + _GAP) > MAX_PIXELS:
        limit = f"a resolution with which {count} views have at most {MAX_PIXELS} pixels in all"
        raise value_error("sheet", "resolution", limit, f"{columns} x {rows}")
    return layout, strip


def _panel(pixels: Bytes, facts: dict[str, Any], camera: Camera, layout: marks.Layout, strip: int) -> marks.Panel:
    """Return the image with its title, and below it axes, scale bar and what it shows."""
    rows, columns = pixels.shape[:2]
    picture = np.full((rows + strip, layout.panel, 3), 255, np.uint8)
    left = (layout.panel - columns) // 2
    picture[rows:, _PAD : _PAD + strip] = marks.triad(geometry.camera_axes(camera), strip)
    picture[: rows + 1, max(left - 1, 0) : left + columns + 1] = marks.FRAME
    picture[:rows, left : left + columns] = pixels
    size, x = 0.9 * layout.text_size, 2 * _PAD + strip
    bar = facts["scale_bar"]
    if bar["pixels"] >= 4.0:
        y = rows + round(0.36 * strip)
        marks.scale_bar(picture, x, y, bar["pixels"])
        after = x + bar["pixels"] + _PAD
        label = f"{bar['length']:g} unit{'s' * (bar['length'] != 1.0)}"
        label += "" if camera.orthographic else " at the focal point"
        text = marks.fit_text(label, size, layout.panel - after - _PAD)
        marks.draw_text(picture, after, y + 0.5 * size, size, text, marks.INK)
    lines = (
        f"{facts['coverage']:.1%} covered, {facts['visible_faces']:,} faces visible",
        f"{facts['coverage']:.0%} covered",
    )
    text = next((line for line in lines if marks.text_width(line, size) <= layout.panel - x - _PAD), "")
    marks.draw_text(picture, x, rows + round(0.80 * strip), size, text, marks.INK)
    title = marks.fit_text(facts["title"], layout.title_size, layout.panel)
    return marks.Panel(picture, title, "")


def _heading(facts: dict[str, Any], layout: marks.Layout) -> list[str]:
    """Return lines on the scene, none wider than the sheet."""
    counts, width = facts["counts"], layout.across * (layout.panel + layout.gap) - 2 * _GAP
    shapes, area = counts["shapes"], facts["surface_area"]
    parts = [f"{facts['name'] or 'unnamed'}: {counts['triangles']:,} triangles", f"{counts['vertices']:,} vertices"]
    if shapes is not None:
        edges = f"{counts['boundary_edges']:,} boundary and {counts['non_manifold_edges']:,} non-manifold edges"
        parts += [f"{shapes:,} connected shape{'s' * (shapes != 1)}", "closed" if facts["closed"] else edges]
    parts.append("size " + " x ".join(f"{side:.4g}" for side in facts["bounding_box"]["size"]) + " units")
    parts += [] if area is None else [f"surface {area:.4g} square units"]
    lines: list[str] = []
    for part in parts:
        joined = f"{lines[-1]}, {part}" if lines else part
        if lines and marks.text_width(marks.drawable(joined), layout.title_size) <= width:
            lines[-1] = joined
        else:
            lines.append(part)
    return [marks.fit_text(line, layout.title_size, width) for line in lines]
