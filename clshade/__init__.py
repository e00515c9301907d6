"""clshade: headless triangle rendering by OpenCL compute kernels, with measured error.

Public names are imported on first use, so that `import clshade` costs nothing.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # `typing` takes longer to import than all else that happens here

__version__ = "0.1.0"

_HOMES = {
    "Camera": "scene.camera",
    "PointLight": "scene.model",
    "Material": "scene.model",
    "Texture": "scene.model",
    "Mesh": "scene.model",
    "Scene": "scene.model",
    "Settings": "scene.model",
    "load": "scene.formats.load",
    "builtin": "scene.builtin.scenes",
    "render": "pipeline.renderer",
    "Renderer": "pipeline.renderer",
    "Frame": "pipeline.frame",
    "check": "measure.check.check",
    "course": "",  # a module of this name
    "errors": "",
    "exr": "",
    "farm": "",
}

__all__ = [*_HOMES, "__version__"]

if TYPE_CHECKING:
    from typing import Any

    from . import course as course
    from . import errors as errors
    from . import exr as exr
    from . import farm as farm
    from .measure.check.check import check as check
    from .pipeline.frame import Frame as Frame
    from .pipeline.renderer import Renderer as Renderer
    from .pipeline.renderer import render as render
    from .scene.builtin.scenes import builtin as builtin
    from .scene.camera import Camera as Camera
    from .scene.formats.load import load as load
    from .scene.model import Material as Material
    from .scene.model import Mesh as Mesh
    from .scene.model import PointLight as PointLight
    from .scene.model import Scene as Scene
    from .scene.model import Settings as Settings
    from .scene.model import Texture as Texture


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        # With name and obj Python adds the nearest of dir(clshade) to the traceback.
        raise AttributeError(f"module 'clshade' has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    import importlib

    home = _HOMES[name]
    value = (
        getattr(importlib.import_module(f".{home}", __name__), name)
        if home
        else importlib.import_module(f".{name}", __name__)
    )
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
