"""Options of `render` for named views, sheets of them, and magnified crops; and writing these."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base.atomic_files import shown
from .arguments import names, numbers, refuse
from .stereo_options import EYES

if TYPE_CHECKING:
    from ...images.crops import Crop
    from ...pipeline.frame import Frame
    from ...scene.model import Scene

_NOT_WITH_SHEET = (
    *("check", "budget", "tolerance", "formats", "depth_scale", "visible", "flow_to", "cryptomatte", "explain"),
    *("half", "crop", "colorbar", "compression", "crop_zoom"),
)


def view_options(parser: argparse.ArgumentParser) -> None:
    from ...scene.views import VIEWS

    group = parser.add_argument_group("views: several pictures of a scene, and parts of them")
    group.add_argument(
        "--views",
        type=names(VIEWS),
        metavar="NAME,...",
        help=f"of {','.join(VIEWS)}: writes OUT_front.exr, OUT_front.png and so on. camera is the scene's own view, the "
        "others are parallel projections of one scale, which show the whole scene",
    )
    group.add_argument(
        "--sheet",
        action="store_true",
        help="draw the views (default: front,right,top,iso) on one sheet, with titles, scale bars and axes: OUT.png, and "
        "OUT.json with counts, sizes and what each view shows",
    )
    group.add_argument(
        "--fixed-lights", action="store_true", help="leave the lights where they are (default: they turn with the view)"
    )
    group.add_argument(
        "--crop-zoom",
        type=_crop,
        action="append",
        default=[],
        metavar="X,Y,W,H[,FACTOR]",
        help="also write OUT_crop.png: W x H pixels from column X and row Y from the top left, each pixel a square of "
        "FACTOR (default: as fits into 512 pixels); and OUT_marked.png, the image with a frame around them. May be given "
        "again: OUT_crop1.png, OUT_crop2.png",
    )


def _crop(text: str) -> Crop:
    from ...images.crops import Crop

    values = numbers(int, None, "X,Y,W,H or X,Y,W,H,FACTOR such as 100,80,32,24,8")(text)
    if len(values) not in (4, 5) or min(values) < 0 or 0 in values[2:]:
        raise argparse.ArgumentTypeError(f"expected X,Y,W,H or X,Y,W,H,FACTOR such as 100,80,32,24,8, found {text!r}")
    return Crop(*values)


def check_view_options(arguments: argparse.Namespace) -> None:
    """Refuse options that do nothing together."""
    if not (arguments.views or arguments.sheet):
        refuse(arguments, ("fixed_lights",), "needs --views or --sheet")
    if arguments.sheet:
        refuse(arguments, _NOT_WITH_SHEET, "cannot go with --sheet, which writes one picture of several views")


def files_of(output: str, arguments: argparse.Namespace) -> list[Path]:
    """Return the files that are written for an output besides those of `Frame.save`."""
    if arguments.sheet:
        from ...view.sheet import sheet_paths

        return list(sheet_paths(output, ("render", "--output")))
    return [
        path
        for stem in stems_of(output, arguments)
        for path in (
            *crop_paths(stem, arguments.crop_zoom),
            *([_beside(stem, "marked")] if arguments.crop_zoom else ()),
            *([_table(stem, arguments.visible)] if arguments.visible else ()),
        )
    ]


def stems_of(output: str, arguments: argparse.Namespace) -> list[str]:
    """Return the name for `Frame.save` of each view or eye, or the output itself without these; none for a sheet."""
    if arguments.sheet:
        return []
    if arguments.stereo is not None:
        return [str(_beside(output, eye, "", ".")) for eye in EYES]
    return [str(_beside(output, view, "")) for view in dict.fromkeys(arguments.views)] if arguments.views else [output]


def _beside(output: str, what: str, ending: str = ".png", separator: str = "_") -> Path:
    from ...pipeline.frame_files import output_paths

    stem = output_paths(output, ("render", "--output"))[0].with_suffix("")
    return stem.with_name(f"{stem.name}{separator}{what}{ending}")


def views_of(scene: Scene, output: str, arguments: argparse.Namespace) -> Iterator[tuple[Scene, str]]:
    """Yield the scene with the camera of each view or eye, and its name for `Frame.save`."""
    if arguments.stereo is not None:
        camera = scene.camera if arguments.resolution is None else scene.camera.with_resolution(arguments.resolution)
        pair = camera.stereo(arguments.stereo, arguments.convergence)
        for eye, stem in zip(pair, stems_of(output, arguments), strict=True):
            yield replace(scene, camera=eye), stem
        return
    if not arguments.views:
        yield scene, output
        return
    from ...scene.views import named_cameras, seen_by

    cameras = named_cameras(scene, arguments.views, arguments.resolution)
    for camera, stem in zip(cameras.values(), stems_of(output, arguments), strict=True):
        yield seen_by(scene, camera, fixed_lights=arguments.fixed_lights), stem


def check_crops(scene: Scene, arguments: argparse.Namespace) -> None:
    """Refuse, before rendering, crops that are not inside the image."""
    for crop in arguments.crop_zoom:
        crop.check("--crop-zoom", *(arguments.resolution or scene.camera.resolution))


def crop_paths(stem: str, crops: Sequence[Crop]) -> list[Path]:
    return [_beside(stem, f"crop{number if len(crops) > 1 else ''}") for number in range(1, len(crops) + 1)]


def _table(stem: str, ending: str) -> Path:
    from ...pipeline.frame_files import visible_path

    return visible_path(stem, ending, ("render", "--output"))


def write_visible(frame: Frame, stem: str, arguments: argparse.Namespace) -> list[Path]:
    """Write the table of how much of each instance the frame shows; return its path."""
    if arguments.visible is None:
        return []
    from ...pipeline.visible import visible

    path = _table(stem, arguments.visible)
    visible(frame.scene, settings=frame.settings, device=arguments.device).save(path)
    return [path]


def write_crops(frame: Frame, stem: str, arguments: argparse.Namespace) -> list[Path]:
    """Write the magnified crops and the image with their places, all or none; return their paths."""
    if not arguments.crop_zoom:
        return []
    from ...base import atomic_files
    from ...images import png
    from ...images.crops import magnified, marked
    from ...images.transparency import over_checkers

    pixels = over_checkers(frame.to_png8(arguments.tonemap, arguments.exposure))
    paths = [*crop_paths(stem, arguments.crop_zoom), _beside(stem, "marked")]
    with atomic_files.replacing_all(*paths) as files:
        pictures = (*(magnified(pixels, crop) for crop in arguments.crop_zoom), marked(pixels, arguments.crop_zoom))
        for path, file, picture in zip(paths, files, pictures, strict=True):
            with atomic_files.naming(path):
                png.encode(file, picture)
    return paths


def write_sheet(scene: Scene, output: str, arguments: argparse.Namespace, options: dict[str, Any]) -> dict[str, Any]:
    """Draw and write the sheet of a scene; print what it shows. Return the facts."""
    from ...view.sheet import DEFAULT_VIEWS, draw_sheet

    sheet = draw_sheet(
        scene,
        arguments.views or DEFAULT_VIEWS,
        fixed_lights=arguments.fixed_lights,
        tonemap=arguments.tonemap,
        exposure=arguments.exposure,
        **options,
    )
    paths = sheet.save(output)
    if not arguments.json:
        print("\n".join([*_lines(sheet.facts), f"wrote   {', '.join(map(shown, paths))}"]))
    return sheet.facts


def _lines(facts: dict[str, Any]) -> list[str]:
    from ...base.text_tables import as_lines

    size = " x ".join(f"{each:.6g}" for each in facts["bounding_box"]["size"])
    counts = ", ".join(
        f"{name.replace('non_', 'non-').replace('_', ' ')} {value:,}"
        for name, value in facts["counts"].items()
        if value is not None
    )
    area = facts["surface_area"]
    rows = [
        (
            view["name"],
            f"{view['coverage']:.2%}",
            f"{view['visible_faces']:,}",
            json.dumps(view["covered_box"]),
            f"{view['units_per_pixel']:.4g}",
        )
        for view in facts["views"]
    ]
    return [
        f"scene   {shown(facts['name'] or 'unnamed')}: {counts}",
        f"size    {size} units" + ("" if area is None else f", surface {area:.6g} square units"),
        *as_lines(("view", "covered", "faces visible", "pixels x,y,w,h", "units/pixel"), rows),
    ]
