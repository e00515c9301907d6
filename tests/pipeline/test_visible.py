"""How much of each instance is seen: known shares, amodal masks, the oracle, and files; mattes."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from layer_scenes import at, mixed, square

import clshade
from clshade import oracle
from clshade.cli.main import main
from clshade.errors import InputError
from clshade.images.cryptomatte import matte
from clshade.oracle.frame import owners
from clshade.oracle.shot import prepare
from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Texture

# Of the plane z = 0 the image shows x from -2 to 2 and y from -1.5 to 1.5, 16 px for each unit.
CAMERA = Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (0.75, 1.0), (64, 48))
PARALLEL = replace(CAMERA, plane=(3.0, 4.0), orthographic=True)


def tiles(*placements: np.ndarray, **fields) -> Mesh:
    """Return placements of a square of 1 x 1, which faces the camera."""
    return square(0.5, instances=np.stack(placements), **fields)


def columns(visibility: clshade.pipeline.visible.Visible, *names: str) -> list[list[float]]:
    return [visibility.table[name].tolist() for name in names]


def test_squares_of_which_one_covers_half_of_the_other(opened):
    """The second is before the first in a parallel projection, half a unit to the side; the third is alone."""
    scene = Scene((tiles(at(-0.5, 0), at(0, 0, 1), name="tile"), tiles(at(1.5, 1))), PARALLEL)
    visibility = clshade.visible(scene, masks=True, device=opened)
    assert columns(visibility, "instance", "object", "name") == [[1, 2, 3], [1, 1, 2], ["tile", "tile", ""]]
    assert columns(visibility, "pixels", "alone", "whole") == [[128, 256, 256], [256] * 3, [256] * 3]
    assert columns(visibility, "visible", "inside") == [[0.5, 1.0, 1.0], [1.0] * 3]
    expected = np.zeros((3, 48, 64), bool)
    expected[0, 16:32, 16:32] = expected[1, 16:32, 24:40] = expected[2, 0:16, 48:64] = True
    assert np.array_equal(visibility.masks, expected)


def test_parts_of_an_object_count_as_one(opened):
    """Two materials, two placements: two rows, in the layers too, on any path of instances."""
    places = at(-1, 0), at(1, 0)
    parts = [
        tiles(*(place @ offset for offset in places), name="pair", part_of="pair", material=Material(color))
        for place, color in ((at(0, 0), (1, 0, 0)), (at(0, -0.75) @ np.diag([1.0, 0.5, 1.0, 1.0]), (0, 1, 0)))
    ]
    scene = Scene((parts[0], tiles(at(0, 1)), parts[1]), PARALLEL)
    visibility = clshade.visible(scene, device=opened)
    assert columns(visibility, "instance", "object", "name") == [[1, 2, 3], [1, 1, 2], ["pair", "pair", ""]]
    assert columns(visibility, "pixels", "whole") == [[384, 384, 256]] * 2
    layers = ("object_id", "instance_id")
    frame = clshade.render(scene, device=opened, shader="nolight", layers=layers)
    counts = [np.unique(frame[layer], return_counts=True)[1].tolist() for layer in layers]
    assert counts == [[2048, 768, 256], [2048, 384, 384, 256]]


def test_what_lies_outside_of_the_image(opened):
    """Half, three quarters and all of a square are outside; what is beyond the margin does not count at all."""
    scene = Scene((tiles(at(2, 0), at(-2, 1.5), at(0, 3), at(12.5, 0)),), CAMERA)
    visibility = clshade.visible(scene, device=opened)
    assert visibility.masks is None
    assert columns(visibility, "pixels", "alone", "whole") == [[128, 64, 0, 0], [128, 64, 0, 0], [256, 256, 256, 0]]
    np.testing.assert_array_equal(visibility.table["visible"], [1.0, 1.0, np.nan, np.nan])
    np.testing.assert_array_equal(visibility.table["inside"], [0.5, 0.25, 0.0, np.nan])
    assert columns(clshade.visible(scene, margin=0, device=opened), "whole") == [[128, 64, 0, 0]]
    assert columns(clshade.visible(scene, margin=3, device=opened), "whole") == [[256] * 4]


def test_against_the_oracle(opened):
    """All instances of a scene, clipped and mirrored ones too: each drawn alone, and with the others."""
    _, settings = effective_settings(mixed(), layers=("instance_id",), shader="nolight")
    radius_of_all = 1e-4 * 21.656407827707714  # half of the diagonal of floor and all, 18 x 1.9 x 39
    settings = replace(settings, near=radius_of_all)
    visibility = clshade.visible(mixed(), masks=True, device=opened, near=radius_of_all)
    numbers = oracle.render_layers(mixed(), settings).instance_id
    assert columns(visibility, "pixels") == [[int((numbers == number).sum()) for number in range(1, 8)]]
    table = visibility.table
    placed = [replace(mesh, instances=matrix[None]) for mesh in mixed().meshes for matrix in np.asarray(mesh.instances)]
    assert len(table) == 7
    for mask, mesh in zip(visibility.masks, placed, strict=True):
        assert np.array_equal(mask, oracle.render(replace(mixed(), meshes=(mesh,)), settings).id > 0)
    assert (table["pixels"] <= table["alone"]).all()
    assert (table["alone"] <= table["whole"]).all()
    assert table["alone"][0] < table["whole"][0]  # the floor


def test_holes_and_what_layers_look_through(opened):
    """Alpha that fails its test covers nothing, and hides nothing; nor does what is below layer_alpha."""
    half = Texture(np.float32([[[1, 1, 1, 1], [1, 1, 1, 0]]]), lookup="standard", filter="nearest", wrap="clamp")
    holes = Material(texture=half, alpha_cutoff=0.5)
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    behind = tiles(at(0, 0, -1))
    visibility = clshade.visible(Scene((behind, tiles(at(0, 0), uvs=uvs, material=holes)), PARALLEL), device=opened)
    assert columns(visibility, "pixels", "alone") == [[128, 128], [256, 128]]
    glass = Scene((behind, tiles(at(0, 0), material=Material(blend=True, opacity=0.3))), PARALLEL)
    assert columns(clshade.visible(glass, device=opened), "pixels", "alone") == [[256, 0], [256, 0]]
    assert columns(clshade.visible(glass, device=opened, layer_alpha=0.25), "pixels") == [[0, 256]]


def test_files(opened, tmp_path):
    names = ("left, \u00e4", "")
    scene = Scene((tiles(at(-1, 0), at(2, 0), name="tile", instance_names=names), tiles(at(0, 9))), CAMERA)
    visibility = clshade.visible(scene, device=opened)
    visibility.save(tmp_path / "a.csv")
    visibility.save(tmp_path / "a.json")
    with open(tmp_path / "a.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["left, \u00e4", "tile", ""]
    assert (rows[1]["alone"], rows[1]["inside"], rows[2]["visible"]) == ("128", "0.5", "")
    objects = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert list(objects[1]) == list(rows[1])
    assert list(objects[1].values()) == [2, 1, "tile", 128, 128, 256, 1.0, 0.5]
    assert objects[2]["visible"] is None
    with pytest.raises(InputError, match=r"Visible.save: path: expected a file name ending in .csv or .json, found"):
        visibility.save(tmp_path / "a.txt")


def test_nothing_and_refusals(opened):
    for meshes in ((), (Mesh(np.zeros((1, 3)), np.zeros((0, 3), int)),)):
        visibility = clshade.visible(Scene(meshes, CAMERA), masks=True, device=opened)
        assert len(visibility.table) == len(visibility.masks) == len(meshes)
        assert not visibility.table["whole"].any()
    for options, message in (
        ({"margin": 9}, "visible: margin: expected a whole number from 0 to 8, found 9"),
        ({"masks": 1}, "visible: masks: expected True or False, found 1"),
        ({"culls": True}, "culls: expected one of"),
    ):
        with pytest.raises(InputError, match=message):
            clshade.visible(Scene((), CAMERA), device=opened, **options)


@pytest.mark.long
def test_the_command_line_writes_the_table(opened, tmp_path, capsys):
    command = ("render", "quads", "--resolution", "40,30", "--device", opened.index, "--shader", "nolight")
    for ending in ("csv", "json"):
        assert main([*command, "--visible", ending, "-o", str(tmp_path / "a")]) == 0
        assert f"a_visible.{ending}" in capsys.readouterr().out
    expected = clshade.visible(clshade.builtin("quads"), device=opened, resolution=(40, 30))
    rows = json.loads((tmp_path / "a_visible.json").read_text())
    assert [row["pixels"] for row in rows] == expected.table["pixels"].tolist()
    assert len((tmp_path / "a_visible.csv").read_text().splitlines()) == 1 + len(rows)
    (tmp_path / "b_visible.csv").mkdir()
    assert main([*command, "--visible", "csv", "-o", str(tmp_path / "b")]) == 2
    assert "b_visible.csv: cannot be written" in capsys.readouterr().err
    assert not (tmp_path / "b.exr").exists()
    assert main([*command, "--visible", "csv", "--sheet", "-o", str(tmp_path / "c")]) == 2
    assert "--visible: cannot go with --sheet" in capsys.readouterr().err


# Cryptomatte layers: the samples' owners are the oracle's, shares are exact


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


def patch(name, low, high, z, **material):
    """Return a square of the plane z, in pixels of `FLAT`'s image."""
    (x0, y0), (x1, y1) = low, high
    verts = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
    return Mesh(verts, [[0, 1, 2], [0, 2, 3]], name=name, material=Material(name=f"{name}'s", **material))


# A pixel is one unit, x to the right, y up, the origin at the lower left corner.
FLAT = Camera((4, 3, 5), (4, 3, 0), (0, 1, 0), 1.0, (6.0, 8.0), (8, 6), orthographic=True)


@pytest.mark.long
def test_shares_of_squares(device):
    """Edges through the middle of pixels: of 16 samples 8 lie on either side. Also of no square."""
    scene = Scene((patch("far", (0, 0), (6.5, 6), 0), patch("near", (2.5, 1), (5, 4), 1)), FLAT)
    frame = clshade.render(scene, device=device, samples=16)
    layer = clshade.cryptomatte(frame, ["object"], device=device)["object"]
    near, far = np.zeros((6, 8)), np.zeros((6, 8))
    near[2:5, 2], near[2:5, 3:5] = 0.5, 1.0
    far[:, :6], far[:, 6] = 1.0, 0.5
    assert np.array_equal(share(layer, "near"), near)
    assert np.array_equal(share(layer, "far"), far - near)
    assert np.array_equal(layer.channels["CryptoObject00.G"][2, :3], [1.0, 1.0, 0.5])
    empty = clshade.cryptomatte(clshade.render(Scene((), FLAT), device=device, samples=4), device=device)["object"]
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
