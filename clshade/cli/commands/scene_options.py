"""Options for the scene, its camera and the settings, and the scene that they select."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base.spelling import hint
from ...errors import InputError
from .arguments import background, color, names, numbers, resolution

if TYPE_CHECKING:
    from ...scene.model import Scalars, Scene, Settings

# Arguments of clshade.scene.formats.load.load; besides `fit`, which built-in scenes have, too.
LOAD_OPTIONS = ("texture", "focal", "crease", "flat", "up", "two_sided", "time", "animation")
SAMPLES_HELP = "4, or 1 for scenes of the course, in Python 1"  # `picture_settings`, in words
COMPONENTS = {"ambient": "ka", "diffuse": "kd", "specular": "ks"}


def scene_options(
    parser: argparse.ArgumentParser, *, several: bool = False, required: bool = False, default: str | None = "teapot"
) -> None:
    """Add `arguments.scene`, or with `several` the list `arguments.scenes`, and the options that change scenes.

    required: the scene is mandatory, so that another positional argument may follow. default: None, or the scene used
    without one.
    """
    group = parser.add_argument_group("scene")
    group.add_argument(
        "scenes" if several else "scene",
        nargs=None if required else "*" if several else "?",
        default=[default] if several else default,
        metavar="SCENE",
        help="a file (.npy course scene; .obj .gltf .glb .ply .stl meshes; .json saved scene), or a built-in scene"
        + ("" if default is None else f" (default: {default})"),
    )
    scene_changes(group)


def scene_changes(group: argparse._ArgumentGroup) -> None:
    """Add the options that change scenes."""
    group.add_argument("--texture", metavar="FILE", help="image to use as the texture")
    group.add_argument("--focal", type=float, metavar="F", help="focal length of a course file, scene units")
    edges = group.add_mutually_exclusive_group()
    edges.add_argument(
        "--crease", type=float, metavar="DEGREES", help="edges above this angle are sharp, where a mesh has no normals"
    )
    edges.add_argument(
        "--flat", action="store_true", default=None, help="every face is flat, where a mesh has no normals"
    )
    group.add_argument(
        "--up", choices=("x", "y", "z", "-x", "-y", "-z"), help="axis that points up (default: z for STL, else y)"
    )
    group.add_argument(
        "--two-sided",
        action=argparse.BooleanOptionalAction,
        help="light both sides of surfaces (default: as glTF files ask, on for OBJ, PLY and STL)",
    )
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
        "--lights",
        type=numbers(int, None, "indices such as 0,2 (all without this option)"),
        metavar="I,...",
        help="use these lights only, such as 0,2 (default: all)",
    )
    group.add_argument(
        "--light-intensity",
        type=numbers(float, None, "factors such as 1,0.5"),
        metavar="F,...",
        help="multiply the lights' intensities: one factor for all, or one for each that is used (default: 1)",
    )
    group.add_argument(
        "--light-radius",
        type=float,
        metavar="R",
        help="make spheres of this radius of the point lights, scene units (default: as the scene says, 0 for most)",
    )
    group.add_argument(
        "--environment",
        metavar="FILE|studio|none",
        help="light from all around, of shader pbr: an image in latitude and longitude, .exr .hdr .png, or the built-in "
        "studio (default: the studio for scenes without lights; none: the default lights)",
    )
    group.add_argument(
        "--environment-rotation",
        type=float,
        metavar="DEG",
        help="turn it counterclockwise seen from above (default: 0)",
    )
    group.add_argument("--environment-intensity", type=float, metavar="F", help="factor of its radiance (default: 1)")
    group.add_argument(
        "--components",
        type=names(tuple(COMPONENTS)),
        metavar="NAME,...",
        help=f"use these only, of {','.join(COMPONENTS)} (default: all)",
    )
    group.add_argument(
        "--ground", action="store_true", help="a round matte floor below the scene, which fades into the background"
    )
    group.add_argument(
        "--resolution",
        type=resolution,
        metavar="W,H",
        help="pixels, also WxH (default: the scene's own, 800,600 for meshes)",
    )


def camera_options(parser: argparse.ArgumentParser) -> None:
    point = numbers(float, 3, "three numbers such as 1,2,3")
    group = parser.add_argument_group("camera (default: the scene's, or one that shows all of it)")
    group.add_argument(
        "--fit",
        action="store_true",
        help="show all of the scene, from three quarters or as said below, and ignore its camera",
    )
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
    from ...images.layer_words import LAYER_WORDS
    from ...scene import settings

    group = parser.add_argument_group("settings (default: those of the preset)")
    group.add_argument(
        "--preset", choices=settings.PRESETS, help="course for course files, pbr for glTF files, else standard"
    )
    for name, allowed, about in (
        ("shader", settings.SHADERS, "Phong's model at vertices or pixels, no light, or metallic-roughness"),
        ("visibility", settings.VISIBILITIES, "what hides what: triangles by mean depth, or each pixel's depth"),
        ("lighting-at", settings.LIGHTING_AT, "where lights and eye are seen from"),
        ("interpolation", settings.INTERPOLATIONS, "of colors and normals over a triangle"),
        ("texture-at", settings.TEXTURE_AT, "where textures are looked up"),
    ):
        group.add_argument(f"--{name}", choices=allowed, help=about)
    group.add_argument(
        "--texture-filter", choices=settings.TEXTURE_FILTERS, help="trilinear: mip-mapped (default: bilinear)"
    )
    group.add_argument("--ambient", choices=settings.AMBIENTS, help="ambient light: ka*Ia, or ka*Ia*color")
    group.add_argument(
        "--layers",
        type=names((*settings.LAYERS, "all"), words=LAYER_WORDS, remarks=settings.LAYER_REMARKS),
        metavar="NAME,...",
        help=f"further layers: {','.join(settings.LAYERS)}; or all",
    )
    group.add_argument("--cull", action="store_true", default=None, help="leave out triangles seen from behind")
    ray_options(group)
    group.add_argument(
        "--near", type=float, metavar="Z", help="near plane, scene units (default: 1e-4 of the scene's radius)"
    )
    group.add_argument(
        "--samples", type=int, metavar="1..64", help=f"places of each pixel that are looked at (default: {samples})"
    )
    group.add_argument("--sample-shading", action="store_true", default=None, help="light every sample")
    group.add_argument(
        "--layer-alpha",
        type=float,
        metavar="A",
        help="layers show the nearest surface whose alpha is at least A, 0 to 1 (default: 0.5)",
    )
    group.add_argument(
        "--resolve", choices=settings.RESOLVES, help="how samples become a pixel; weighted: bright ones count less"
    )
    group.add_argument(
        "--precision",
        choices=settings.PRECISIONS,
        help="of the arithmetic (default: float32, the same bits everywhere)",
    )
    group.add_argument(
        "--background",
        type=background,
        metavar="none|environment|COLOR",
        help="behind the surfaces: none, which makes the PNG transparent; environment, what lights the scene from all "
        "around; a name or #rrggbb, sRGB; or R,G,B, linear (default: the scene's)",
    )
    group.add_argument("--scalars", metavar="NAME", help="data on the meshes to color them by, with a color map")
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
    _edge_options(parser)


def ray_options(group: argparse._ArgumentGroup) -> None:
    """Add the fields of Settings that say which light arrives, for the preset or all ways of a study."""
    group.add_argument(
        "--shadows",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="lights reach only what no triangle hides (default: yes with preset pbr, else no)",
    )
    group.add_argument(
        "--light-samples",
        type=int,
        metavar="1..256",
        help="points of each light of finite size that its light is the mean of (default: 16)",
    )
    group.add_argument(
        "--ambient-occlusion",
        type=int,
        metavar="0..1024",
        help="rays from each point that look for triangles nearby, which keep ambient light away (default: 0, none)",
    )
    group.add_argument(
        "--ao-distance",
        type=float,
        metavar="D",
        help="how far these rays reach, scene units (default: 0.2 of the scene's diagonal)",
    )


def _edge_options(parser: argparse.ArgumentParser) -> None:
    from ...scene.edges import EDGE_KINDS, MAX_WIDTH

    group = parser.add_argument_group("edges of the meshes, drawn as lines")
    group.add_argument(
        "--edges",
        type=names(EDGE_KINDS),
        metavar="KIND,...",
        help="which: all; feature, between faces at an angle; silhouette; boundary, of one face; nonmanifold, of more "
        "than two, in red",
    )
    group.add_argument("--edge-angle", type=float, metavar="DEG", help="least angle of feature edges (default: 30)")
    group.add_argument(
        "--edge-width", type=float, metavar="PIXELS", help=f"of the lines, at most {MAX_WIDTH:g} (default: 1.5)"
    )
    group.add_argument(
        "--edge-color",
        type=color,
        metavar="COLOR",
        help="of the lines: a name, #rrggbb, or R,G,B, linear (default: black)",
    )
    group.add_argument(
        "--edges-only", action="store_true", default=None, help="the lines alone, on white, hidden by the surfaces"
    )


def picture_settings(arguments: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return the fields of Settings that were given, and the samples of a picture for people."""
    from ...scene.settings import picture_samples

    return {"samples": picture_samples(scene.preset, arguments.preset), **chosen_settings(arguments)}


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
    given = {name: getattr(arguments, name) for name in names if getattr(arguments, name, None) is not None}
    if getattr(arguments, "scalars", None) is None:
        for name in (*given, *(("colorbar",) if getattr(arguments, "colorbar", False) else ())):
            option = name.replace("_", "-")
            raise InputError(f"--{option}: expected --scalars NAME beside it, found none")
        return None
    from ...scene.model import Scalars

    if "," in given.get("colormap", ""):
        given["colormap"] = given["colormap"].split(",")
    return Scalars(arguments.scalars, **given)


def _chosen_edges(arguments: argparse.Namespace) -> Any:
    """Return the Edges that were asked for, or None."""
    from ...scene.edges import Edges

    options = {"angle": "edge_angle", "width": "edge_width", "color": "edge_color", "only": "edges_only"}
    given: dict[str, Any] = {name: getattr(arguments, option, None) for name, option in options.items()}
    given = {name: value for name, value in given.items() if value is not None}
    kinds = getattr(arguments, "edges", None)
    if kinds is None:
        for name in given:
            flag = options[name].replace("_", "-")
            raise InputError(f"--{flag}: expected --edges with it, such as --edges feature,silhouette, found none")
        return None
    return Edges(kinds, **given)


def load_scene(arguments: argparse.Namespace, name: str | None = None, *, turning: bool = False) -> Scene:
    """Load the scene of the command line, or of this name: a file, or a built-in scene if no such file exists.

    turning: its camera will go round what it looks at; one that is chosen here shows all of the scene all the time.
    """
    from ...base import console
    from ...base.atomic_files import shown
    from ...scene import adjust_camera
    from ...scene.builtin import scenes

    start = time.perf_counter()
    name = arguments.scene if name is None else name
    options = load_options(arguments)
    if name in scenes.BUILTINS and not Path(name).exists():
        for option in options:
            flag = option.replace("_", "-")
            raise InputError(f"--{flag}: expected a scene file to apply it to, found the built-in scene {name!r}")
        scene = scenes.builtin(name)
        scene = adjust_camera.refitted(scene, arguments.resolution) if arguments.fit else scene
    else:
        from ...scene.formats import load

        if not Path(name).suffix and not os.path.exists(name):
            near = hint(name, scenes.BUILTINS)
            raise InputError(f"SCENE: expected a file or one of {', '.join(scenes.BUILTINS)}, found {name!r}{near}")
        scene = load.load(name, resolution=arguments.resolution, fit=arguments.fit, **options)
        tell_of_file(scene, arguments, name)
        if scene.animations and arguments.time is None and arguments.animation is None:
            listed = ", ".join(shown(each) if each else f"number {k}" for k, each in enumerate(scene.animations[:8]))
            more = ", ..." if len(scene.animations) > 8 else ""
            console.note(
                f"{shown(name)}: at rest: --time SECONDS shows a pose of its animations ({listed}{more}), `clshade animate` "
                "plays one"
            )
    taken = (time.perf_counter() - start) * 1e3
    console.detail(f"loaded {name}: {scene.face_count:,} triangles, {len(scene.lights)} lights, {taken:.0f} ms")
    return arranged(scene, arguments, turning=turning)


def load_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options for `load` that were given, besides `fit` and the resolution."""
    return {name: getattr(arguments, name) for name in LOAD_OPTIONS if getattr(arguments, name) is not None}


def tell_of_file(scene: Scene, arguments: argparse.Namespace, name: str) -> None:
    """Say what was taken from a file, and what was made of it."""
    from ...base import console
    from ...base.atomic_files import shown

    if not scene.fitted and scene.preset != "course" and arguments.camera_position is None:
        console.note(f"{shown(name)}: the camera is the file's own: --fit chooses one that shows all of the scene")
    if scene.light_scale != 1.0:
        console.note(
            f"{shown(name)}: lights: intensities (candela, lux) times {scene.light_scale:.4g}, so that the strongest has 1 "
            "at the center; --light-intensity changes that"
        )


def arranged(scene: Scene, arguments: argparse.Namespace, *, turning: bool = False) -> Scene:
    """Return a scene that was loaded, with the lights, environment, camera, ground and components of the command line."""
    from ...scene import adjust_camera, framing

    scene = with_lights(scene, arguments)
    scene = _with_environment(scene, arguments)
    if arguments.light_intensity is not None and scene.lights and not _as_drawn(scene, arguments)[0].lights:
        raise InputError(
            "--light-intensity: expected lights to multiply, found none: the environment lights the scene, see "
            "--environment-intensity"
        )
    up = arguments.up or framing.up_of(scene.camera)
    camera = adjust_camera.camera_of(scene, chosen_camera(arguments), fit=arguments.fit, turning=turning)
    scene = replace(scene, camera=camera)
    scene = _with_ground(scene, arguments, up) if arguments.ground else scene
    return scene if arguments.components is None else _with_components(scene, arguments.components)


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


def _with_ground(scene: Scene, arguments: argparse.Namespace, up: Any) -> Scene:
    """Return the scene with a ground for the settings that will draw it."""
    from ...scene.ground import with_ground

    if getattr(arguments, "edges", None):
        raise InputError("--ground: expected none with --edges, which would draw its edges too, found one")
    return with_ground(scene, up, _as_drawn(scene, arguments)[1])


def _with_environment(scene: Scene, arguments: argparse.Namespace) -> Scene:
    """Return the scene with the environment that was asked for, and with preset pbr unless another look was."""
    from ...scene.builtin.studio import studio_for

    name = arguments.environment
    changes = {"rotation": arguments.environment_rotation, "intensity": arguments.environment_intensity}
    changes = {field: value for field, value in changes.items() if value is not None}
    if name is None or name == "none":
        for field in changes if name == "none" or scene.own_lights else ():
            raise InputError(f"--environment-{field}: expected --environment FILE or studio with it, found none")
        if name is None and not changes:
            return scene
    if name == "none":
        return replace(scene, environment=None, own_lights=True)
    if name is None or (name == "studio" and not os.path.exists(name)):
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
    return {
        "position": arguments.camera_position,
        "focal_point": arguments.camera_focal_point,
        "up": arguments.camera_view_up,
        "azimuth": arguments.camera_azimuth_angle,
        "elevation": arguments.camera_elevation_angle,
        "view_angle": arguments.camera_view_angle,
        "orthographic": arguments.orthographic,
    }


def _with_components(scene: Scene, chosen: Sequence[str]) -> Scene:
    """Return the scene with all other coefficients of its materials set to 0."""
    off: dict[str, Any] = {name: 0.0 for component, name in COMPONENTS.items() if component not in chosen}
    changed = {id(mesh.material): replace(mesh.material, **off) for mesh in scene.meshes}
    return replace(scene, meshes=tuple(replace(mesh, material=changed[id(mesh.material)]) for mesh in scene.meshes))
