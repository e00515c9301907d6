"""What `inspect` says of scenes, counts and areas of surfaces in closed form, and what descriptions tell apart."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from mesh_writers import CORNERS, INDICES, Gltf

import clshade
from clshade.images.decode import CodedImage, srgb_to_linear
from clshade.pipeline.shading_tables import texture_tables
from clshade.scene import contents as module
from clshade.scene.builtin import scenes
from clshade.scene.contents import SurfaceFacts, format_contents, scene_contents, surface_facts
from clshade.scene.description import digest_of, part_digests
from clshade.scene.environment import Environment
from clshade.scene.model import Mesh, Scene, Settings, with_materials
from clshade.scene.texture import Texture

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([triangle for a, b, c, d in SIDES for triangle in ((a, b, c), (a, c, d))])
FIN = np.concatenate([CUBE, [(0.0, 0.5, -1.0)]])


@pytest.mark.parametrize(
    ("verts", "faces", "facts"),
    [
        (CUBE, FACES, (8, 12, 6.0, 8, 1, 0, 0)),
        (CUBE[FACES].reshape(-1, 3), np.arange(36).reshape(-1, 3), (36, 12, 6.0, 8, 1, 0, 0)),
        (CUBE, FACES[:-2], (8, 10, 5.0, 8, 1, 4, 0)),
        (FIN, np.concatenate([FACES, [(0, 2, 8)]]), (9, 13, 6.0 + 0.5, 9, 1, 2, 1)),
        (FIN, np.concatenate([FACES, [(3, 3, 5)]]), (9, 13, 6.0, 8, 1, 0, 0)),  # of which one has no area
        (CUBE, [(3, 3, 5)], (8, 1, 0.0, 0, 0, 0, 0)),
        (CUBE, np.zeros((0, 3), int), (8, 0, 0.0, 0, 0, 0, 0)),
    ],
)
def test_cubes_whole_open_with_a_fin_and_nothing(verts, faces, facts):
    surface = surface_facts(Scene(Mesh(verts, faces)))
    assert surface == SurfaceFacts(*facts)
    assert surface.closed is (facts[2] == 6.0)
    assert isinstance(surface.area, float)


def test_instances_and_meshes():
    """A cube, a turned box of 1 x 2 x 3 apart from it, and a cube that another mesh adds to the first."""
    two = np.stack([np.eye(4), np.eye(4)])
    two[1, :3, :3] = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0] * (1.0, 2.0, 3.0)
    two[1, 0, 3] = 9.0
    facts = surface_facts(Scene((Mesh(CUBE, FACES, instances=two), Mesh(CUBE + (1.0, 0.0, 0.0), FACES))))
    assert facts.area == pytest.approx(6.0 + 22.0 + 6.0, rel=1e-9)
    assert (facts.vertices, facts.triangles, facts.positions, facts.shapes) == (24, 36, 20, 2)
    assert (facts.boundary_edges, facts.non_manifold_edges) == (0, 4 + 1)  # the common side, and its diagonal


def test_thousands_of_instances():
    many = np.tile(np.eye(4), (2100, 1, 1))
    many[:, 0, 3] = 2.0 * np.arange(2100)
    facts = surface_facts(Scene(Mesh(CUBE, FACES, instances=many)))
    assert (facts.area, facts.positions, facts.shapes) == (6.0 * 2100, 8 * 2100, 2100)


def test_edges_of_large_scenes_are_not_counted(monkeypatch):
    monkeypatch.setattr(module, "MAX_COUNTED_FACES", 11)
    facts = surface_facts(Scene(Mesh(CUBE, FACES)))
    assert facts == SurfaceFacts(8, 12, 6.0)
    assert facts.closed is None


def test_what_is_added_is_not_the_files(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 2 0 0\nv 0 3 -1\nf 1 2 3\n")
    contents = scene_contents(clshade.load(path))
    assert (contents["lights"], contents["added_lights"], contents["each_light"]) == (0, 3, [])
    assert (contents["cameras"], contents["camera"]) == (0, None)
    assert contents["bounds"] == [[0, 0, -1], [2, 3, 0]]
    text = format_contents(contents)
    assert "bounds  0 0 -1 to 2 3 0, size 2 3 1" in text
    assert "camera  none: one that shows all is added" in text
    assert "no lights: 3 are added" in text
    assert "PointLight" not in text


def test_materials_and_textures():
    images = [clshade.Texture(np.ones((2, 4, 3)), name=name) for name in ("wood", "dents")]
    shiny = clshade.MetallicRoughness(metallic=0.25, roughness=0.5, normal_texture=images[1])
    materials = [
        clshade.Material(kd=0.7, name="oak", texture=images[0]),
        clshade.Material(name="glass", opacity=0.5, blend=True, texture=images[0], pbr=shiny),
    ]
    triangle = {"uvs": np.zeros((3, 2))}
    meshes = [clshade.Mesh(CORNERS, [[0, 1, 2]], material=materials[k], **triangle) for k in (0, 1, 0)]
    contents = scene_contents(clshade.Scene(meshes, clshade.builtin("quads").camera))
    assert [mesh["material_number"] for mesh in contents["meshes"]] == [1, 2, 1]
    assert contents["materials"][1]["textures"] == {"color": 1, "normal": 2}
    assert contents["textures"][1] == {"number": 2, "name": "dents", "size": [4, 2], "channels": 3}
    lines = [line.split() for line in format_contents(contents).splitlines()]
    assert ["oak", "1", "1", "1", "1", "ka", "0.1,", "kd", "0.7,", "ks", "0.5,", "n", "20", "opaque"] in lines
    assert ["glass", "2", "1", "1", "1", "metallic", "0.25,", "roughness", "0.5", "blend", "0.5"] in lines
    assert ["wood", "1", "4x2", "3", "color", "of", "1,2"] in lines
    assert ["dents", "2", "4x2", "3", "normal", "of", "2"] in lines


@pytest.mark.parametrize("used", [0, 2])
def test_cameras_of_gltf_files(used, tmp_path, capsys):
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, INDICES)
    document.add("nodes", {"mesh": 0})
    for _ in range(2):
        camera = document.add("cameras", {"type": "perspective", "perspective": {"yfov": np.pi / 4, "znear": 0.1}})
        if used:
            document.add("nodes", {"camera": camera, "translation": [0, 0, 5]})
    path = document.glb(tmp_path / "a.glb")
    line = run(capsys, "inspect", path)[1].splitlines()[2]
    assert ("view angle 45, 800x600, the first of 2" if used else "none, 2 without use") in line
    assert json.loads(run(capsys, "inspect", path, "--json")[1])["cameras"] == 2


# Descriptions


def test_descriptions_tell_values_apart():
    values = [0, 0.0, -0.0, False, None, "", "0", (), (0,), ((0,),), {"0": 0}, np.zeros(1), np.zeros((1, 1))]
    values += [np.zeros(2, np.float32), np.zeros(1, np.int64), ("a", "b"), ("ab",), Settings()]
    assert len({digest_of(value) for value in values}) == len(values)
    big = np.arange(6.0).reshape(2, 3)
    assert digest_of(big.astype(">f8")) == digest_of(np.asfortranarray(big)) == digest_of(big)
    with pytest.raises(TypeError, match="expected plain values"):
        digest_of(object())


def test_digests_are_those_of_files_that_were_drawn_before():
    """Another digest would make every EXR that has one fail."""
    assert digest_of({"a": (1, 2.5, None, "ä"), "b": np.arange(3.0)}).startswith("b76439d05b493628")
    assert digest_of(Mesh(np.eye(3), [[0, 1, 2]], name="one")).startswith("fa81de5edd2ac327")


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("srgb", [False, True])
def test_a_texture_in_codes_is_that_of_its_numbers(channels, srgb):
    codes = np.random.default_rng(2).integers(0, 256, (37, 5, channels), np.uint8)
    linear = (np.arange(256) / 255).astype(np.float32)
    colors = srgb_to_linear(linear).astype(np.float32) if srgb else linear
    numbers = np.concatenate([colors[codes[..., :3]], linear[codes[..., 3:]]], axis=2)
    coded, plain = Texture(CodedImage(codes, colors, linear)), Texture(numbers)
    assert digest_of(coded) == digest_of(plain)
    assert "image" not in vars(coded)
    assert (coded.mean() == plain.mean()).all()
    assert (plain.mean() == numbers[..., :3].mean((0, 1), np.float64)).all()
    texels = [texture_tables([texture])[1] for texture in (coded, plain)]
    assert (texels[0] == texels[1]).all()
    assert (texels[0][:, :channels] == numbers.reshape(-1, channels)).all()
    assert (coded.image == numbers).all()
    assert not coded.image.flags.writeable


def test_only_the_part_that_changed_differs():
    texels = np.full((2, 2, 3), 0.5, np.float32)
    before = with_materials(scenes.teapot(3, (80, 60)), lambda material: replace(material, texture=Texture(texels)))
    changed_texels = texels.copy()
    changed_texels[1, 0, 2] = np.nextafter(changed_texels[1, 0, 2], np.float32(1.0))
    for part, changed in (
        ("camera", replace(before, camera=before.camera.with_resolution((40, 30)))),
        ("lights", replace(before, lights=())),
        ("meshes", replace(before, meshes=tuple(replace(mesh, name="other") for mesh in before.meshes))),
        ("materials", with_materials(before, lambda material: replace(material, kd=0.25))),
        ("materials", with_materials(before, lambda material: replace(material, texture=Texture(changed_texels)))),
        ("environment", replace(before, environment=Environment(np.ones((4, 8, 3))))),
        ("others", replace(before, ambient=0.5)),
    ):
        a, b = part_digests(before), part_digests(changed)
        assert [name for name in a if a[name] != b[name]] == [part]
    assert part_digests(replace(before, preset="pbr", ignored=("a remark",))) == part_digests(before)


def test_meshes_in_memory_that_others_may_write_are_read_again():
    verts = np.eye(3)
    mesh = Mesh(verts, [[0, 1, 2]])
    before = digest_of(mesh)
    verts[0, 0] = 2.0
    assert (digest_of(mesh) == before) == bool(mesh.verts[0, 0] == 1.0)
