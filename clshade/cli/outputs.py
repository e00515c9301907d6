"""What commands write: options of images, films and tables of their pixels, their names, and refusals before drawing."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base import atomic_files
from ..base.atomic_files import shown
from ..errors import InputError
from ..images.cryptomatte import MATTES
from ..images.depth_png import SCALE
from ..images.exr import COMPRESSIONS
from ..images.tonemap import OPERATORS
from ..pipeline.frame_files import KINDS, OTHER_FORMATS, default_files, output_paths, visible_path
from ..scene.adjust_camera import VIEWS, named_cameras, seen_by
from .options import Arguments, Group, Option, check_output_file, names, reader

if TYPE_CHECKING:
    from ..images.marks import Crop
    from ..pipeline.frame import Frame
    from ..pipeline.frame_files import SavingOptions
    from ..scene.model import Scene

OUTPUT = "output: files, and what they hold"  # title of the group of options
EYES = ("left", "right")
ASKED = ("render", "--output")  # function and argument that errors name
_GLB = ".glb"


class Saving:
    """Arguments of `Frame.save`."""

    title = OUTPUT
    files = Option(
        "--formats NAME,...: files to write: exr, png, npz (all arrays, K and pose, for numpy.load), depth "
        "(OUT.depth.png, 16 bits, with layer Z) (default: exr,png; of OUT.npz that alone)",
        names(KINDS, words={"z": "depth", "numpy": "npz", "openexr": "exr"}),
    )
    depth_scale = Option(
        f"--depth-scale UNITS: scene units of a step of the depth PNG, which its text depthScale has (default: {SCALE:g})",
        float,
    )
    tonemap = Option(
        "--tonemap: of the PNG (default: by the preset: none for course, neutral for pbr, srgb for standard)",
        choices=OPERATORS,
    )
    exposure = Option("--exposure STOPS: of the PNG", float, 0.0)
    half = Option("--half: 16-bit floats in the EXR", default=False)
    compression = Option(
        f"--compression NAME: of the EXR: {', '.join(COMPRESSIONS)}; lossy ones leave layers as they are, in a second part",
        str,
        "zip",
    )
    crop = Option("--crop: keep of the EXR what is not background, if that is black or none", default=False)
    colorbar = Option("--colorbar: add the color map of --scalars to the right of the PNG", default=False)
    deterministic = Option("--deterministic: leave times out of the EXR", default=False)


_CRYPTOMATTE = Option(
    "--cryptomatte NAME,...: also masks of each object, material and instance with the share of each pixel, as "
    "Cryptomatte layers in the EXR; or of those named alone, such as object,material",
    names(MATTES),
    nargs="?",
    const=MATTES,
)
MASKS = Group(OUTPUT, _CRYPTOMATTE)


class Stereo:
    title = "stereo: the images of two eyes"
    stereo = Option(
        "--stereo BASELINE: draw the images of two eyes, BASELINE scene units apart, half of it to the left and right of "
        "the camera, with parallel directions: OUT.left.exr, OUT.right.exr and so on, of frames OUT.left.####.exr",
        float,
    )
    convergence = Option(
        "--convergence DISTANCE: along the viewing direction, at which both images are alike, by shifted principal points "
        "(default: infinity)",
        float,
    )


def _crop(text: str) -> Crop:
    from ..images.marks import Crop

    values = tuple(map(int, text.split(",")))
    if len(values) not in (4, 5) or min(values) < 0 or 0 in values[2:]:
        raise ValueError(text)
    return Crop(*values)


class Views:
    title = "views: several pictures of a scene, and parts of them"
    views = Option(
        f"--views NAME,...: of {','.join(VIEWS)}: writes OUT_front.exr, OUT_front.png and so on. camera is the scene's own "
        "view, the others are parallel projections of one scale, which show the whole scene",
        names(VIEWS),
    )
    sheet = Option(
        "--sheet: draw the views (default: front,right,top,iso) on one sheet, with titles, scale bars and axes: OUT.png, "
        "and OUT.json with counts, sizes and what each view shows"
    )
    fixed_lights = Option("--fixed-lights: leave the lights where they are (default: they turn with the view)")
    crop_zoom = Option(
        "--crop-zoom X,Y,W,H[,FACTOR]: also write OUT_crop.png: W x H pixels from column X and row Y from the top left, "
        "each pixel a square of FACTOR (default: as fits into 512 pixels); and OUT_marked.png, the image with a frame "
        "around them. May be given again: OUT_crop1.png, OUT_crop2.png",
        reader(_crop, "X,Y,W,H or X,Y,W,H,FACTOR such as 100,80,32,24,8"),
        [],
        action="append",
    )


NOT_WITH_SHEET = (
    *("check", "budget", "tolerance", "formats", "depth_scale", "visible", "flow_to", "cryptomatte", "explain"),
    *("half", "crop", "colorbar", "compression", "crop_zoom"),
)


def saving(arguments: Arguments) -> SavingOptions:
    """Return the keyword arguments of `Frame.save` that are set, and `files`."""
    if "depth" not in (arguments.formats or ()):
        arguments.refuse(("depth_scale",), "needs --formats depth")
    chosen: Any = {"files": default_files(arguments.output or ""), **arguments.keywords(Saving)}
    return chosen  # type: ignore[no-any-return]


def check_stereo(arguments: Arguments, *others: str) -> None:
    """Refuse options that do nothing together. others: names of options that exclude --stereo."""
    if arguments.stereo is None:
        arguments.refuse(("convergence",), "needs --stereo BASELINE")
    for name in others:
        if getattr(arguments, name):
            arguments.refuse(("stereo",), f"cannot go with --{name}")


# Names of files


def output_stems(scenes: Sequence[str], output: str | None) -> tuple[Path | None, list[str]]:
    """Return the output folder, which must exist, or None if `output` names a file, and the name for `Frame.save` of each
    scene.

    output: -o. For one scene it is the file's name, or a folder if it ends in a slash; for several always a folder.
    Raises InputError if two scenes would have the same file. Names that differ only in case count as the same: some
    file systems do not distinguish them.
    """
    if len(scenes) == 1 and not (output or "").endswith(("/", os.sep)):
        return None, [output or "out"]
    folder = Path(output or ".")
    stems: dict[str, tuple[str, str]] = {}  # by the image's name in lower case: the scene and its stem
    for scene in scenes:
        name = Path(scene).stem
        if Path(name).suffix.lower() in (*OTHER_FORMATS, ".npz"):  # a.jpg.obj, where a.jpg would select another format
            name += ".exr"
        image = output_paths(folder / name)[0].name
        if image.lower() in stems:
            raise InputError(
                f"render: SCENE: expected a different name for each file in {shown(folder)}, "
                f"found {shown(stems[image.lower()][0])} and {shown(scene)}, both for {image}"
            )
        stems[image.lower()] = scene, str(folder / name)
    return folder, [stem for _, stem in stems.values()]


def stems_of(output: str, arguments: Arguments) -> list[str]:
    """Return the name for `Frame.save` of each view or eye, or the output itself without these; none for a sheet."""
    if arguments.sheet:
        return []
    if arguments.stereo is not None:
        return [str(_beside(output, f".{eye}")) for eye in EYES]
    views = dict.fromkeys(arguments.views or ())
    return [str(_beside(output, f"_{view}")) for view in views] or [output]


def _beside(output: str, ending: str) -> Path:
    stem = output_paths(output, ASKED)[0].with_suffix("")
    return stem.with_name(f"{stem.name}{ending}")


def _crop_paths(stem: str, crops: Sequence[Crop]) -> list[Path]:
    """Return the paths of the magnified crops and of the image with their places; none without crops."""
    numbers = [""] if len(crops) == 1 else range(1, len(crops) + 1)
    return [*(_beside(stem, f"_crop{number}.png") for number in numbers), _beside(stem, "_marked.png")] if crops else []


def other_files(output: str, arguments: Arguments) -> list[Path]:
    """Return the files that are written for an output besides the files of `Frame.save`."""
    if arguments.sheet:
        from ..view.sheet import sheet_paths

        return list(sheet_paths(output, ASKED))
    stems = stems_of(output, arguments)
    tables = [visible_path(stem, arguments.visible, ASKED) for stem in stems] if arguments.visible else []
    return [*(path for stem in stems for path in _crop_paths(stem, arguments.crop_zoom)), *tables]


# Views, crops and sheets


def views_of(scene: Scene, output: str, arguments: Arguments) -> Iterator[tuple[Scene, str]]:
    """Yield the scene with the camera of each view or eye, and its name for `Frame.save`."""
    stems = stems_of(output, arguments)
    if arguments.stereo is not None:
        pair = scene.camera.stereo(arguments.stereo, arguments.convergence)
        yield from ((replace(scene, camera=eye), stem) for eye, stem in zip(pair, stems, strict=True))
    elif arguments.views:
        cameras = named_cameras(scene, arguments.views, arguments.resolution).values()
        for camera, stem in zip(cameras, stems, strict=True):
            yield seen_by(scene, camera, fixed_lights=bool(arguments.fixed_lights)), stem
    else:
        yield scene, output


def write_crops(frame: Frame, stem: str, arguments: Arguments) -> list[Path]:
    """Write the magnified crops and the image with their places, all or none; return their paths."""
    if not arguments.crop_zoom:
        return []
    from ..images import png
    from ..images.marks import magnify, mark_crops
    from ..images.tonemap import over_checkers

    pixels = over_checkers(frame.to_png8(arguments.tonemap, arguments.exposure))
    paths = _crop_paths(stem, arguments.crop_zoom)
    with atomic_files.replacing_all(*paths) as files:
        pictures = (*(magnify(pixels, crop) for crop in arguments.crop_zoom), mark_crops(pixels, arguments.crop_zoom))
        for path, file, picture in zip(paths, files, pictures, strict=True):
            with atomic_files.naming(path):
                png.encode(file, picture)
    return paths


def write_sheet(scene: Scene, output: str, arguments: Arguments, options: dict[str, Any]) -> dict[str, Any]:
    """Draw and write the sheet of a scene; print what it shows. Return the facts."""
    from ..view.sheet import DEFAULT_VIEWS, draw_sheet

    sheet = draw_sheet(
        scene,
        arguments.views or DEFAULT_VIEWS,
        fixed_lights=bool(arguments.fixed_lights),
        tonemap=arguments.tonemap,
        exposure=arguments.exposure,
        **options,
    )
    paths = sheet.save(output)
    if not arguments.json:
        print("\n".join([*_sheet_lines(sheet.facts), f"wrote   {', '.join(map(shown, paths))}"]))
    return sheet.facts


def _sheet_lines(facts: dict[str, Any]) -> list[str]:
    from ..base.text_tables import as_lines

    size, area = " x ".join(f"{side:.6g}" for side in facts["bounding_box"]["size"]), facts["surface_area"]
    counted = {name.replace("non_", "non-").replace("_", " "): count for name, count in facts["counts"].items()}
    counts = ", ".join(f"{name} {count:,}" for name, count in counted.items() if count is not None)
    formats = {"name": "", "coverage": ".2%", "visible_faces": ",", "covered_box": "", "units_per_pixel": ".4g"}
    views = [{**view, "covered_box": json.dumps(view["covered_box"])} for view in facts["views"]]
    rows = [[format(view[name], form) for name, form in formats.items()] for view in views]
    return [
        f"scene   {shown(facts['name'] or 'unnamed')}: {counts}",
        f"size    {size} units" + ("" if area is None else f", surface {area:.6g} square units"),
        *as_lines(("view", "covered", "faces visible", "pixels x,y,w,h", "units/pixel"), rows),
    ]


# The scene as it was drawn


def check_save_scene(arguments: Arguments, others: Iterable[Path]) -> None:
    """Refuse, before rendering, a --save-scene that could not be written afterwards. others: files that will be."""
    name = arguments.save_scene
    if name is None:
        return
    from ..scene.formats.scene_json import ENDING, checked_name

    if len(arguments.scenes) > 1:
        raise InputError(f"--save-scene: is for one scene, not for {len(arguments.scenes)}")
    check_output_file(name, arguments.scenes, (ENDING, _GLB), "--save-scene")
    if name.lower().endswith(ENDING):
        checked_name(name, ("render", "--save-scene"))
    if os.path.abspath(name) in map(os.path.abspath, others):
        raise InputError(f"--save-scene: {shown(name)} is the file of the facts of --sheet: choose another one")


def save_scene(scene: Scene, arguments: Arguments) -> None:
    """Write the scene as it is drawn, if --save-scene asks for it."""
    if arguments.save_scene is None:
        return
    from ..base import console

    if arguments.preset is not None:
        scene = replace(scene, preset=arguments.preset)
    write = scene.to_glb if arguments.save_scene.lower().endswith(_GLB) else scene.to_json
    write(arguments.save_scene)
    console.progress(f"wrote {shown(arguments.save_scene)}")
