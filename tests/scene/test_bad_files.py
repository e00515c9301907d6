"""Real scenes, and malformed and hostile files, in the folder named by CLSHADE_DATA."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from processes import PEAK, ROOT

from clshade.scene.formats.load import load
from clshade.scene.formats.table import EXTENSIONS

FOLDER = pathlib.Path(os.environ.get("CLSHADE_DATA", "."))
pytestmark = pytest.mark.skipif("CLSHADE_DATA" not in os.environ, reason="CLSHADE_DATA names no folder with scenes")

# Of bad/ these load, with so many triangles; all others are refused.
OF_ONE = "ok.npy offset_1e6.npy behind.npy straddle.npy light_at_vertex.npy neg_ok.obj crlf_bom.obj tex_1x1.obj"
OF_ONE += " coords_1e38.obj nan_uv.obj ok.glb devzero.obj tex_bomb.obj"
VALID = {f"self_{name}": 1 for name in OF_ONE.split()}  # the last two drawn without what they name: /dev/zero, a bomb
VALID |= {"self_repeat_verts.obj": 6, "self_collinear.obj": 2, "trimesh_noimg.obj": 1000, "trimesh_nancolor.obj": 12}
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
    command, environment = [sys.executable, "-c", LOAD_ALL, *paths], {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert os.listdir(folder) == []  # no PWNED, nothing else
    assert not (FOLDER / "bad" / "PWNED").exists()
    return {name: rest for name, *rest in map(json.loads, done.stdout.splitlines())}


def test_valid_files_load_and_others_are_refused(verdicts):
    assert set(VALID) < set(verdicts)
    for name, (verdict, seconds, peak) in verdicts.items():
        assert seconds < 5
        assert peak < 1024
        if name in VALID:
            assert verdict == VALID[name], name
            continue
        assert isinstance(verdict, str), name
        assert verdict.isprintable()
        for part in (f"{name}: ", "expected ", "found "):
            assert part in verdict, verdict


@pytest.mark.parametrize(
    ("name", "meshes", "verts", "faces", "drawn", "image"),
    [
        ("cat.npy", 1, 2248, 3954, 3954, None),
        ("teapot.obj", 1, 3644, 6320, 6320, None),
        ("beetle-alt.obj", 1, 19887, 38656, 38656, None),
        ("spot/spot.obj", 1, 2930, 5856, 5856, (1024, 1024, 3)),
        ("Duck.glb", 1, 2399, 4212, 4212, (512, 512, 3)),
        ("BoxTextured.glb", 1, 24, 12, 12, (256, 256, 3)),
        ("2CylinderEngine.glb", 34, 55843, 75730, 121496, None),
    ],
)
@pytest.mark.filterwarnings("error")
def test_real_scenes(name, meshes, verts, faces, drawn, image):
    scene = load(FOLDER / name)
    counts = sum(len(mesh.verts) for mesh in scene.meshes), sum(len(mesh.faces) for mesh in scene.meshes)
    assert (len(scene.meshes), *counts, scene.face_count) == (meshes, verts, faces, drawn)
    texture = scene.meshes[0].material.texture
    assert (texture and texture.image.shape) == image
    if name.endswith(".glb"):
        assert all(mesh.normals is not None and mesh.verts.dtype == np.float32 for mesh in scene.meshes)
