"""Options for the scene, its camera and the settings, and the scene that they select."""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base.spelling import hint
from ...errors import InputError
from .arguments import background, color, names, numbers, refuse, resolution

if TYPE_CHECKING:
    from ...base.declare import Declared
    from ...scene.model import Scalars, Scene, Settings
    from ...scene.settings import Look

# Arguments of clshade.scene.formats.load.load; besides `fit`, see `--camera`.
LOAD_OPTIONS = ("texture", "focal", "crease", "flat", "weld", "up", "two_sided", "time", "animation", "vertex_colors")
LIGHTS = "lights: which there are, and what they reach"  # title of the group of options
SAMPLES_HELP = "4, or 1 for scenes of the course, in Python 1"  # `picture_settings`, in words
# Without a look, these mean the scene as it is: they speak of light, or want data on the scene alone.
_PLAIN_WITH = (
    *("preset", "shader", "environment", "components", "lights", "light_intensity", "light_radius", "light_samples"),
    *("shadows", "ambient_occlusion", "scalars", "edges"),
    *("layers", "cryptomatte", "visible", "flow_to", "save_scene", "views", "sheet"),
)
_PICTURE_HELP = {
    "sample_shading": "yes where there are textures, shadows or ambient occlusion",
    "ambient_occlusion": "0, or 16 with --shadows where an environment is the light",
    "shadows": "yes with preset pbr or under a rectangle light, else no",
}
EDGE_OPTIONS = {  # of fields of Edges
    "kinds": "edges",
    "angle": "edge_angle",
    "width": "edge_width",
    "color": "edge_color",
    "only": "edges_only",
}
CAMERA_OPTIONS = {  # of arguments of `adjust_camera.camera_of`
    "position": "camera_position",
    "focal_point": "camera_focal_point",
    "up": "camera_view_up",
    "azimuth": "camera_azimuth_angle",
    "elevation": "camera_elevation_angle",
    "view_angle": "camera_view_angle",
    "orthographic": "orthographic",
}


SIZE = "the scene's own, 800,600 for meshes"  # default of --resolution


def scene_options(
    parser: argparse.ArgumentParser,
    *,
    several: bool = False,
    required: bool = False,
    default: str | None = "teapot",
    size: str = SIZE,
) -> None:
    """Add `arguments.scene`, or with `several` the list `arguments.scenes`, and the options that change scenes.

    required: the scene is mandatory, so that another positional argument may follow. default: None, or the scene used
    without one. size: the default of --resolution, in words.
    """
    from ...scene.formats.table import listed

    group = parser.add_argument_group("scene: files, and how they are read")
    group.add_argument(
        "scenes" if several else "scene",
        nargs=None if required else "*" if several else "?",
        default=[default] if several else default,
        metavar="SCENE",
        help=f"a file ({listed()}), or a built-in scene" + ("" if default is None else f" (default: {default})"),
    )
    scene_changes(parser, group, size)


def scene_changes(parser: argparse.ArgumentParser, group: argparse._ArgumentGroup, size: str = SIZE) -> None:
    """Add the options that change scenes: to the group, and to one of lights."""
    from ...scene.formats.options import VERTEX_COLORS
    from ...scene.framing import UPS
    from ...scene.settings import LOOKS

    group.add_argument("--texture", metavar="FILE", help="image to use as the texture")
    group.add_argument("--focal", type=float, metavar="F", help="focal length of a course file, scene units")
    edges = group.add_mutually_exclusive_group()
    edges.add_argument(
        "--crease", type=float, metavar="DEGREES", help="edges above this angle are sharp, where a mesh has no normals"
    )
    edges.add_argument(
        "--flat", action="store_true", default=None, help="every face is flat, where a mesh has no normals"
    )
    edges.add_argument(
        "--no-weld",
        dest="weld",
        action="store_false",
        default=None,
        help="keep vertices at one position apart, where an OBJ or PLY file has no normals (default: join them, so that no "
        "seam shows between faces with at most 30 degrees between them)",
    )
    group.add_argument("--up", choices=tuple(UPS), help="axis that points up (default: z for STL, y for most)")
    group.add_argument(
        "--two-sided",
        action=argparse.BooleanOptionalAction,
        help="light both sides of surfaces (default: as the file asks, on where its format cannot)",
    )
    group.add_argument("--vertex-colors", choices=VERTEX_COLORS, help="their encoding (default: srgb, in glTF linear)")
    group.add_argument(
        "--time",
        type=float,
        metavar="SECONDS",
        help="the pose of a glTF file's animation at this time (default: at rest)",
    )
    group.add_argument(
        "--animation",
        metavar="NAME|INDEX|all",
        help="which of a glTF file's animations, by name, number from 0, or all at once (default: the first)",
    )
    group.add_argument(
        "--look",
        choices=LOOKS,
        help="studio: lit by the studio, on a ground with a contact shadow; course: as the course draws; plain: as "
        "the scene is (default: studio for meshes without lights, unless an option speaks of light or layers; else plain)",
    )
    group.add_argument(
        "--ground",
        action=argparse.BooleanOptionalAction,
        help="a round matte floor below the scene, which fades into the background (default: with the look studio)",
    )
    group.add_argument("--resolution", type=resolution, metavar="W,H", help=f"pixels, also WxH (default: {size})")
    lights = parser.add_argument_group(LIGHTS)
    lights.add_argument(
        "--lights",
        type=numbers(int, None, "indices such as 0,2 (all without this option)"),
        metavar="I,...",
        help="use these lights only, such as 0,2 (default: all)",
    )
    lights.add_argument(
        "--light-intensity",
        type=numbers(float, None, "factors such as 1,0.5"),
        metavar="F,...",
        help="multiply the lights' intensities: one factor for all, or one for each that is used (default: 1)",
    )
    lights.add_argument(
        "--light-radius",
        type=float,
        metavar="R",
        help="make spheres of this radius of the point lights, scene units (default: as the scene says, 0 for most)",
    )
    lights.add_argument(
        "--environment",
        metavar="FILE|studio|none",
        help="light from all around, of shader pbr: an image in latitude and longitude, .exr .hdr .png, or the built-in "
        "studio (default: the studio for scenes without lights; none: the default lights)",
    )
    lights.add_argument(
        "--environment-rotation",
        type=float,
        metavar="DEG",
        help="turn it counterclockwise seen from above (default: 0)",
    )
    lights.add_argument("--environment-intensity", type=float, metavar="F", help="factor of its radiance (default: 1)")
    lights.add_argument(
        "--components",
        type=_components,
        metavar="NAME,...",
        help="use these terms of the light only, such as ambient,diffuse,specular (default: all)",
    )


def camera_options(parser: argparse.ArgumentParser) -> None:
    point = numbers(float, 3, "three numbers such as 1,2,3")
    group = parser.add_argument_group("camera: by default the scene's, or one that shows all of it")
    group.add_argument(
        "--camera",
        choices=("fit", "file"),
        help="fit: show all of the scene, from three quarters or as said below; file: take the file's own (default: fit "
        "for meshes, but for animations that are played, whose camera may move)",
    )
    group.add_argument("--fit", action="store_const", const="fit", dest="camera", help="the same as --camera fit")
    group.add_argument("--camera-position", type=point, metavar="X,Y,Z", help="the eye, scene units")
    group.add_argument("--camera-focal-point", type=point, metavar="X,Y,Z", help="what is looked at, scene units")
    group.add_argument("--camera-view-up", type=point, metavar="X,Y,Z", help="what points up in the image")
    group.add_argument(
        "--camera-azimuth-angle", type=float, default=0.0, metavar="DEG", help="go round to the right (default: 0)"
    )
    group.add_argument("--camera-elevation-angle", type=float, default=0.0, metavar="DEG", help="go up (default: 0)")
    group.add_argument("--camera-view-angle", type=float, metavar="DEG", help="vertical field of view")
    group.add_argument("--orthographic", action="store_true", help="parallel projection")


def setting_options(parser: argparse.ArgumentParser, samples: str = "1, its center") -> None:
    """Add the fields of Settings. samples: how many by default, for the help."""
    from ...scene import settings

    usual = {"samples": samples, **(_PICTURE_HELP if samples == SAMPLES_HELP else {})}
    group = parser.add_argument_group("settings: by default those of the preset")
    group.add_argument(
        "--preset", choices=settings.PRESETS, help="course for course files, pbr for glTF files, else standard"
    )
    lights = next((each for each in parser._action_groups if each.title == LIGHTS), group)
    for each in fields(settings.Settings):
        if each.name not in ("scalars", "edges"):
            chosen = lights if each.name in settings.LIGHT_FIELDS else group
            _setting_option(chosen, each, usual.get(each.name, ""))
    _scalar_options(parser)
    _edge_options(parser)


def light_options(group: argparse._ArgumentGroup) -> None:
    """Add the fields of Settings that say which light arrives, for all variants of a study."""
    from ...scene.settings import LIGHT_FIELDS, Settings

    for each in fields(Settings):
        if each.name in LIGHT_FIELDS:
            _setting_option(group, each)


def _setting_option(group: argparse._ArgumentGroup, each: Field[Any], usual: str = "", option: str = "") -> None:
    """Add the option of a field of Settings, or of Edges, as it is declared there.

    usual: its default, where the command has its own. option: its name, if it is another one than the field's.
    """
    from ...images.layers import LAYER_REMARKS, LAYER_WORDS
    from ...scene import settings
    from ...scene.edges import EDGE_KINDS

    known: Declared = each.metadata["declared"]
    by_preset = any(each.name in changed for changed in settings.PRESET_FIELDS.values())
    usual = usual or known.usual
    if not (usual or by_preset or each.default is None or isinstance(each.default, (bool, tuple))):
        usual = f"{each.default:g}" if isinstance(each.default, float) else str(each.default)
    kinds: dict[str, Any] = {
        "layers": names((*settings.LAYERS, "all"), words=LAYER_WORDS, remarks=LAYER_REMARKS),
        "kinds": names(EDGE_KINDS),
        "background": background,
        "color": color,
    }
    how: dict[str, Any] = {"choices": known.choices}
    if known.read is not None:
        how = {"type": kinds.get(each.name, known.read), "metavar": known.form}
    elif not known.choices:  # a flag, which may be taken back where it is usual
        how = {"action": argparse.BooleanOptionalAction if by_preset or usual else "store_true"}
    about = known.about + (f" (default: {usual})" if usual else "")
    group.add_argument(f"--{(option or each.name).replace('_', '-')}", default=None, help=about, **how)


def _scalar_options(parser: argparse.ArgumentParser) -> None:
    from ...scene.settings import Settings

    group = parser.add_argument_group("scalars: data on the meshes, shown by a color map")
    _setting_option(group, Settings.__dataclass_fields__["scalars"])
    group.add_argument(
        "--colormap", metavar="NAME|C,C,...", help="one of Matplotlib's, or colors from low to high (default: viridis)"
    )
    group.add_argument(
        "--clim",
        type=numbers(float, 2, "two numbers such as 0,1"),
        metavar="LOW,HIGH",
        help="values of the color map's ends (default: the least and largest in the scene)",
    )
    group.add_argument("--nan-color", type=color, metavar="COLOR", help="of faces without a number (default: darkgray)")


def _edge_options(parser: argparse.ArgumentParser) -> None:
    from ...scene.edges import Edges

    group = parser.add_argument_group("edges: of the meshes, drawn as lines")
    for name, option in EDGE_OPTIONS.items():
        _setting_option(group, Edges.__dataclass_fields__[name], option=option)


def picture_settings(arguments: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return the fields of Settings that were given, and those of a picture for people."""
    from ...pipeline.effective_settings import picture_fields

    return picture_fields(scene, getattr(arguments, "preset", None), **chosen_settings(arguments))


def chosen_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of Settings that were given."""
    from ...scene.model import Settings

    given = {f.name: getattr(arguments, f.name, None) for f in fields(Settings)}
    given["scalars"] = _chosen_scalars(arguments)
    given["edges"] = _chosen_edges(arguments)
    found = {name: value for name, value in given.items() if value is not None}
    if "depth" in (getattr(arguments, "formats", None) or ()) and "all" not in found.get("layers", ()):
        found["layers"] = tuple(dict.fromkeys((*found.get("layers", ()), "Z")))
    return found | ({"background": None} if found.get("background") == "none" else {})


def _chosen_scalars(arguments: argparse.Namespace) -> Scalars | None:
    """Return the scalars and their color map, if scalars were named. Raises InputError for options that need them."""
    names = ("colormap", "clim", "nan_color")
    if getattr(arguments, "scalars", None) is None:
        refuse(arguments, (*names, "colorbar"), "needs --scalars NAME")
        return None
    given = {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}
    from ...scene.model import Scalars

    if "," in given.get("colormap", ""):
        given["colormap"] = given["colormap"].split(",")
    return Scalars(arguments.scalars, **given)


def _chosen_edges(arguments: argparse.Namespace) -> Any:
    """Return the Edges that were asked for, or None."""
    from ...scene.edges import Edges

    if getattr(arguments, "edges", None) is None:
        refuse(arguments, EDGE_OPTIONS.values(), "needs --edges, such as --edges feature,silhouette")
        return None
    given: dict[str, Any] = {name: getattr(arguments, option) for name, option in EDGE_OPTIONS.items()}
    return Edges(**{name: value for name, value in given.items() if value is not None})


def load_scene(arguments: argparse.Namespace, name: str | None = None, *, turning: bool = False) -> Scene:
    """Load the scene of the command line, or of this name: a file, or a built-in scene if no such file exists.

    turning: its camera will go round what it looks at; one that is chosen here shows all of the scene all the time.
    """
    return arranged(read_scene(arguments, arguments.scene if name is None else name), arguments, turning=turning)


def read_scene(arguments: argparse.Namespace, name: str) -> Scene:
    """Load a scene as it is, with its own camera, lights and environment."""
    from ...base import console
    from ...base.atomic_files import shown
    from ...scene import adjust_camera
    from ...scene.builtin import scenes

    start = time.perf_counter()
    options = load_options(arguments)
    if name in scenes.BUILTINS and not Path(name).exists():
        refuse(arguments, LOAD_OPTIONS, f"needs a scene file, not the built-in scene {name!r}")
        if arguments.camera == "file":
            raise InputError(f"--camera: file needs a scene file, not the built-in scene {name!r}")
        scene = scenes.builtin(name, **({"soft": True} if name == "box_room" else {}))
        scene = adjust_camera.refitted(scene, arguments.resolution) if arguments.camera == "fit" else scene
    else:
        from ...scene.formats import load
        from ...scene.formats.table import extensions_with

        if not Path(name).suffix and not os.path.exists(name):
            near = hint(name, scenes.BUILTINS)
            raise InputError(f"SCENE: expected a file or one of {', '.join(scenes.BUILTINS)}, found {name!r}{near}")
        extension = Path(name).suffix.lower()
        if extension in extensions_with("weld"):
            options.setdefault("weld", True)
        fit = arguments.camera == "fit" or (arguments.camera is None and extension in extensions_with("time"))
        scene = load.load(name, resolution=arguments.resolution, fit=fit, **options)
        tell_of_file(scene, arguments, name)
        if scene.animations and arguments.time is None and arguments.animation is None:
            listed = ", ".join(shown(each) if each else f"number {k}" for k, each in enumerate(scene.animations[:8]))
            more = ", ..." if len(scene.animations) > 8 else ""
            console.progress(
                f"{shown(name)}: at rest: --time SECONDS shows a pose of its animations ({listed}{more}), `clshade animate` "
                "plays one"
            )
    taken = (time.perf_counter() - start) * 1e3
    console.detail(f"loaded {name}: {scene.face_count:,} triangles, {len(scene.lights)} lights, {taken:.0f} ms")
    return scene


def load_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options for `load` that were given, besides `fit` and the resolution."""
    return {name: getattr(arguments, name) for name in LOAD_OPTIONS if getattr(arguments, name) is not None}


def tell_of_file(scene: Scene, arguments: argparse.Namespace, name: str) -> None:
    """Say what was taken from a file, and what was made of it."""
    from ...base import console
    from ...base.atomic_files import shown
    from ...scene import framing
    from ...scene.formats.table import extensions_with
    from ...scene.geometry import bounding_box

    if arguments.camera == "file" and scene.fitted:
        raise InputError(f"--camera: expected a file that has one, found none in {shown(name)}")
    if arguments.camera is None and not scene.fitted and scene.preset != "course" and arguments.camera_position is None:
        console.progress(f"{shown(name)}: the camera is the file's own: --fit chooses one that shows all of the scene")
    guessed = {*extensions_with("up")} - {*extensions_with("time")}  # glTF says that y is up
    if Path(name).suffix.lower() in guessed and arguments.up is None and arguments.camera_view_up is None:
        taken = framing.up_of(scene.camera)
        likely = framing.likely_up(*bounding_box(scene), taken)
        if likely is not None:
            console.progress(
                f"{shown(name)}: {taken} is up, but its extents suggest {likely}: --up {likely} shows it so"
            )
    if scene.light_scale != 1.0:
        console.progress(
            f"{shown(name)}: lights: intensities (candela, lux) times {scene.light_scale:.4g}, so that the strongest has 1 "
            "at the center; --light-intensity changes that"
        )


def arranged(scene: Scene, arguments: argparse.Namespace, *, turning: bool = False, moving: bool = False) -> Scene:
    """Return a scene that was loaded, with the lights, look, environment, camera, ground and components of the command line.

    moving: its meshes will be in other places.
    """
    return placed(*lit(scene, arguments), arguments, turning=turning, moving=moving)


def placed(
    scene: Scene, look: Look, arguments: argparse.Namespace, *, turning: bool = False, moving: bool = False
) -> Scene:
    """Return a scene that is `lit`, with the camera, ground and components of the command line."""
    from ...scene import adjust_camera, framing
    from ...scene.ground import with_ground
    from ...scene.look import with_look

    up = arguments.up or framing.up_of(scene.camera)
    for option, purpose in (("light_intensity", "multiply"), ("light_radius", "give a size")):
        if getattr(arguments, option) is not None and scene.lights and not _as_drawn(scene, arguments)[0].lights:
            raise InputError(
                f"--{option.replace('_', '-')}: expected lights to {purpose}, found none: the environment lights the scene, "
                "see --environment-intensity"
            )
    camera = adjust_camera.camera_of(scene, chosen_camera(arguments), fit=arguments.camera == "fit", turning=turning)
    scene = replace(scene, camera=camera)
    if wants_ground(look, arguments):
        refuse_grounded_edges(arguments)
        drawn = _as_drawn(scene, arguments)[1]
        if look == "studio":
            shadow = not moving and not picture_settings(arguments, scene).get("ambient_occlusion")
            scene = with_look(scene, look, contact_shadow=shadow, up=up, settings=drawn)
        else:
            scene = with_ground(scene, up, drawn)
    return with_components(scene, arguments)


def wants_ground(look: Look, arguments: argparse.Namespace) -> bool:
    """Return whether a scene of this look gets a ground."""
    from ...scene.look import has_ground

    usual = has_ground(look, getattr(arguments, "edges", None))
    return usual if arguments.ground is None else bool(arguments.ground)


def refuse_grounded_edges(arguments: argparse.Namespace) -> None:
    """Raise InputError for a ground whose edges would be drawn too."""
    if arguments.ground and getattr(arguments, "edges", None):
        raise InputError("--ground: cannot go with --edges, which would draw its edges too")


def lit(scene: Scene, arguments: argparse.Namespace) -> tuple[Scene, Look]:
    """Return the scene with the lights and the environment of the command line, as its look shows it without a ground, and
    this look."""
    from ...scene.framing import up_of
    from ...scene.look import with_look

    scene = _with_environment(with_lights(scene, arguments), arguments)
    look = look_of(scene, arguments)
    return with_look(scene, look, ground=False, up=arguments.up or up_of(scene.camera)), look


def look_of(scene: Scene, arguments: argparse.Namespace) -> Look:
    """Return the look of a scene: the one that was asked for; else the studio, where lights only stand in for missing ones
    and no option means the scene as it is. Raises InputError for a preset beside a look, and lights beside the studio."""
    if arguments.look in ("studio", "course") and getattr(arguments, "preset", None):
        raise InputError(f"--look: {arguments.look} cannot go with --preset, which it chooses")
    chosen = {name: getattr(arguments, name, None) for name in _PLAIN_WITH}
    given = [name for name, value in chosen.items() if value or isinstance(value, float)]
    if arguments.look == "studio":
        for name in ("lights", "light_intensity", "light_radius", "light_samples"):
            if name in given:
                raise InputError(
                    f"--{name.replace('_', '-')}: cannot go with --look studio, whose environment is the light"
                )
        if arguments.environment == "none":
            raise InputError("--environment: none cannot go with --look studio, whose environment is the light")
    if arguments.look is not None:
        asked: Look = arguments.look
        return asked
    wants_depth = "depth" in (getattr(arguments, "formats", None) or ())
    is_cutout = getattr(arguments, "background", None) == "none"
    is_plain = scene.own_lights or scene.preset == "course" or bool(given) or wants_depth or is_cutout
    return "plain" if is_plain else "studio"


def with_lights(scene: Scene, arguments: argparse.Namespace) -> Scene:
    """Return the scene with the lights that were chosen, at their intensities."""
    from ...scene import adjust_lights

    if arguments.lights is not None:
        scene = adjust_lights.with_lights(scene, arguments.lights, "--lights")
    if arguments.light_intensity is not None:
        scene = adjust_lights.scaled_lights(scene, arguments.light_intensity, "--light-intensity")
    if arguments.light_radius is not None:
        scene = adjust_lights.sized_lights(scene, arguments.light_radius, "--light-radius")
    return scene


def _as_drawn(scene: Scene, arguments: argparse.Namespace) -> tuple[Scene, Settings]:
    """Return the scene as its settings show it, and these."""
    from ...pipeline.effective_settings import effective_settings

    return effective_settings(scene, getattr(arguments, "preset", None), **chosen_settings(arguments))


def _with_environment(scene: Scene, arguments: argparse.Namespace) -> Scene:
    """Return the scene with the environment that was asked for, and with preset pbr unless another look was."""
    from ...scene.builtin.studio import studio_for

    name = arguments.environment
    changes = {"rotation": arguments.environment_rotation, "intensity": arguments.environment_intensity}
    changes = {field: value for field, value in changes.items() if value is not None}
    if name is None or name == "none":
        if name == "none" or (scene.own_lights and scene.environment is None):
            refuse(arguments, ("environment_rotation", "environment_intensity"), "needs --environment FILE or studio")
        if name is None and not changes:
            return scene
    if name == "none":
        return replace(scene, environment=None, own_lights=True)
    if name is None:
        environment = scene.environment or studio_for(scene)
    elif name == "studio" and not os.path.exists(name):
        environment = studio_for(scene)
    else:
        from ...scene.environment import nearest_axis
        from ...scene.formats.environment import load_environment

        environment = load_environment(name, up=nearest_axis(scene.camera.up))
    try:
        environment = replace(environment, **changes) if changes else environment
    except InputError as error:
        raise InputError(f"--environment-{str(error).removeprefix('Environment: ')}") from None
    look = getattr(arguments, "preset", None) or getattr(arguments, "shader", None)
    return replace(scene, environment=environment, preset="pbr" if not look else scene.preset)


def chosen_camera(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the changes of `adjust_camera.camera_of`."""
    return {name: getattr(arguments, option) for name, option in CAMERA_OPTIONS.items()}


def _components(text: str) -> Any:
    from ...scene.material import COMPONENTS

    return names(tuple(COMPONENTS))(text)


def with_components(scene: Scene, arguments: argparse.Namespace) -> Scene:
    """Return the scene with the coefficients of its materials that were not chosen set to 0, if any were."""
    from ...scene.material import COMPONENTS
    from ...scene.model import with_materials

    if arguments.components is None:
        return scene
    off: dict[str, Any] = {name: 0.0 for component, name in COMPONENTS.items() if component not in arguments.components}
    return with_materials(scene, lambda material: replace(material, **off))
