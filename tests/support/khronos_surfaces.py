"""Scenes of curved, mapped and lit surfaces after Khronos' glTF sample models, as .glb files written by code."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from khronos_cards import LINEAR, Card

ROUGHNESS = tuple(51 * k / 255 for k in range(1, 6))
METAL = (0.9, 0.6, 0.3)
_RADIUS = 0.45


def metal_rough_spheres(path: Path) -> str:
    """After MetalRoughSpheres: rougher to the right; metals, dielectrics, and metals whose numbers come from textures. The
    poles face +z."""
    card = Card(len(ROUGHNESS), 3)
    across, up = 33, 17
    phi, theta = (a.ravel() for a in np.meshgrid(np.linspace(0, 2 * np.pi, across), np.linspace(0, np.pi, up)))
    normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    first = (np.arange(up - 1)[:, None] * across + np.arange(across - 1)).ravel()
    triangles = [(first, first + across, first + 1), (first + 1, first + across, first + across + 1)]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in triangles]).astype(np.uint16).ravel()
    normal = card.accessor(normals.astype(np.float32))
    uvs = card.accessor(np.full((len(normals), 2), 0.5, np.float32))
    for row, column in np.ndindex(3, len(ROUGHNESS)):
        reflection: dict[str, Any] = {"metallicFactor": float(row != 1), "roughnessFactor": ROUGHNESS[column]}
        if row == 2:
            texel = np.array([[[0, 51 * (column + 1), 255]]], np.uint8)
            reflection = {"metallicRoughnessTexture": {"index": card.texture(texel)}}
        material = card.material(METAL, unlit=False, reflection=reflection)
        card.place(card.shape(_RADIUS * normals, faces, material, NORMAL=normal, TEXCOORD_0=uvs), column, row)
    return card.glb(path)


GRID = 32  # texels of a cell, and vertices of a dome, which lie at their centers
_SLOPE, _RIM = 2.5, 0.38  # of the dome: what its slope grows by, and where it ends
_CENTERS = (np.arange(GRID) + 0.5) / GRID - 0.5


def _dome(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return height and normals of a dome over a unit square."""
    inside = x * x + y * y < _RIM * _RIM
    height = np.where(inside, 0.5 * _SLOPE * (_RIM * _RIM - x * x - y * y), 0.0)
    normals = np.stack([_SLOPE * x * inside, _SLOPE * y * inside, np.ones_like(x)], axis=-1)
    return height, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _dome_mesh(card: Card, material: int) -> int:
    x, y = (a.ravel() for a in np.meshgrid(_CENTERS, _CENTERS))
    height, normals = _dome(x, y)
    first = (np.arange(GRID - 1)[:, None] * GRID + np.arange(GRID - 1)).ravel()
    triangles = [(first, first + 1, first + GRID + 1), (first, first + GRID + 1, first + GRID)]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in triangles]).astype(np.uint16).ravel()
    return card.shape(np.stack([x, y, height], axis=1), faces, material, NORMAL=normals.astype(np.float32))


def dome_texture(card: Card) -> int:
    """Add the dome's normal map: u to the right, v down, green up. It serves any rotation and mirroring of its
    coordinates, for the dome looks the same from all sides."""
    x, y = np.meshgrid(_CENTERS, -_CENTERS)
    normals = _dome(x, y)[1]
    return card.texture(np.round((normals * 0.5 + 0.5) * 255.0).astype(np.uint8), magFilter=LINEAR, minFilter=LINEAR)


def _mapped(card: Card, material: int, axes: np.ndarray, tangents: bool, half: int = 0) -> int:
    """Add a square whose texture coordinates are axes (2, 2) @ (x, y) + 0.5. half: 1 or -1 for that side of x alone."""
    low, high = (0.0, 0.5) if half == 1 else (-0.5, 0.0) if half == -1 else (-0.5, 0.5)
    corners = np.array([[low, -0.5], [high, -0.5], [high, 0.5], [low, 0.5]])
    attributes: dict[str, Any] = {
        "NORMAL": np.tile(np.float32([0, 0, 1]), (4, 1)),
        "TEXCOORD_0": (corners @ axes.T + 0.5).astype(np.float32),
    }
    if tangents:
        back = np.linalg.inv(axes)  # columns: where u and v grow
        side = 1.0 if np.cross([*back[:, 0], 0], [*-back[:, 1], 0])[2] > 0.0 else -1.0
        attributes["TANGENT"] = np.tile(np.float32([*back[:, 0], 0.0, side]), (4, 1))
    positions = np.concatenate([corners, np.zeros((4, 1))], axis=1)
    return card.shape(positions, np.array([0, 1, 2, 0, 2, 3], np.uint16), material, **attributes)


def _turned(quarters: int, mirrored: bool = False) -> np.ndarray:
    """Return texture coordinates' axes, turned by so many quarters and mirrored along u."""
    angle = quarters * math.pi / 2
    turn = np.round([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.diag([-1.0 if mirrored else 1.0, 1.0]) @ np.diag([1.0, -1.0]) @ turn


def _surfaces(card: Card) -> tuple[int, int]:
    """Add the material of geometry and the one with the normal map."""
    reflection = {"metallicFactor": 0.0, "roughnessFactor": 0.5}
    normal = {"index": dome_texture(card)}
    plain = card.material(METAL, unlit=False, reflection=reflection)
    return plain, card.material(METAL, unlit=False, reflection=reflection, normalTexture=normal)


def normal_tangent(path: Path, tangents: bool = False) -> str:
    """After NormalTangentTest, and with `tangents` NormalTangentMirrorTest: a dome of geometry at the top, below it squares
    with its normal map: coordinates turned by quarters, mirrored and turned, and halves that mirror each other."""
    card = Card(4, 4)
    plain, mapped = _surfaces(card)
    dome = _dome_mesh(card, plain)
    for column in range(4):
        card.place(dome, column, 0)
        for row, mirrored in ((1, False), (2, True)):
            card.place(_mapped(card, mapped, _turned(column, mirrored), tangents), column, row)
        halves = [_turned(2 * (column % 2), mirrored) for mirrored in (column >= 2, column < 2)]
        for half, axes in zip((1, -1), halves, strict=True):
            card.place(_mapped(card, mapped, axes, tangents, half), column, 3)
    return card.glb(path)
