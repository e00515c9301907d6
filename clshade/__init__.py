"""clshade: headless triangle rendering by OpenCL compute kernels, with measured error.

Public names are imported on first use, so that `import clshade` costs nothing.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # `typing` takes longer to import than all else that happens here

__version__ = "0.1.0"

_HOMES = {
    "Camera": "camera",
    "PointLight": "scene",
    "Material": "scene",
    "Texture": "scene",
    "Mesh": "scene",
    "Scene": "scene",
    "Settings": "scene",
    "load": "loading",
    "builtin": "scenes",
    "render": "renderer",
    "Renderer": "renderer",
    "Frame": "frame",
    "check": "checks.checking",
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
    from .camera import Camera as Camera
    from .checks.checking import check as check
    from .frame import Frame as Frame
    from .loading import load as load
    from .renderer import Renderer as Renderer
    from .renderer import render as render
    from .scene import Material as Material
    from .scene import Mesh as Mesh
    from .scene import PointLight as PointLight
    from .scene import Scene as Scene
    from .scene import Settings as Settings
    from .scene import Texture as Texture
    from .scenes import builtin as builtin


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
