"""Real scenes, and malformed and hostile files, in the folder named by CLSHADE_DATA."""

from __future__ import annotations

import json
import os
import pathlib
import subprocess
import sys
import warnings

import numpy as np
import pytest
from processes import PEAK

from clshade.cli.main import main
from clshade.pipeline.renderer import Renderer
from clshade.scene.formats.load import load
from clshade.scene.formats.table import EXTENSIONS

FOLDER = pathlib.Path(os.environ.get("CLSHADE_DATA", "."))
needs_data = pytest.mark.skipif("CLSHADE_DATA" not in os.environ, reason="CLSHADE_DATA names no folder with scenes")
pytestmark = needs_data

# The valid files of bad/ with their number of triangles; the others of these types must be refused, with these words.
VALID = {
    "self_ok.npy": 1,
    "self_offset_1e6.npy": 1,
    "self_behind.npy": 1,
    "self_straddle.npy": 1,
    "self_light_at_vertex.npy": 1,
    "self_neg_ok.obj": 1,
    "self_crlf_bom.obj": 1,
    "self_tex_1x1.obj": 1,
    "self_repeat_verts.obj": 6,
    "trimesh_noimg.obj": 1000,
    "trimesh_nancolor.obj": 12,
    "self_collinear.obj": 2,
    "self_coords_1e38.obj": 1,
    "self_nan_uv.obj": 1,
    "self_ok.glb": 1,
    # Drawn without what they name: a device as their library, and an image of a billion pixels.
    "self_devzero.obj": 1,
    "self_tex_bomb.obj": 1,
}
REFUSED = {
    "assimp_malformed.obj": ("line ", ": f: "),
    "self_M0.npy": (": M: ",),
    "self_Mhuge.npy": (": M: ",),
    "self_PWN_in_dict.npy": (": pickle: ", "system"),
    "self_PWN_pickle.npy": (": pickle: ", "system"),
    "self_binary_garbage.obj": ("line 1: ",),
    "self_cam_eq_lookat.npy": (": cam_lookat: ",),
    "self_empty.npy": (": file: ", "empty"),
    "self_empty.obj": (": file: ", "empty"),
    "self_float_faces.npy": (": face_indices: ", "float64"),
    "self_int64_wrap.npy": (": face_indices: ", "4294967298"),
    "self_lights_mismatch.npy": (": light_intensities: ",),
    "self_n_nan.npy": (": n: ", "nan"),
    "self_nan_vertex.obj": ("line 1: v: ", "nan"),
    "self_no_verts_key.npy": (": verts: ",),
    "self_npy_hugeshape.npy": (": header: ", "1000000000000"),
    "self_oob.npy": (": face_indices: ", "3"),
    "self_up_parallel.npy": (": cam_up: ",),
    "self_zero_index.obj": ("line 4: f: ",),
    "tinyobj_issue-140-zero-face-idx.obj": ("line 16: f: ",),
    "tinyobj_test-nan.obj": (": v: ",),
    "assimp_BoxWithInfinites.glb": (".attributes.POSITION: ", "inf", "row 0"),
    "assimp_IndexOutOfRange.gltf": (".indices: ", "255"),
    "assimp_MissingBin.gltf": (": buffers[0].uri: ", "'BoxTextured0.bin'"),
    "khr_glb_invalid_magic.glb": (": magic: ",),
    "khr_glb_truncated_chunk_data.glb": (": GLB length: ", "48"),
    "khr_mesh_index_buffer_oob.gltf": (".indices: ", "found 5"),
    "self_hugecount_vertex.ply": (": line 3: element vertex: ", "4611686018427387904"),
    "self_index_minus1.ply": (": element face: row 0: ", "-1"),
    "self_inf.ply": (": element vertex: row 2: y: ", "inf"),
    "self_oob_index.ply": (": element face: row 1: ", "3"),
    "self_trunc.glb": (": GLB length: ", "120484"),
    "trimesh_empty_nodes.glb": (": meshes: ", "none"),
}
LOAD_ALL = f"""{PEAK}
import json, os, sys, time, warnings
from clshade.base import console
from clshade.errors import InputError
from clshade.scene.formats.load import load
console.SLOW = 1e6  # no word about slow files
warnings.simplefilter("ignore")
for path in sys.argv[1:]:
    started = time.perf_counter()
    try:
        verdict = load(path).face_count
    except InputError as error:
        verdict = str(error)
    print(json.dumps([os.path.basename(path), verdict, time.perf_counter() - started, peak()]), flush=True)
"""


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory):
    """Load each file of bad/; return its number of triangles or refusal, seconds, and peak memory of the process in
    MiB."""
    folder = tmp_path_factory.mktemp("bad")
    paths = sorted(str(path.resolve()) for path in (FOLDER / "bad").iterdir() if path.suffix in EXTENSIONS)
    root = str(pathlib.Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    done = subprocess.run(
        [sys.executable, "-c", LOAD_ALL, *paths],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert os.listdir(folder) == []  # no PWNED, nothing else
    assert not (FOLDER / "bad" / "PWNED").exists()
    return {name: rest for name, *rest in map(json.loads, done.stdout.splitlines())}


def test_every_file_is_listed(verdicts):
    assert set(verdicts) == set(VALID) | set(REFUSED)


def test_valid_files_load_and_others_are_refused(verdicts):
    for name, faces in VALID.items():
        assert verdicts[name][0] == faces, name
    for name, parts in REFUSED.items():
        text = verdicts[name][0]
        assert isinstance(text, str), name
        assert text.isprintable()
        for part in (f"{name}: ", "expected ", "found ", *parts):
            assert part in text, text


def test_within_time_and_memory(verdicts):
    assert max(seconds for _, seconds, _ in verdicts.values()) < 5
    assert max(peak for _, _, peak in verdicts.values()) < 1024


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_the_command_line_refuses_in_one_line(folder, capsys, name):
    code = main(["render", str(FOLDER / "bad" / name)])
    out, err = capsys.readouterr()
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("clshade: ")
    assert name in err
    assert list(folder.iterdir()) == []


# What some file needs: forced on for all, the files share a program.
SHARED = {"VERTEX_COLORS", "TEXTURED", "UV_INDICES", "NORMAL_INDICES", "TWO_SIDED", "POWER", "BACKGROUND", "MATERIALS"}


@pytest.mark.long
def test_pictures_of_valid_files(device):
    """The visible triangles; and every pixel is finite."""
    seen, ids = {}, {}
    for name in VALID:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            scene = load(FOLDER / "bad" / name)
        resolution = None if name.endswith(".npy") else (64, 48)
        options = {"layers": ("id",), "resolution": resolution, "forced": SHARED}
        with Renderer(scene, device=device, **options) as renderer:
            frame = renderer.render()
            assert np.isfinite(frame.rgb).all(), name
            ids[name] = frame["id"].copy()
            seen[name] = len(np.unique(ids[name])) - bool((ids[name] == 0).any())
    nothing = {"self_behind.npy", "self_collinear.obj"}
    assert {name for name, count in seen.items() if not count} <= {*nothing, "self_coords_1e38.obj"}
    assert not any(seen[name] for name in nothing)
    assert seen["self_repeat_verts.obj"] == 2
    assert np.array_equal(ids["self_ok.npy"], ids["self_offset_1e6.npy"])


def test_warnings_of_valid_files():
    for name, part in {
        "trimesh_noimg.obj": "material_0",
        "trimesh_nancolor.obj": "not finite",
        "self_devzero.obj": "line 1: mtllib: expected a file in the scene's folder",
        "self_tex_bomb.obj": "self_tex_bomb.png: image: expected at most .* pixels .*: drawn without it",
    }.items():
        with pytest.warns(UserWarning, match=part) as caught:
            scene = load(FOLDER / "bad" / name)
        assert len(caught) == 1
        assert scene.meshes[0].colors is None or np.isfinite(scene.meshes[0].colors).all()


def test_the_cat():
    scene = load(FOLDER / "cat.npy", texture=FOLDER / "cat_diff.png")
    (mesh,) = scene.meshes
    assert (mesh.verts.shape, mesh.faces.shape, mesh.uvs.shape) == ((2248, 3), (3954, 3), (2220, 2))
    assert mesh.verts.dtype == np.float32
    assert mesh.material.texture.image.shape == (1024, 512, 3)
    assert [light.position.tolist() for light in scene.lights] == [[0, 0, 5], [-7, 0, 0], [0, 5, 0]]
    assert (scene.camera.resolution, scene.camera.plane, scene.camera.focal) == ((512, 512), (15.0, 15.0), 70.0)


@pytest.mark.parametrize(
    ("name", "verts", "faces"), [("teapot", 3644, 6320), ("beetle-alt", 19887, 38656), ("spot/spot", 2930, 5856)]
)
def test_meshes(name, verts, faces):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = load(FOLDER / f"{name}.obj")
    (mesh,) = scene.meshes
    assert (mesh.verts.shape, mesh.faces.shape) == ((verts, 3), (faces, 3))
    if name == "spot/spot":
        assert mesh.uvs.shape == (3225, 2)
        assert mesh.material.texture.image.shape == (1024, 1024, 3)
        assert (mesh.material.n, mesh.material.ks.tolist()) == (32.0, [0.2] * 3)


@pytest.mark.parametrize(
    ("name", "meshes", "faces", "drawn"),
    [("Duck", 1, 4212, 4212), ("BoxTextured", 1, 12, 12), ("2CylinderEngine", 34, 75730, 121496)],
)
def test_gltf_scenes(name, meshes, faces, drawn):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = load(FOLDER / f"{name}.glb")
    assert (len(scene.meshes), sum(len(mesh.faces) for mesh in scene.meshes), scene.face_count) == (
        meshes,
        faces,
        drawn,
    )
    assert all(mesh.normals is not None and mesh.verts.dtype == np.float32 for mesh in scene.meshes)
    assert (scene.meshes[0].material.texture is not None) == (name != "2CylinderEngine")


def test_the_engine_has_faces_without_area():
    count = 0
    for mesh in load(FOLDER / "2CylinderEngine.glb").meshes:
        a, b, c = (mesh.verts[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
        count += int((np.cross(b - a, c - a) == 0.0).all(axis=1).sum())
    assert count == 10419
