"""An environment as shading reads it, computed once and kept as long as the environment itself."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from weakref import WeakKeyDictionary

from ...base.arrays import Floats
from ..environment import Environment
from .irradiance import irradiance_coefficients
from .specular import specular_levels

_known: WeakKeyDictionary[Environment, ImageLight] = WeakKeyDictionary()
_lock = threading.Lock()


@dataclass(frozen=True, eq=False)
class ImageLight:
    """irradiance: (9, 3), see `irradiance_coefficients`. levels: octahedral maps (S, S, 3), see `specular_levels`."""

    irradiance: Floats
    levels: tuple[Floats, ...]


def image_light(environment: Environment) -> ImageLight:
    """Return the light of an environment."""
    with _lock:
        found = _known.get(environment)
        if found is None:
            found = ImageLight(irradiance_coefficients(environment), specular_levels(environment))
            for array in (found.irradiance, *found.levels):
                array.flags.writeable = False
            _known[environment] = found
        return found
