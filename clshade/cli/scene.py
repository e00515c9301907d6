"""Options of the scene, its camera and the settings, and the scene that they select."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from ..base import console
from ..base.atomic_files import shown
from ..base.declare import Declared
from ..errors import InputError
from ..images.layers import LAYER_REMARKS, LAYER_WORDS
from ..scene import adjust_camera, framing
from ..scene.builtin.studio import studio_for
from ..scene.environment import nearest_axis
from ..scene.formats.reading import VERTEX_COLORS
from ..scene.formats.table import extensions_with, listed
from ..scene.geometry import bounding_box
from ..scene.ground import with_ground
from ..scene.material import COMPONENTS
from ..scene.model import Scalars, Scene, Settings, with_materials
from ..scene.settings import EDGE_KINDS, LAYERS, LIGHT_FIELDS, LOOKS, PRESET_FIELDS, PRESETS, Edges, Look
from .options import (
    Arguments,
    Group,
    Option,
    check_scene_name,
    color,
    names,
    names_of,
    numbers,
    options_of,
    point,
    resolution,
)

# Titles of groups of options
SCENE = "scene: files, and how they are read"
LIGHTS = "lights: which there are, and what they reach"
CAMERA = "camera: by default the scene's, or one that shows all of it"
# Defaults in words
SAMPLES = "4, or 1 for scenes of the course, in Python 1"  # of pictures, see `picture_settings`
SIZE = "the scene's own, 800,600 for meshes"  # of --resolution
A_SCENE = f"a file ({listed()}), or a built-in scene"
TEAPOT = Group(SCENE, Option(f"scene SCENE: {A_SCENE}", default="teapot", nargs="?"))


class LoadFields:
    """Arguments of `clshade.load`."""

    title = SCENE
    texture = Option("--texture FILE: image to use as the texture")
    focal = Option("--focal F: focal length of a course file, scene units", float)
    crease = Option(
        "--crease DEGREES: edges above this angle are sharp, where a mesh has no normals", float, either="normals"
    )
    flat = Option("--flat: every face is flat, where a mesh has no normals", either="normals")
    weld = Option(
        "--no-weld: keep vertices at one position apart, where an OBJ or PLY file has no normals (default: join them, so "
        "that no seam shows between faces with at most 30 degrees between them)",
        either="normals",
        dest="weld",
        action="store_false",
    )
    up = Option("--up: axis that points up (default: z for STL, y for most)", choices=tuple(framing.UPS))
    two_sided = Option(
        "--[no-]two-sided: light both sides of surfaces (default: as the file asks, on where its format cannot)"
    )
    vertex_colors = Option("--vertex-colors: their encoding (default: srgb, in glTF linear)", choices=VERTEX_COLORS)
    time = Option("--time SECONDS: the pose of a glTF file's animation at this time (default: at rest)", float)
    animation = Option(
        "--animation NAME|INDEX|all: which of a glTF file's animations, by name, number from 0, or all at once (default: "
        "the first)"
    )


class Arrangement:
    title = SCENE
    look = Option(
        "--look: studio: lit by the studio, on a ground with a contact shadow; course: as the course draws; plain: as the "
        "scene is (default: studio for meshes without lights, unless an option speaks of light or layers; else plain)",
        choices=LOOKS,
    )
    ground = Option(
        "--[no-]ground: a round matte floor below the scene, which fades into the background (default: with the look "
        "studio)"
    )


class Lights:
    title = LIGHTS
    lights = Option(
        "--lights I,...: use these lights only, such as 0,2 (default: all)",
        numbers(int, (), "indices such as 0,2 (all without this option)"),
    )
    light_intensity = Option(
        "--light-intensity F,...: multiply the lights' intensities: one factor for all, or one for each that is used "
        "(default: 1)",
        numbers(float, (), "factors such as 1,0.5"),
    )
    light_radius = Option(
        "--light-radius R: make spheres of this radius of the point lights, scene units (default: as the scene says, 0 "
        "for most)",
        float,
    )
    components = Option(
        "--components NAME,...: use these terms of the light only, such as ambient,diffuse,specular (default: all)",
        names(tuple(COMPONENTS)),
    )
    environment = Option(
        "--environment FILE|studio|none: light from all around, of shader pbr: an image in latitude and longitude, .exr "
        ".hdr .png, or the built-in studio (default: the studio for scenes without lights; none: the default lights)"
    )


class EnvironmentFields:
    title = LIGHTS
    rotation = Option("--environment-rotation DEG: turn it counterclockwise seen from above (default: 0)", float)
    intensity = Option("--environment-intensity F: factor of its radiance (default: 1)", float)


class Fit:
    title = CAMERA
    camera = Option(
        "--camera fit|file: fit: show all of the scene, from three quarters or as said below; file: take the file's own "
        "(default: fit for meshes, but for animations that are played, whose camera may move)"
    )
    fit = Option("--fit: short for --camera fit", action="store_const", const="fit", dest="camera")


class CameraFields:
    """Arguments of `adjust_camera.adjusted`."""

    title = CAMERA
    position = Option("--camera-position X,Y,Z: the eye, scene units", point)
    focal_point = Option("--camera-focal-point X,Y,Z: what is looked at, scene units", point)
    up = Option("--camera-view-up X,Y,Z: what points up in the image", point)
    azimuth = Option("--camera-azimuth-angle DEG: go round to the right", float, 0.0)
    elevation = Option("--camera-elevation-angle DEG: go up", float, 0.0)
    view_angle = Option("--camera-view-angle DEG: vertical field of view", float)
    orthographic = Option("--orthographic: parallel projection")


class ScalarFields:
    """Arguments of `Scalars` besides its name."""

    title = "scalars: data on the meshes, shown by a color map"
    colormap = Option("--colormap NAME|C,C,...: one of Matplotlib's, or colors from low to high (default: viridis)")
    clim = Option(
        "--clim LOW,HIGH: values of the color map's ends (default: the least and largest in the scene)",
        numbers(float, [2], "two numbers such as 0,1"),
    )
    nan_color = Option("--nan-color COLOR: of faces without a number (default: darkgray)", color)


# Without a look, these mean the scene as it is: they speak of light, or want data on the scene alone.
_PLAIN_WITH = (
    *("preset", "shader", "environment", "components", "lights", "light_intensity", "light_radius", "light_samples"),
    *("shadows", "ambient_occlusion", "scalars", "edges"),
    *("layers", "cryptomatte", "visible", "flow_to", "save_scene", "views", "sheet"),
)
_PICTURE_DEFAULTS = {
    "samples": SAMPLES,
    "sample_shading": "yes where there are textures, shadows or ambient occlusion",
    "ambient_occlusion": "0, or 16 with --shadows where an environment is the light",
    "shadows": "yes with preset pbr or under a rectangle light, else no",
}
_EDGE_NAMES = {"kinds": "edges", **{name: f"edge_{name}" for name in ("angle", "width", "color")}, "only": "edges_only"}


def scene_options(*more: type | Group, size: str = SIZE, samples: str | None = SAMPLES) -> list[type | Group]:
    """Return the options of a scene, its camera and the settings, and more. size, samples: the defaults of --resolution and
    --samples; a command without samples has no settings."""
    resolution_option = Option(f"--resolution W,H: pixels, also WxH (default: {size})", resolution)
    groups: list[type | Group] = [LoadFields, Arrangement, Group(SCENE, resolution_option)]
    groups += [Lights, EnvironmentFields, Fit, CameraFields]
    if samples is not None:
        options = _setting_options(Settings, _PICTURE_DEFAULTS if samples == SAMPLES else {"samples": samples})
        light = [options.pop(name) for name in LIGHT_FIELDS]
        scalars, _ = options.pop("scalars"), options.pop("edges")  # an object, whose fields are options
        preset = Option("--preset: course for course files, pbr for glTF files, else standard", choices=PRESETS)
        edges = _setting_options(Edges, {})
        groups += [
            Group(LIGHTS, *light),
            Group("settings: by default those of the preset", preset, *options.values()),
            Group(ScalarFields.title, scalars, ScalarFields),
            Group("edges: of the meshes, drawn as lines", *(edges[name] for name in _EDGE_NAMES)),
        ]
    return [*groups, *more]


def light_options() -> list[Option]:
    """Return the fields of Settings that say which light arrives, for all variants of a study."""
    options = _setting_options(Settings, {})
    return [options[name] for name in LIGHT_FIELDS]


def _setting_options(kind: Any, defaults: Mapping[str, str]) -> dict[str, Option]:
    """Return the options of the fields of Settings or Edges, as they are declared there, by the fields' names. defaults: in
    words, where the command has its own."""
    readers: dict[str, Callable[[str], Any]] = {
        "layers": names((*LAYERS, "all"), words=LAYER_WORDS, remarks=LAYER_REMARKS),
        "kinds": names(EDGE_KINDS),
        "background": partial(color, names=("none", "scene", "environment")),
        "color": color,
    }
    by_preset = {name for changed in PRESET_FIELDS.values() for name in changed}
    options = {}
    for field in fields(kind):
        declaration: Declared = field.metadata["declared"]
        default = defaults.get(field.name) or declaration.usual
        if not (
            default or field.name in by_preset or field.default is None or isinstance(field.default, (bool, tuple))
        ):
            default = f"{field.default:g}" if isinstance(field.default, float) else str(field.default)
        is_flag = declaration.read is None and not declaration.choices
        name = _EDGE_NAMES.get(field.name, field.name).replace("_", "-")
        head = f"--{'[no-]' if is_flag and default else ''}{name} {declaration.form or ''}".rstrip()
        about = f"{head}: {declaration.help}" + (f" (default: {default})" if default else "")
        choices: dict[str, Any] = {"choices": declaration.choices} if declaration.choices else {}
        options[field.name] = Option(about, readers.get(field.name) or declaration.read or str, **choices)
    return options


def picture_settings(arguments: Arguments, scene: Scene) -> dict[str, Any]:
    """Return the settings of the options, and the defaults of pictures."""
    from ..pipeline.effective_settings import picture_fields

    return picture_fields(scene, arguments.get("preset"), **chosen_settings(arguments))


def chosen_settings(arguments: Arguments) -> dict[str, Any]:
    """Return the fields of Settings that are set. Raises InputError for options that need scalars or edges without."""
    settings: dict[str, Any] = {name: arguments.get(name) for name in Settings.__dataclass_fields__}
    if settings["scalars"] is None:
        arguments.refuse((*options_of(ScalarFields), "colorbar"), "needs --scalars NAME")
    else:
        how = arguments.keywords(ScalarFields)
        if "," in how.get("colormap", ""):
            how["colormap"] = how["colormap"].split(",")
        settings["scalars"] = Scalars(settings["scalars"], **how)
    if settings["edges"] is None:
        arguments.refuse(_EDGE_NAMES.values(), "needs --edges, such as --edges feature,silhouette")
    else:
        how = {name: getattr(arguments, option) for name, option in _EDGE_NAMES.items()}
        settings["edges"] = Edges(**{name: value for name, value in how.items() if value is not None})
    settings = {name: value for name, value in settings.items() if value is not None}
    if "depth" in (arguments.get("formats") or ()) and "all" not in settings.get("layers", ()):
        settings["layers"] = tuple(dict.fromkeys((*settings.get("layers", ()), "Z")))
    return settings | ({"background": None} if settings.get("background") == "none" else {})


# The scene that the options select: read, then its lights and look, then camera and ground


def load_scene(arguments: Arguments, name: str | None = None, *, turning: bool = False) -> Scene:
    """Load the scene of the command line, or of this name: a file, or a built-in scene if no such file exists.

    turning: its camera will go round what it looks at; one that is chosen here shows all of the scene all the time.
    """
    return apply_options(read_scene(arguments, arguments.scene if name is None else name), arguments, turning=turning)


def read_scene(arguments: Arguments, name: str) -> Scene:
    """Load a scene as it is, with its own camera, lights and environment."""
    from ..scene.builtin import scenes

    start = time.perf_counter()
    if name in scenes.BUILTINS and not Path(name).exists():
        arguments.refuse(names_of(LoadFields), f"needs a scene file, not the built-in scene {name!r}")
        if arguments.camera == "file":
            raise InputError(f"--camera: file needs a scene file, not the built-in scene {name!r}")
        scene = scenes.builtin(name, **({"soft": True} if name == "box_room" else {}))
        scene = adjust_camera.refitted(scene, arguments.resolution) if arguments.camera == "fit" else scene
    else:
        check_scene_name(name)
        scene = _read_file(arguments, name)
    elapsed = (time.perf_counter() - start) * 1e3
    console.detail(f"loaded {name}: {scene.face_count:,} triangles, {len(scene.lights)} lights, {elapsed:.0f} ms")
    return scene


def _read_file(arguments: Arguments, name: str) -> Scene:
    from ..scene.formats import load

    options = arguments.keywords(LoadFields)
    extension = Path(name).suffix.lower()
    if extension in extensions_with("weld"):
        options.setdefault("weld", True)
    fit = arguments.camera == "fit" or (arguments.camera is None and extension in extensions_with("time"))
    scene = load.load(name, resolution=arguments.resolution, fit=fit, **options)
    print_load_notes(scene, arguments, name)
    if scene.animations and not {"time", "animation"} & options.keys():
        listed = ", ".join(shown(title) if title else f"number {k}" for k, title in enumerate(scene.animations[:8]))
        more = ", ..." if len(scene.animations) > 8 else ""
        console.progress(
            f"{shown(name)}: at rest: --time SECONDS shows a pose of its animations ({listed}{more}), `clshade animate` "
            "plays one"
        )
    return scene


def print_load_notes(scene: Scene, arguments: Arguments, name: str) -> None:
    """Say what was taken from a file, and what was made of it."""
    if arguments.camera == "file" and scene.fitted:
        raise InputError(f"--camera: expected a file that has one, found none in {shown(name)}")
    if arguments.camera is None and not scene.fitted and scene.preset != "course" and arguments.camera_position is None:
        console.progress(f"{shown(name)}: the camera is the file's own: --fit chooses one that shows all of the scene")
    guessed = {*extensions_with("up")} - {*extensions_with("time")}  # glTF says that y is up
    if Path(name).suffix.lower() in guessed and arguments.up is None and arguments.camera_view_up is None:
        up = framing.up_of(scene.camera)
        likely = framing.likely_up(*bounding_box(scene), up)
        if likely is not None:
            console.progress(f"{shown(name)}: {up} is up, but its extents suggest {likely}: --up {likely} shows it so")
    if scene.light_scale != 1.0:
        console.progress(
            f"{shown(name)}: lights: intensities (candela, lux) times {scene.light_scale:.4g}, so that the strongest has 1 "
            "at the center; --light-intensity changes that"
        )


def apply_lights(scene: Scene, arguments: Arguments) -> tuple[Scene, Look]:
    """Return the scene with the lights and the environment of the options, as its look shows it without a ground, and
    this look."""
    from ..scene.look import with_look

    scene = _with_environment(with_lights(scene, arguments), arguments)
    look = choose_look(scene, arguments)
    return with_look(scene, look, ground=False, up=arguments.up or framing.up_of(scene.camera)), look


def apply_options(scene: Scene, arguments: Arguments, *, turning: bool = False, moving: bool = False) -> Scene:
    """Return a scene that was loaded with the lights, look, environment, camera, ground, components and resolution of the
    options.

    moving: its meshes will be in other places; it has the resolution already.
    """
    from ..scene.look import with_look

    scene, look = apply_lights(scene, arguments)
    up = arguments.up or framing.up_of(scene.camera)
    for option, purpose in (("light_intensity", "multiply"), ("light_radius", "give a size")):
        if getattr(arguments, option) is not None and scene.lights and not _as_drawn(scene, arguments)[0].lights:
            raise InputError(
                f"--{option.replace('_', '-')}: expected lights to {purpose}, found none: the environment lights the scene, "
                "see --environment-intensity"
            )
    changes, fit = arguments.keywords(CameraFields), arguments.camera == "fit"
    scene = replace(scene, camera=adjust_camera.camera_of(scene, changes, fit=fit, turning=turning))
    if wants_ground(look, arguments):
        refuse_grounded_edges(arguments)
        settings = _as_drawn(scene, arguments)[1]
        if look == "studio":
            shadow = not moving and not picture_settings(arguments, scene).get("ambient_occlusion")
            scene = with_look(scene, look, contact_shadow=shadow, up=up, settings=settings)
        else:
            scene = with_ground(scene, up, settings)
    if arguments.resolution is not None and not moving:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    return with_components(scene, arguments)


def _as_drawn(scene: Scene, arguments: Arguments) -> tuple[Scene, Settings]:
    """Return the scene as its settings show it, and these."""
    from ..pipeline.effective_settings import effective_settings

    return effective_settings(scene, arguments.get("preset"), **chosen_settings(arguments))


def wants_ground(look: Look, arguments: Arguments) -> bool:
    """Return whether a scene of this look gets a ground."""
    from ..scene.look import has_ground

    usual = has_ground(look, arguments.get("edges"))
    return usual if arguments.ground is None else bool(arguments.ground)


def refuse_grounded_edges(arguments: Arguments) -> None:
    """Raise InputError for a ground whose edges would be drawn too."""
    if arguments.ground and arguments.get("edges"):
        raise InputError("--ground: cannot go with --edges, which would draw its edges too")


def choose_look(scene: Scene, arguments: Arguments) -> Look:
    """Return the look of a scene: that of --look; else the studio, where lights only stand in for missing ones and no
    option means the scene as it is. Raises InputError for a preset beside a look, and lights beside the studio."""
    look: Look | None = arguments.look
    if look in ("studio", "course") and arguments.get("preset"):
        raise InputError(f"--look: {look} cannot go with --preset, which it chooses")
    if look == "studio":
        why = "cannot go with --look studio, whose environment is the light"
        arguments.refuse(("lights", "light_intensity", "light_radius", "light_samples"), why)
        if arguments.environment == "none":
            raise InputError(f"--environment: none {why}")
    if look is not None:
        return look
    values = (arguments.get(name) for name in _PLAIN_WITH)
    is_plain = scene.own_lights or scene.preset == "course" or any(value or type(value) is float for value in values)
    is_cutout = "depth" in (arguments.get("formats") or ()) or arguments.get("background") == "none"
    return "plain" if is_plain or is_cutout else "studio"


def with_lights(scene: Scene, arguments: Arguments) -> Scene:
    """Return the scene with the lights of the options, at their intensities."""
    from ..scene import look

    if arguments.lights is not None:
        scene = look.with_lights(scene, arguments.lights, "--lights")
    if arguments.light_intensity is not None:
        scene = look.scaled_lights(scene, arguments.light_intensity, "--light-intensity")
    if arguments.light_radius is not None:
        scene = look.sized_lights(scene, arguments.light_radius, "--light-radius")
    return scene


def _with_environment(scene: Scene, arguments: Arguments) -> Scene:
    """Return the scene with the environment of the options, and with preset pbr unless they choose preset or shader."""
    name, changes = arguments.environment, arguments.keywords(EnvironmentFields)
    if name == "none" or (name is None and scene.own_lights and scene.environment is None):
        arguments.refuse(("environment_rotation", "environment_intensity"), "needs --environment FILE or studio")
    if name == "none":
        return replace(scene, environment=None, own_lights=True)
    if name is None and not changes:
        return scene
    if name is None:
        environment = scene.environment or studio_for(scene)
    elif name == "studio" and not os.path.exists(name):
        environment = studio_for(scene)
    else:
        from ..scene.formats.environment import load_environment

        environment = load_environment(name, up=nearest_axis(scene.camera.up))
    try:
        environment = replace(environment, **changes) if changes else environment
    except InputError as error:
        raise InputError(f"--environment-{str(error).removeprefix('Environment: ')}") from None
    shading = arguments.get("preset") or arguments.get("shader")
    return replace(scene, environment=environment, preset=scene.preset if shading else "pbr")


def with_components(scene: Scene, arguments: Arguments) -> Scene:
    """Return the scene with the coefficients of its materials that --components leaves out set to 0."""
    if arguments.components is None:
        return scene
    off: dict[str, Any] = {name: 0.0 for component, name in COMPONENTS.items() if component not in arguments.components}
    return with_materials(scene, lambda material: replace(material, **off))
