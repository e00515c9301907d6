"""A neutral studio made in code: the light of scenes that have none of their own."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...base.arrays import Floats
from ...base.validation import vector
from ..environment import Environment, nearest_axis
from ..material import is_unlit
from ..model import Scene, with_fields, with_materials

ROWS, COLUMNS = 256, 512
MEAN = 0.46  # of the radiance over the sphere: a white matte ball is half as bright as white
_CEILING, _HORIZON, _FLOOR = 0.34, 0.26, 0.15  # radiance of the room, before it is scaled to MEAN
_NONE = np.zeros(3)
_NONE.flags.writeable = False
_WARM, _COOL, _WHITE = (1.0, 0.97, 0.93), (0.94, 0.97, 1.0), (1.0, 1.0, 1.0)


class SoftBox(NamedTuple):
    """A rectangular lamp with soft edges. longitude, latitude: of its center, degrees, from the front to the left and up.
    width, height: its half sizes, and how far its edge fades, as tangents of angles."""

    longitude: float
    latitude: float
    width: float
    height: float
    edge: float
    radiance: float
    color: tuple[float, float, float]


# The camera of a mesh file looks from the front, a little from the right and above; longitude grows to the object's left.
BOXES = (
    SoftBox(-48.0, 38.0, 0.55, 0.42, 0.10, 8.0, _WARM),  # key, from the upper left of the image
    SoftBox(88.0, 22.0, 0.28, 0.85, 0.10, 3.2, _COOL),  # fill, a tall strip on the right
    SoftBox(-132.0, 26.0, 0.22, 0.95, 0.08, 5.0, _COOL),  # rim, a tall strip behind on the left
    SoftBox(158.0, 40.0, 0.60, 0.26, 0.10, 3.0, _WARM),  # rim, behind on the right
    SoftBox(20.0, 80.0, 0.75, 0.45, 0.25, 2.0, _WHITE),  # overhead
)


def studio(up: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> Environment:
    """Return a neutral studio, the light of scenes without any: soft boxes in a room with a bright ceiling and a dark floor.

    Parameters
    ----------
    up : tuple of three floats, default (0, 1, 0)
        Direction of the ceiling, world space.

    Returns
    -------
    Environment
        The same call gives the same object, so that what shading needs of it is computed once.
    """
    return _studio(tuple(vector("studio", "up", up).tolist()))


@functools.cache
def _studio(up: tuple[float, float, float]) -> Environment:
    return Environment(_image(), up=up, name="studio")


def studio_for(scene: Scene) -> Environment:
    """Return the studio with its ceiling along the axis nearest to the camera's up."""
    return studio(nearest_axis(scene.camera.up))


def without_stand_ins(scene: Scene) -> Scene:
    """Return the scene as shader pbr shows it: lit by an environment alone, the studio if it has none, where its lights only
    stand in for missing ones."""
    if scene.own_lights:
        return scene
    scene = replace(scene, lights=(), environment=scene.environment or studio_for(scene))
    if not any(is_unlit(mesh.material) for mesh in scene.meshes):
        return replace(scene, ambient=0.0)
    return with_materials(scene, lambda material: material if is_unlit(material) else with_fields(material, ka=_NONE))


@functools.cache
def _image() -> Floats:
    """Return the radiance (ROWS, COLUMNS, 3), rounded so far that the last bits of a machine's sines do not show."""
    polar = (np.arange(ROWS) + 0.5) * (np.pi / ROWS)
    longitude = np.pi - (np.arange(COLUMNS) + 0.5) * (2.0 * np.pi / COLUMNS)
    sine, height = np.sin(polar)[:, None], np.cos(polar)[:, None]
    d = np.stack(np.broadcast_arrays(sine * np.cos(longitude), sine * np.sin(longitude), height), axis=-1)
    # A floor that darkens downward, with a soft horizon, and walls that brighten upward.
    walls = _HORIZON + (_CEILING - _HORIZON) * _smooth(height)
    floor = _FLOOR + (0.7 * _HORIZON - _FLOOR) * _smooth(1.0 + height / 0.7)
    room = floor + (walls - floor) * _smooth(height / 0.16 + 0.5)
    image = room[..., None] * np.ones((ROWS, COLUMNS, 3))
    for box in BOXES:
        _add_lamp(image, d, box)
    weight = np.broadcast_to(sine, image.shape[:2])
    image = image * (MEAN / np.average(image.mean(axis=2), weights=weight))
    return np.asarray(np.round(image * 4096.0) / 4096.0)


def _smooth(x: Floats) -> Floats:
    """Return 0 below 0, 1 above 1, and between them a cubic without kinks."""
    t = np.clip(x, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _add_lamp(image: Floats, d: Floats, box: SoftBox) -> None:
    """Add the light of a lamp to the radiance in directions (..., 3) in the axes front, left, up: a little more comes from
    its middle."""
    longitude, latitude = np.radians([box.longitude, box.latitude])
    toward = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    across = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    corner = np.hypot(1.0, np.hypot(box.width + box.edge, box.height + box.edge))  # along the first axis it is at 1
    along = d @ toward
    lit = along > 1.0 / corner
    d, along = d[lit], along[lit]
    x, y = np.abs(d @ across) / along, np.abs(d @ np.cross(toward, across)) / along
    share = _smooth((box.width - x) / box.edge + 0.5) * _smooth((box.height - y) / box.edge + 0.5)
    bright = 1.0 - 0.35 * np.minimum((x / box.width) ** 2 + (y / box.height) ** 2, 2.0) / 2.0
    image[lit] += (share * bright)[:, None] * (box.radiance * np.array(box.color))
