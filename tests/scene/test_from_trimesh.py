"""`Scene.from_trimesh`: meshes and scenes of trimesh, and objects with the attributes of Open3D's and PyVista's."""

import ast
import re
import subprocess
import sys
from functools import reduce
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from processes import ROOT

import clshade
from clshade.errors import InputError
from clshade.images.decode import srgb_to_linear
from clshade.images.tonemap import srgb_curve
from clshade.scene.camera import Camera
from clshade.scene.geometry import camera_axes
from clshade.scene.model import Material, Mesh, MetallicRoughness, Scene, Texture

RNG = np.random.default_rng(3)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]])
FACES = np.array([[0, 1, 2], [2, 1, 3]])
UVS = np.array([[0, 0], [1, 0], [0, 1], [1, 1.0]])
CODES = np.array([[255, 0, 0, 255], [0, 128, 0, 255], [0, 0, 64, 128], [1, 2, 3, 255]], np.uint8)


@pytest.fixture
def trimesh():
    return pytest.importorskip("trimesh")


def plain(trimesh, **options):
    return trimesh.Trimesh(CORNERS, FACES, process=False, **options)


def only(source, **options) -> Mesh:
    (mesh,) = Scene.from_trimesh(source, **options).meshes
    return mesh


def test_a_mesh(trimesh):
    scene = Scene.from_trimesh(plain(trimesh, metadata={"name": "roof"}), resolution=(64, 48), up="z")
    (mesh,) = scene.meshes
    assert (scene.preset, scene.name, mesh.name, scene.fitted) == ("standard", "roof", "roof", True)
    assert (scene.camera.resolution, scene.camera.up.tolist()) == ((64, 48), [0, 0, 1])
    assert (mesh.verts.tolist(), mesh.faces.tolist()) == (CORNERS.tolist(), FACES.tolist())
    assert (mesh.colors, mesh.material.two_sided) == (None, True)
    assert only(Mesh(CORNERS, FACES)).verts.tolist() == CORNERS.tolist()  # this package's own, too
    normals = RNG.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    source = plain(trimesh, vertex_normals=normals)
    np.testing.assert_allclose(only(source).normals, normals, atol=1e-12)
    flat = only(source, crease=0)
    assert flat.normals[flat.normal_faces][0].tolist() == [[0, 0, 1]] * 3


def test_colors_of_vertices(trimesh):
    mesh = only(plain(trimesh, vertex_colors=CODES))
    np.testing.assert_allclose(mesh.colors, srgb_to_linear(CODES[:, :3] / 255.0), atol=1e-12)
    np.testing.assert_allclose(mesh.alphas, CODES[:, 3] / 255.0, atol=1e-12)
    assert mesh.material.blend
    opaque = only(plain(trimesh, vertex_colors=CODES | np.array([0, 0, 0, 255], np.uint8)))
    assert opaque.alphas is None
    assert not opaque.material.blend


def test_colors_of_faces(trimesh):
    """Corners get vertices of their own; normals stay smooth."""
    source = plain(trimesh, face_colors=CODES[:2])
    mesh = only(source)
    assert mesh.verts[mesh.faces].tolist() == CORNERS[FACES].tolist()
    expected = srgb_to_linear(np.repeat(CODES[:2, :3], 3, axis=0).reshape(2, 3, 3) / 255.0)
    np.testing.assert_allclose(mesh.colors[mesh.faces], expected, atol=1e-12)
    np.testing.assert_allclose(mesh.normals[mesh.normal_faces], source.vertex_normals[FACES], atol=1e-12)
    source.vertex_attributes["heat"] = np.arange(4.0)
    assert only(source).scalars["heat"][mesh.faces].tolist() == FACES.tolist()


def test_a_simple_material(trimesh):
    codes = RNG.integers(0, 256, (3, 2, 3)).astype(np.uint8)
    image = Image.fromarray(codes)
    material = trimesh.visual.material.SimpleMaterial(
        image=image, diffuse=[255, 51, 0, 255], ambient=[0, 51, 255], specular=[102, 102, 102], glossiness=40, name="m"
    )
    mesh = only(plain(trimesh, visual=trimesh.visual.TextureVisuals(uv=UVS, material=material)))
    np.testing.assert_allclose(mesh.uvs, UVS * [1, -1] + [0, 1])  # v = 0 is the top row here
    ours = mesh.material
    assert (ours.kd.tolist(), ours.ka.tolist(), ours.ks.tolist()) == ([1, 0.2, 0], [0, 0.2, 1], [0.4] * 3)
    assert (ours.n, ours.name, ours.blend, ours.pbr) == (40.0, "m", False, None)
    assert ours.texture.image.tobytes() == srgb_to_linear(codes / 255.0).astype(np.float32).tobytes()
    unset = trimesh.visual.material.SimpleMaterial(image=image)
    mesh = only(plain(trimesh, visual=trimesh.visual.TextureVisuals(uv=UVS, material=unset)))
    assert mesh.material.kd.tolist() == [0.8] * 3  # not the gray that stands for none


def test_a_pbr_material(trimesh):
    names = ("base", "worn", "bumps", "ao", "glow")
    pictures = {name: RNG.integers(0, 255, (2, 3, 4 if name == "base" else 3)).astype(np.uint8) for name in names}
    images = {name: Image.fromarray(codes) for name, codes in pictures.items()}
    fields = {
        **{"name": "paint", "baseColorFactor": [1.0, 0.4, 0.0, 0.2], "metallicFactor": 0.25, "roughnessFactor": 0.5},
        **{"emissiveFactor": [0.5, 0.25, 1.0], "baseColorTexture": images["base"]},
        **{"metallicRoughnessTexture": images["worn"], "normalTexture": images["bumps"]},
        **{"occlusionTexture": images["ao"], "emissiveTexture": images["glow"]},
    }

    def drawn(**changes):
        material = trimesh.visual.material.PBRMaterial(**fields, **changes)
        return Scene.from_trimesh(plain(trimesh, visual=trimesh.visual.TextureVisuals(uv=UVS, material=material)))

    scene = drawn(alphaMode="BLEND")
    ours, facets = scene.meshes[0].material, scene.meshes[0].material.pbr
    assert scene.preset == "pbr"
    np.testing.assert_allclose(ours.color, [1.0, 0.4, 0.0])
    assert (ours.name, ours.blend, ours.opacity) == ("paint", True, 0.2)
    assert (facets.metallic, facets.roughness, facets.emission.tolist()) == (0.25, 0.5, [0.5, 0.25, 1.0])
    for texture, name, srgb in (
        (ours.texture, "base", True),
        (facets.metallic_roughness_texture, "worn", False),
        (facets.normal_texture, "bumps", False),
        (facets.occlusion_texture, "ao", False),
        (facets.emission_texture, "glow", True),
    ):
        values = pictures[name] / 255.0
        expected = (srgb_to_linear(values[..., :3]) if srgb else values).astype(np.float32)
        assert texture.image[..., :3].tobytes() == expected.tobytes(), name
    np.testing.assert_allclose(ours.texture.image[..., 3], pictures["base"][..., 3] / 255.0, atol=1e-7)
    (mesh,) = drawn(alphaMode="MASK", alphaCutoff=0.25).meshes
    assert (mesh.material.alpha_cutoff, mesh.material.blend) == (0.25, False)


def test_a_scene_with_instances_and_a_camera(trimesh):
    source = trimesh.Scene()
    moved = np.eye(4)
    moved[:3, 3] = 3, 0, 0
    source.add_geometry(plain(trimesh), node_name="one", geom_name="roof")
    source.graph.update(frame_to="two", matrix=moved, geometry="roof")
    source.add_geometry(trimesh.load_path(np.array([[0, 0, 0], [1, 1, 1.0]])), geom_name="curve")
    with pytest.warns(UserWarning, match=r"^from_trimesh: not rendered: curve \(Path3D\)$"):
        scene = Scene.from_trimesh(source)
    (mesh,) = scene.meshes
    assert mesh.name == "roof"
    np.testing.assert_array_equal(mesh.instances, [np.eye(4), moved])
    assert mesh.instance_names == ("one", "two")
    assert scene.fitted
    source.delete_geometry("curve")
    source.camera = trimesh.scene.Camera(resolution=(8, 6), fov=(40, 30))
    scene = Scene.from_trimesh(source)  # without a transform, trimesh leaves it without a place
    assert (scene.fitted, scene.camera.resolution) == (True, (800, 600))
    source.camera.resolution, source.camera.fov = (200, 100), (90.0, 60.0)
    pose = np.eye(4)
    pose[:3, 3] = 0.5, 0.25, 7
    source.camera_transform = pose
    scene = Scene.from_trimesh(source)
    expected = Camera((0.5, 0.25, 7), (0.5, 0.25, 0), (0, 1, 0), 1.0, (2 * np.sqrt(1 / 3), 2.0), (200, 100))
    assert not scene.fitted
    np.testing.assert_allclose(scene.camera.eye, expected.eye)
    np.testing.assert_allclose(camera_axes(scene.camera), camera_axes(expected), atol=1e-12)
    np.testing.assert_allclose(scene.camera.plane, expected.plane)
    assert scene.camera.resolution == (200, 100)


def test_a_glb_is_the_same_through_trimesh(trimesh, tmp_path):
    texture = Texture(RNG.integers(0, 256, (4, 5, 3)) / 255)
    painted = Material(texture=texture, pbr=MetallicRoughness(0.25, 0.5))
    textured = Mesh(CORNERS, FACES, uvs=UVS, material=painted, name="textured")
    placed = np.stack([np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])])
    placed[1, :3, 3] = 1, 2, 3
    colors, heights = RNG.random((4, 3)).astype(np.float32), {"height": CORNERS[:, 2]}
    colored = Mesh(CORNERS, FACES, colors, scalars=heights, instances=placed, name="colored")
    Scene((textured, colored), Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0))).to_glb(tmp_path / "a.glb")
    scene, reference = Scene.from_trimesh(trimesh.load(tmp_path / "a.glb")), clshade.load(tmp_path / "a.glb")
    assert not scene.fitted
    eye, up, height = scene.camera.eye, scene.camera.up, scene.camera.plane[0] / scene.camera.focal
    np.testing.assert_allclose([*eye, *up, height], [0, 0, 5, 0, 1, 0, 1], atol=1e-9)
    copies = sorted(scene.meshes, key=lambda mesh: mesh.name)
    for ours, expected in zip(copies, reference.meshes[::-1], strict=True):
        assert sorted(ours.instances.tolist()) == sorted(expected.instances.tolist())
        np.testing.assert_array_equal(ours.verts[ours.faces], expected.verts[expected.faces])
        assert (ours.colors is None) == (expected.colors is None)
    second, one = copies
    np.testing.assert_allclose(one.uvs[one.faces], UVS[FACES], atol=1e-7)
    codes = np.rint(srgb_curve(texture.image) * 255)
    assert np.array_equal(np.rint(srgb_curve(one.material.texture.image) * 255), codes)
    assert (one.material.pbr.metallic, one.material.pbr.roughness) == (0.25, 0.5)
    np.testing.assert_array_equal(second.colors, colors)
    assert second.scalars["height"].tolist() == CORNERS[:, 2].tolist()


def test_open3d():
    colors = RNG.random((4, 3))
    empty = np.zeros((0, 3))
    fields = {"vertices": CORNERS, "triangles": FACES, "vertex_normals": empty}
    mesh = only(SimpleNamespace(**fields, vertex_colors=colors))
    assert (mesh.verts.tolist(), mesh.faces.tolist(), mesh.normals) == (CORNERS.tolist(), FACES.tolist(), None)
    np.testing.assert_allclose(mesh.colors, srgb_to_linear(colors))
    mesh = only(SimpleNamespace(**{**fields, "vertex_normals": CORNERS + 1.0}, vertex_colors=empty))
    assert (mesh.colors, mesh.normals.tolist()) == (None, (CORNERS + 1.0).tolist())


class Quads:
    points = CORNERS
    point_data: dict = {}  # noqa: RUF012

    @property
    def regular_faces(self):
        raise ValueError("Faces are not regular")


def test_pyvista():
    points = {"height": CORNERS[:, 2], "RGB": CODES[:, :3], "velocity": CORNERS, "names": np.array(list("abcd"))}
    cells = {"part": np.array([1, 2])}
    mesh = only(SimpleNamespace(points=CORNERS, regular_faces=FACES, point_data=points, cell_data=cells))
    assert {key: values.tolist() for key, values in mesh.scalars.items()} == {"height": [0, 0, 0, 0.5], "part": [1, 2]}
    np.testing.assert_allclose(mesh.colors, srgb_to_linear(CODES[:, :3] / 255.0))
    named = {"Normals": CORNERS + 1.0}
    mesh = only(SimpleNamespace(points=CORNERS, regular_faces=FACES, point_data=named, cell_data={}))
    assert mesh.normals.tolist() == (CORNERS + 1.0).tolist()
    for source in (Quads(), SimpleNamespace(points=CORNERS, regular_faces=np.array([[0, 1, 3, 2]]))):
        with pytest.raises(InputError, match=r"triangles alone \(PolyData.triangulate\(\) makes them\)"):
            Scene.from_trimesh(source)


def test_refused(trimesh):
    several = trimesh.visual.material.MultiMaterial()
    several = plain(trimesh, visual=trimesh.visual.TextureVisuals(uv=UVS, material=several))
    for source, options, message in (
        *((source, {}, "source: expected a Trimesh or Scene of trimesh") for source in (None, "teapot.obj", CORNERS)),
        (plain(trimesh), {"up": "w"}, "up: expected "),
        (plain(trimesh), {"crease": 200}, "crease: expected "),
        (plain(trimesh), {"resolution": (0, 1)}, "resolution N: expected "),
        (trimesh.Trimesh(), {}, "source: expected at least one triangle"),
        (trimesh.Scene(), {}, "source: expected at least one triangle"),
        (several, {}, ".*one material for each mesh"),
    ):
        with pytest.raises(InputError, match=f"^from_trimesh: {message}"):
            Scene.from_trimesh(source, **options)


def test_no_other_library_is_imported():
    code = (
        "import sys, types, numpy as np, clshade\n"
        "o = types.SimpleNamespace(vertices=np.eye(3), faces=[[0, 1, 2]])\n"
        "clshade.Scene.from_trimesh(o)\n"
        "print(*({'trimesh', 'open3d', 'pyvista', 'PIL'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


def test_vertices_is_another_name_of_verts():
    mesh = Mesh(vertices=CORNERS, faces=FACES, name="roof")
    assert mesh.vertices is mesh.verts
    assert repr(mesh) == "<Mesh roof: 2 triangles, 4 vertices, 1 instance>"
    assert mesh.verts.tolist() == CORNERS.tolist()
    for name in ("verts", "vertices"):
        with pytest.raises(AttributeError):
            setattr(mesh, name, CORNERS)
    for arguments, fields in (((CORNERS, FACES), {}), ((), {"verts": CORNERS, "faces": FACES})):
        with pytest.raises(InputError, match=r"^Mesh: vertices: cannot go with verts, which is the same"):
            Mesh(*arguments, vertices=CORNERS, **fields)
    with pytest.raises(TypeError, match="verts"):
        Mesh(faces=FACES)


def test_what_the_page_for_its_users_names_exists(trimesh):
    """COMING_FROM.md, of which tests/test_readme.py runs our parts."""
    text = (ROOT / "clshade" / "scene" / "COMING_FROM.md").read_text()
    blocks = re.findall(r"^```py\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    nodes = [node for block in blocks for node in ast.walk(ast.parse(block))]
    chains = {ast.unparse(node) for node in nodes if isinstance(node, ast.Attribute)}
    named = {chain for chain in chains if re.fullmatch(r"trimesh(\.\w+)+", chain)}
    assert len(named) > 10
    for chain in named:
        reduce(getattr, chain.split(".")[1:], trimesh)
