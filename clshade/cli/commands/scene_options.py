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
from .arguments import names, numbers, resolution

if TYPE_CHECKING:
    from ...pipeline.frame import SavingOptions
    from ...scene.model import Scalars, Scene

LOAD_OPTIONS = ("texture", "focal", "crease", "flat", "up", "two_sided")  # arguments of clshade.scene.formats.load.load
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
        help="a file (.npy course scene; .obj .gltf .glb .ply .stl meshes), or a built-in scene"
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
        "--components",
        type=names(tuple(COMPONENTS)),
        metavar="NAME,...",
        help=f"use these only, of {','.join(COMPONENTS)} (default: all)",
    )
    group.add_argument(
        "--resolution",
        type=resolution,
        metavar="W,H",
        help="pixels, also WxH (default: the scene's own, 800,600 for meshes)",
    )


def camera_options(parser: argparse.ArgumentParser) -> None:
    point = numbers(float, 3, "three numbers such as 1,2,3")
    group = parser.add_argument_group("camera (default: the scene's, or chosen from its size)")
    group.add_argument("--camera-position", type=point, metavar="X,Y,Z", help="the eye, scene units")
    group.add_argument("--camera-focal-point", type=point, metavar="X,Y,Z", help="what is looked at, scene units")
    group.add_argument("--camera-view-up", type=point, metavar="X,Y,Z", help="what points up in the image")
    group.add_argument(
        "--camera-azimuth-angle", type=float, default=0.0, metavar="DEG", help="go round to the right (default: 0)"
    )
    group.add_argument("--camera-elevation-angle", type=float, default=0.0, metavar="DEG", help="go up (default: 0)")
    group.add_argument("--camera-view-angle", type=float, metavar="DEG", help="vertical field of view")
    group.add_argument("--orthographic", action="store_true", help="parallel projection")


def setting_options(parser: argparse.ArgumentParser) -> None:
    from ...images.layer_words import LAYER_WORDS
    from ...scene import settings

    group = parser.add_argument_group("settings (default: those of the preset)")
    group.add_argument("--preset", choices=settings.PRESETS, help="course for course files, else standard")
    for name, allowed, about in (
        ("shader", settings.SHADERS, "lit at vertices, at pixels, or not"),
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
    group.add_argument(
        "--near", type=float, metavar="Z", help="near plane, scene units (default: 1e-4 of the scene's radius)"
    )
    group.add_argument(
        "--samples", type=int, metavar="1..64", help="places of each pixel that are looked at (default: 1, its center)"
    )
    group.add_argument("--sample-shading", action="store_true", default=None, help="light every sample")
    group.add_argument(
        "--resolve", choices=settings.RESOLVES, help="how samples become a pixel; weighted: bright ones count less"
    )
    group.add_argument(
        "--precision",
        choices=settings.PRECISIONS,
        help="of the arithmetic (default: float32, the same bits everywhere)",
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
    group.add_argument("--nan-color", metavar="COLOR", help="of faces without a number (default: darkgray)")
    _edge_options(parser)


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
        type=numbers(float, 3, "three numbers such as 1,0.5,0"),
        metavar="R,G,B",
        help="of the lines, linear (default: 0,0,0)",
    )
    group.add_argument(
        "--edges-only", action="store_true", default=None, help="the lines alone, on white, hidden by the surfaces"
    )


def picture_options(group: argparse._ArgumentGroup) -> list[str]:
    """Add the options for writing images; return their names, the keyword arguments of `Frame.save`."""
    from ...images.exr import COMPRESSIONS
    from ...images.tonemap import OPERATORS

    group.add_argument(
        "--tonemap",
        choices=OPERATORS,
        help="of the PNG (default: none for course scenes, else srgb)",
    )
    group.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="of the PNG (default: 0)")
    group.add_argument("--half", action="store_true", help="16-bit floats in the EXR")
    group.add_argument(
        "--compression", default="zip", metavar="NAME", help=f"of the EXR: {', '.join(COMPRESSIONS)} (default: zip)"
    )
    group.add_argument(
        "--crop", action="store_true", help="keep of the EXR what is not background, if that is black or none"
    )
    group.add_argument("--colorbar", action="store_true", help="add the color map of --scalars to the right of the PNG")
    group.add_argument("--deterministic", action="store_true", help="leave times out of the EXR")
    return ["tonemap", "exposure", "half", "compression", "crop", "deterministic", "colorbar"]


def chosen_saving(arguments: argparse.Namespace) -> SavingOptions:
    """Return the keyword arguments of `Frame.save`."""
    return {
        "tonemap": arguments.tonemap,
        "exposure": arguments.exposure,
        "half": arguments.half,
        "compression": arguments.compression,
        "crop": arguments.crop,
        "deterministic": arguments.deterministic,
        "colorbar": arguments.colorbar,
    }


def chosen_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of Settings that were given."""
    from ...scene.model import Settings

    given = {f.name: getattr(arguments, f.name, None) for f in fields(Settings)}
    given["scalars"] = _chosen_scalars(arguments)
    given["edges"] = _chosen_edges(arguments)
    return {name: value for name, value in given.items() if value is not None}


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


def load_scene(arguments: argparse.Namespace, name: str | None = None) -> Scene:
    """Load the scene of the command line, or of this name: a file, or a built-in scene if no such file exists."""
    from ...base import console
    from ...scene import adjust_camera, adjust_lights
    from ...scene.builtin import scenes

    start = time.perf_counter()
    name = arguments.scene if name is None else name
    options = {name: getattr(arguments, name) for name in LOAD_OPTIONS if getattr(arguments, name) is not None}
    if name in scenes.BUILTINS and not Path(name).exists():
        for option in options:
            flag = option.replace("_", "-")
            raise InputError(f"--{flag}: expected a scene file to apply it to, found the built-in scene {name!r}")
        scene = scenes.builtin(name)
    else:
        from ...scene.formats import load

        if not Path(name).suffix and not os.path.exists(name):
            near = hint(name, scenes.BUILTINS)
            raise InputError(f"SCENE: expected a file or one of {', '.join(scenes.BUILTINS)}, found {name!r}{near}")
        scene = load.load(name, resolution=arguments.resolution, **options)
    taken = (time.perf_counter() - start) * 1e3
    console.detail(f"loaded {name}: {scene.face_count:,} triangles, {len(scene.lights)} lights, {taken:.0f} ms")
    if arguments.lights is not None:
        scene = adjust_lights.with_lights(scene, arguments.lights, "--lights")
    if arguments.light_intensity is not None:
        scene = adjust_lights.scaled_lights(scene, arguments.light_intensity, "--light-intensity")
    if arguments.components is not None:
        scene = _with_components(scene, arguments.components)
    return replace(scene, camera=adjust_camera.adjusted(scene.camera, **chosen_camera(arguments)))


def chosen_camera(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of `adjust_camera.adjusted`."""
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
