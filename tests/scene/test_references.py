"""Files to which scene files refer: textures that are elsewhere or damaged cost no picture, and stores of links are read."""

import base64
import hashlib
import os
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, UVS, Gltf, ply, png, properties
from scene_files import TRIANGLE, png_header, refusal, scene_and_warnings, write

from clshade import load
from clshade.base import input_files
from clshade.scene.formats import reading

PNG = png(np.zeros((2, 3, 3), np.uint8))
ENDINGS = ("obj", "gltf", "ply")
FOREIGN = [
    *("/srv/a.png", "../a.png", "sub/../../a.png", "sub/a.png", "file:///srv/a.png", "http://localhost/a.png"),
    *("C:\\Users\\some one\\a.png", "c:a.png", "\\\\host\\a.png", "..\\a.png", "A.PNG", "sub\\A.png", '"a.png"'),
]


def textured(folder, ending: str, *references: str) -> str:
    """Write a scene with a triangle for each reference to an image; a PLY file has one only."""
    if ending == "obj":
        text = "mtllib a.mtl\n" + TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\n"
        write(folder / "a.mtl", "".join(f"newmtl m{k}\nmap_Kd {name}\n" for k, name in enumerate(references)))
        return write(folder / "a.obj", text + "".join(f"usemtl m{k}\nf 1/1 2/2 3/3\n" for k in range(len(references))))
    if ending == "ply":
        header = f"comment TextureFile {references[0]}\nelement vertex 3\n{properties('float', 'x y z u v')}"
        header += "element face 1\nproperty list uchar int vertex_indices\n"
        rows = [("5f", [*corner, *uv]) for corner, uv in zip(CORNERS, UVS, strict=True)]
        return write(folder / "a.ply", ply("ascii", header, [*rows, ("B3i", [3, 0, 1, 2])]))
    document = Gltf()
    for k, name in enumerate(references):
        document.add("textures", {"source": document.add("images", {"uri": name})})
        document.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}})
        document.mesh({"POSITION": CORNERS, "TEXCOORD_0": UVS}, INDICES, material=k)
    folder.mkdir(exist_ok=True)
    return document.gltf(folder / "a.gltf", "a.bin")


def loaded(path) -> tuple[list[tuple[int, ...] | None], list[str]]:
    """Return the shapes of the meshes' textures, and the warnings."""
    scene, messages = scene_and_warnings(path)
    textures = [mesh.material.texture for mesh in scene.meshes]
    return [None if texture is None else texture.image.shape[:2] for texture in textures], messages


@pytest.mark.parametrize(
    ("name", "ending"), [*((name, "obj") for name in FOREIGN), ("c:a.png", "gltf"), ("c:a.png", "ply")]
)
def test_a_file_of_that_name_beside_the_scene_stands_for_a_path_that_leads_nowhere(tmp_path, monkeypatch, name, ending):
    folder, opened = tmp_path / "scene", []
    path = textured(folder, ending, name)
    (folder / "sub").mkdir()
    (tmp_path / "a.png").write_bytes(png(np.zeros((4, 4, 3), np.uint8)))

    def recorded(file, mode):
        opened.append(file)
        return open(file, mode)

    monkeypatch.setattr(input_files, "open", recorded, raising=False)
    shapes, (message,) = loaded(path)
    assert shapes == [None]
    assert message.endswith(": drawn without it")
    (folder / "a.png").write_bytes(PNG)
    shapes, (message,) = loaded(path)
    assert shapes == [(2, 3)]
    assert message.endswith(": 'a.png' is read")
    where = {"obj": "a.mtl: line 2: map_Kd: ", "gltf": "a.gltf: images[0].uri: ", "ply": "a.ply: comment TextureFile: "}
    assert where[ending] in message
    assert opened
    assert all(Path(os.path.realpath(file)).is_relative_to(folder) for file in opened)


def test_names_in_another_case_are_looked_for_in_the_folder_alone(tmp_path, monkeypatch):
    path, listed = textured(tmp_path / "scene", "obj", "Sub/B.png", "Sub/./In/b.png", "x/A.PNG"), []
    (tmp_path / "elsewhere" / "in").mkdir(parents=True)
    for name in ("elsewhere/b.png", "scene/a.png", "scene/A.PNG"):
        (tmp_path / name).write_bytes(png(np.zeros((2, 3 if "PNG" in name else 4, 3), np.uint8)))
    (tmp_path / "scene" / "sub").symlink_to(tmp_path / "elsewhere")
    listdir = os.listdir
    monkeypatch.setattr(os, "listdir", lambda folder: listed.append(os.path.realpath(folder)) or listdir(folder))
    assert loaded(path)[0] == [None, None, (2, 3)]
    assert set(listed) == {str(tmp_path / "scene")}


def test_of_many_missing_files_a_few_are_looked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "MAX_MISSING", 3)
    path = textured(tmp_path / "scene", "obj", "x/a.png", "b.png", "x/a.png", "y/a.png", "z/a.png", "c.png")
    for name in ("a.png", "c.png"):
        (tmp_path / "scene" / name).write_bytes(PNG)
    shapes, messages = loaded(path)
    assert shapes == [(2, 3), None, (2, 3), None, None, (2, 3)]
    assert len(messages) == 3
    assert messages[2].endswith("there is no file 'y/a.png': drawn without it, and without more of such files")


def test_names_with_a_percent_sign_that_is_not_encoded(tmp_path):
    path = textured(tmp_path, "gltf", "a%20b.png")
    (tmp_path / "a%20b.png").write_bytes(PNG)
    (tmp_path / "a.gltf").write_text((tmp_path / "a.gltf").read_text().replace("a.bin", "a%20b.bin"))
    (tmp_path / "a.bin").rename(tmp_path / "a%20b.bin")
    assert loaded(path) == ([(2, 3)], [])


@pytest.mark.parametrize(
    "uri",
    [
        "data:image/png," + quote(PNG),
        "data:image/png;base64," + base64.encodebytes(PNG).decode(),
        "data:image/png;charset=utf-8;base64," + quote(base64.b64encode(PNG)),
    ],
)
def test_data_uris(tmp_path, uri):
    assert loaded(textured(tmp_path, "gltf", uri)) == ([(2, 3)], [])


def test_libraries_of_another_machine(tmp_path):
    write(tmp_path / "b.mtl", "newmtl m\nKd 0.25 0.5 1\n")
    for name in ("/srv/b.mtl", "C:\\some where\\b.mtl", "..\\B.MTL", "none.mtl C:\\b.mtl"):
        path = write(tmp_path / "a.obj", f"mtllib {name}\n" + TRIANGLE + "usemtl m\nf 1 2 3\n")
        with pytest.warns(UserWarning, match="line 1: mtllib: .*: 'b.mtl' is read"):
            assert load(path).meshes[0].material.kd.tolist() == [0.25, 0.5, 1.0]
    write(tmp_path / "libs" / "c.mtl", "newmtl m\nKd 1 0 0\n")
    path = write(tmp_path / "a.obj", "mtllib ./libs/c.mtl\n" + TRIANGLE + "usemtl m\nf 1 2 3\n")
    assert load(path).meshes[0].material.kd.tolist() == [1, 0, 0]
    path = write(tmp_path / "a.obj", "mtllib /dev/zero\n" + TRIANGLE + "f 1 2 3\n")
    assert "mtllib: expected a file in the scene's folder" in loaded(path)[1][0]


DAMAGED = {
    "text": lambda path: path.write_bytes(b"no image"),
    "empty": lambda path: path.touch(),
    "cut": lambda path: path.write_bytes(png(np.random.default_rng(1).integers(0, 256, (9, 9, 3), np.uint8))[:-40]),
    "large": lambda path: (path.touch(), os.truncate(path, (1 << 29) + 1)),
    "bomb": lambda path: path.write_bytes(png_header(30000, 30000)),
    "folder": lambda path: path.mkdir(),
    "pipe": os.mkfifo,
    "link": lambda path: path.symlink_to("/dev/zero"),
}


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("kind", DAMAGED)
def test_an_image_that_cannot_be_read_costs_no_picture(tmp_path, ending, kind):
    path = textured(tmp_path / "scene", ending, "a.png")
    DAMAGED[kind](tmp_path / "scene" / "a.png")
    shapes, (message,) = loaded(path)
    assert shapes == [None]
    assert message.endswith(": drawn without it")
    assert "a.png" in message or "images[0]" in message


@pytest.mark.parametrize("ending", ["obj", "gltf"])
def test_pixels_of_all_images_are_limited_and_damaged_ones_count(tmp_path, monkeypatch, ending):
    names = [f"{k}.png" for k in range(5)]
    path = textured(tmp_path / "scene", ending, *names)
    image = png(np.random.default_rng(2).integers(0, 256, (8, 8, 3), np.uint8))
    for name in names:
        (tmp_path / "scene" / name).write_bytes(image[:-40] if name == "1.png" else image)
    monkeypatch.setattr(reading, "MAX_PIXELS", 64 * 3 + len(image) // 8)
    shapes, messages = loaded(path)
    assert shapes == [(8, 8), None, (8, 8), None, None]
    assert "1.png" in messages[0] or "images[1]" in messages[0]
    assert all("images: expected at most " in message for message in messages[1:])


# Stores


def hugging_face(top, name: str, data: bytes):
    top = top / "models--someone--cars"
    return top / "snapshots" / "0a1b", top / "blobs" / hashlib.sha256(data).hexdigest()


def git_annex(top, name: str, data: bytes):
    key = f"MD5E-s{len(data)}--{hashlib.md5(data).hexdigest()}{os.path.splitext(name)[1]}"
    return top / "repository" / "cars", top / "repository" / ".git" / "annex" / "objects" / "Wx" / "9z" / key / key


def dvc(top, name: str, data: bytes):
    digest = hashlib.md5(data).hexdigest()
    return top / "project", top / "shared" / "files" / "md5" / digest[:2] / digest[2:]


STORES = (hugging_face, git_annex, dvc)


def store(layout, top, *paths) -> str:
    """Move files into a store, and leave links to them; return the path of the first link."""
    links = []
    for path in paths:
        folder, place = layout(top, path.name, path.read_bytes())
        folder.mkdir(parents=True, exist_ok=True)
        place.parent.mkdir(parents=True, exist_ok=True)
        path.rename(place)
        links.append(folder / path.name)
        links[-1].symlink_to(os.path.relpath(place, folder))
    return str(links[0])


def scene_and_parts(folder, ending: str) -> list:
    path = textured(folder, ending, "a.png")
    (folder / "a.png").write_bytes(PNG)
    return [folder / os.path.basename(path), *(neighbor for neighbor in folder.iterdir() if str(neighbor) != str(path))]


@pytest.mark.parametrize(("layout", "ending"), list(zip(STORES, ENDINGS, strict=True)))
def test_stores_of_links(tmp_path, layout, ending):
    path = store(layout, tmp_path, *scene_and_parts(tmp_path / "a", ending))
    assert loaded(path) == ([(2, 3)], [])


@pytest.mark.parametrize("layout", STORES)
def test_a_store_gives_its_own_files_alone(tmp_path, layout):
    """Not a link to another file, to another store, or to a file of the store that has no hash for a name; and nothing if
    the scene file is none of the store's."""
    scene, *parts = scene_and_parts(tmp_path / "a", "gltf")
    path = store(layout, tmp_path, scene, *(part for part in parts if part.name != "a.png"))
    image, link = tmp_path / "a" / "a.png", tmp_path / os.path.dirname(path) / "a.png"
    private, unnamed = (layout(top, "a.png", image.read_bytes())[1] for top in (tmp_path / "private", tmp_path))
    key = "WORM-s1-m1--a.png"
    unnamed = unnamed.parents[1] / key / key if ".git" in unnamed.parts else unnamed.with_name("a")
    for decoy in (private, unnamed):
        decoy.parent.mkdir(parents=True, exist_ok=True)
        decoy.write_bytes(image.read_bytes())
    for target in (image, private, unnamed, "/dev/zero"):
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        shapes, (message,) = loaded(path)
        assert shapes == [None]
        assert "'a.png', a link out of it (`cp -rL FOLDER COPY` copies what links lead to): drawn" in message
    copy = link.with_name("copy.gltf")
    copy.write_bytes(link.with_name("a.gltf").read_bytes())
    refusal(copy, "buffers[0].uri: expected a file in the scene's folder, found 'a.bin', a link out of it (`cp -rL ")
