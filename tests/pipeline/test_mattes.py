"""Cryptomatte layers of frames: the samples' owners are the oracle's, shares are exact."""

from __future__ import annotations

import json

import numpy as np
import pytest
from layer_scenes import mixed

import clshade
from clshade.images.cryptomatte import matte
from clshade.oracle.frame import owners
from clshade.oracle.shot import prepare
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene


def manifest(layer):
    return json.loads(next(text for name, text in layer.metadata.items() if name.endswith("/manifest")))


def share(layer, name):
    """Return the share of each pixel that a thing covers."""
    wanted, total = int(manifest(layer)[name], 16), 0.0
    for channel, plane in layer.channels.items():
        if channel[-1] in "RB":
            beside = channel[:-1] + "GA"["RB".index(channel[-1])]
            total = total + np.where(plane.view(np.uint32) == wanted, layer.channels[beside], 0.0)
    return total


def square(name, low, high, z, **material):
    """Return a square of the plane z, in pixels of `CAMERA`'s image."""
    (x0, y0), (x1, y1) = low, high
    verts = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
    return Mesh(verts, [[0, 1, 2], [0, 2, 3]], name=name, material=Material(name=f"{name}'s", **material))


# A pixel is one unit, x to the right, y up, the origin at the lower left corner.
CAMERA = Camera((4, 3, 5), (4, 3, 0), (0, 1, 0), 1.0, (6.0, 8.0), (8, 6), orthographic=True)


@pytest.mark.long
def test_shares_of_squares(device):
    """Edges through the middle of pixels: of 16 samples 8 lie on either side. Also of no square."""
    scene = Scene((square("far", (0, 0), (6.5, 6), 0), square("near", (2.5, 1), (5, 4), 1)), CAMERA)
    frame = clshade.render(scene, device=device, samples=16)
    layer = clshade.cryptomatte(frame, ["object"], device=device)["object"]
    near, far = np.zeros((6, 8)), np.zeros((6, 8))
    near[2:5, 2], near[2:5, 3:5] = 0.5, 1.0
    far[:, :6], far[:, 6] = 1.0, 0.5
    assert np.array_equal(share(layer, "near"), near)
    assert np.array_equal(share(layer, "far"), far - near)
    assert np.array_equal(layer.channels["CryptoObject00.G"][2, :3], [1.0, 1.0, 0.5])
    empty = clshade.cryptomatte(clshade.render(Scene((), CAMERA), device=device, samples=4), device=device)["object"]
    assert manifest(empty) == {}
    assert not any(plane.any() for plane in empty.channels.values())


@pytest.mark.sampled
@pytest.mark.parametrize("samples", [1, 5])
def test_they_are_the_oracles(device, samples):
    frame = clshade.render(mixed(), device=device, samples=samples, shader="nolight")
    layers = clshade.cryptomatte(frame, device=device)
    scene, settings = frame.scene, frame.settings
    views = prepare(scene, settings).samples
    columns, rows = scene.camera.resolution
    row, column = np.divmod(np.arange(rows * columns), columns)
    mesh_of = np.append(views[0].corners.mesh[views[0].pieces.face] + 1, 0)
    owner = np.array([owners(view, column, row) for view in views]).reshape(-1, rows, columns)[:, ::-1]
    names_of = {k: mesh.name or f"object {k}" for k, mesh in enumerate(scene.meshes, 1)}
    expected = matte("CryptoObject", mesh_of[owner].astype(np.uint32), names_of)
    assert layers["object"].metadata == expected.metadata
    for name, plane in expected.channels.items():
        assert np.array_equal(layers["object"].channels[name].view(np.uint32), plane.view(np.uint32)), name
    assert set(layers) == {"object", "material", "instance"}
    for layer in layers.values():
        assert np.allclose(sum(share(layer, name) for name in manifest(layer)), frame.alpha, atol=1e-6)
    dome = next(number for number, mesh in enumerate(scene.meshes, 1) if len(mesh.instances) > 1)
    names = [f"instance {number}" for number in range(dome, dome + len(scene.meshes[dome - 1].instances))]
    together = sum(share(layers["instance"], name) for name in names)
    assert np.allclose(together, share(layers["object"], names_of[dome]), atol=1e-6)
