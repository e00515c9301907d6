"""clshade: headless triangle rendering with OpenCL compute kernels and measured error.

Public names are imported on first use, so that `import clshade` costs nothing.
"""

from __future__ import annotations

import sys

from .base import exchange
from .base.version import VERSION

TYPE_CHECKING = False  # importing `typing` takes longer than the rest of this module

__version__ = VERSION

_HOMES = {
    "Camera": "clshade.scene.camera",
    "PointLight": "clshade.scene.lights",
    "DirectionalLight": "clshade.scene.lights",
    "RectangleLight": "clshade.scene.lights",
    "SpotLight": "clshade.scene.lights",
    "Material": "clshade.scene.model",
    "MetallicRoughness": "clshade.scene.model",
    "Texture": "clshade.scene.model",
    "Mesh": "clshade.scene.model",
    "Scalars": "clshade.scene.model",
    "Scene": "clshade.scene.model",
    "Settings": "clshade.scene.model",
    "Edges": "clshade.scene.settings",
    "Environment": "clshade.scene.environment",
    "load_environment": "clshade.scene.formats.environment",
    "studio": "clshade.scene.builtin.studio",
    "load": "clshade.scene.formats.load",
    "load_animation": "clshade.scene.formats.load",
    "builtin": "clshade.scene.builtin.scenes",
    "render": "clshade.pipeline.renderer",
    "cryptomatte": "clshade.pipeline.visible",
    "Renderer": "clshade.pipeline.renderer",
    "Frame": "clshade.pipeline.frame",
    "flow": "clshade.pipeline.flow",
    "visible": "clshade.pipeline.visible",
    "Views": "clshade.pipeline.frame",
    "with_look": "clshade.scene.look",
    "check": "clshade.measure.check.check",
    "verify": "clshade.measure.verify.verify",
    "course": "clshade.course",  # a module itself
    "errors": "clshade.errors",
    "exr": "clshade.exr",
    "farm": "clshade.farm",
    "view": "clshade.view",
}

__all__ = [*_HOMES, "__version__"]

if TYPE_CHECKING:
    from typing import Any

    from . import course as course
    from . import errors as errors
    from . import exr as exr
    from . import farm as farm
    from . import view as view
    from .measure.check.check import check as check
    from .measure.verify.verify import verify as verify
    from .pipeline.flow import flow as flow
    from .pipeline.frame import Frame as Frame
    from .pipeline.frame import Views as Views
    from .pipeline.renderer import Renderer as Renderer
    from .pipeline.renderer import render as render
    from .pipeline.visible import cryptomatte as cryptomatte
    from .pipeline.visible import visible as visible
    from .scene.builtin.scenes import builtin as builtin
    from .scene.builtin.studio import studio as studio
    from .scene.camera import Camera as Camera
    from .scene.environment import Environment as Environment
    from .scene.formats.environment import load_environment as load_environment
    from .scene.formats.load import load as load
    from .scene.formats.load import load_animation as load_animation
    from .scene.lights import DirectionalLight as DirectionalLight
    from .scene.lights import PointLight as PointLight
    from .scene.lights import RectangleLight as RectangleLight
    from .scene.lights import SpotLight as SpotLight
    from .scene.look import with_look as with_look
    from .scene.model import Material as Material
    from .scene.model import Mesh as Mesh
    from .scene.model import MetallicRoughness as MetallicRoughness
    from .scene.model import Scalars as Scalars
    from .scene.model import Scene as Scene
    from .scene.model import Settings as Settings
    from .scene.model import Texture as Texture
    from .scene.settings import Edges as Edges


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        # Given name and obj, Python suggests the closest name of dir(clshade) in the traceback.
        raise AttributeError(f"module 'clshade' has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    import importlib

    module = importlib.import_module(_HOMES[name])
    value = module if module.__name__ == f"clshade.{name}" else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


def _notebook() -> Any:
    from .view import notebook

    return notebook


def _glb_writer() -> Any:
    from .scene.formats.gltf_writer import write_glb

    return write_glb


def _trimesh_converter() -> Any:
    from .scene.formats.from_trimesh import scene_of

    return scene_of


def _camera_chooser() -> Any:
    from .scene.framing import default_camera

    return default_camera


def _json_writer() -> Any:
    from .scene.formats.scene_json import write_scene

    return write_scene


exchange.installed.update(
    notebook=_notebook,
    to_glb=_glb_writer,
    to_json=_json_writer,
    from_trimesh=_trimesh_converter,
    default_camera=_camera_chooser,
)
