"""COCO data sets: what pycocotools reads of them, and what is refused."""

import json
import os

import numpy as np
import pytest
from command_line import assert_refused, listing, run

from clshade import exr
from clshade.errors import InputError
from clshade.images import png
from clshade.images.coco import masks

coco = pytest.importorskip("pycocotools.coco")
mask = pytest.importorskip("pycocotools.mask")
INSTANCES = np.array([[0, 7, 7, 0], [2, 7, 0, 0], [2, 0, 0, 7]], np.uint32)
OBJECTS = np.where(INSTANCES == 7, 3, np.where(INSTANCES == 2, 1, 0)).astype(np.uint32)
PLANES = {"instance_id": INSTANCES, "object_id": OBJECTS}


def written(folder, name="a.exr", **metadata):
    names = {"objectNames": json.dumps({"1": "cat"}), "instanceNames": json.dumps({"7": "tail"}), **metadata}
    exr.write(folder / name, PLANES, metadata=names)
    return folder / name


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (17, 13)])
def test_masks_of_any_shape(shape):
    """Runs that wrap from one column to the next, touch the first and the last pixel, or fill the image."""
    assert masks(np.zeros(shape, np.uint32)) == {}
    rng = np.random.default_rng(shape)
    for instances in (np.full(shape, 2**32 - 1, np.uint32), rng.integers(0, 4, shape), rng.integers(0, 2, shape) * 9):
        annotations = masks(instances)
        assert list(annotations) == [number for number in np.unique(instances).tolist() if number]
        for number, annotation in annotations.items():
            region = instances == number
            coded = mask.encode(np.asfortranarray(region, np.uint8))
            assert annotation["segmentation"]["counts"] == coded["counts"].decode()
            assert np.array_equal(mask.decode(annotation["segmentation"]).astype(bool), region)
            assert (annotation["area"], annotation["bbox"]) == (region.sum(), mask.toBbox(coded).tolist())


@pytest.mark.parametrize("instances", [[[0.5, 1.0]], [1, 2], np.zeros((0, 3), np.uint32), [[True, False]]])
def test_what_has_no_masks(instances):
    with pytest.raises(InputError, match=r"^coco: instances: expected an array of shape \(M, N\) of whole numbers"):
        masks(instances)


def test_names_of_files_that_are_not_utf8(tmp_path, capsys):
    names = ["é.exr", os.fsdecode(b"\xff.exr")]
    assert run(capsys, "coco", *[written(tmp_path, name) for name in names], "-o", tmp_path / "a.json")[0] == 0
    assert "é.exr" in (tmp_path / "a.json").read_text("utf-8")
    assert [image["file_name"] for image in json.loads((tmp_path / "a.json").read_bytes())["images"]] == names


def test_pycocotools_reads_the_data_set(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    first, second = written(tmp_path / "in"), written(tmp_path, "b.exr", instanceNames="{}")
    png.write(first.with_suffix(".png"), np.zeros((3, 4, 3), np.uint8))
    png.write(second.with_suffix(".png"), np.zeros((3, 9, 3), np.uint8))  # of another size, such as one with a colorbar
    out = run(capsys, "coco", first, "-o", tmp_path / "one.json")[1]
    assert out.endswith(": 1 image, 2 annotations, 2 categories\n")
    code, out, err = run(capsys, "coco", first, second, "-o", tmp_path / "found.json")
    assert (code, err) == (0, [])
    assert "2 images, 4 annotations, 2 categories" in out
    data_set = coco.COCO(str(tmp_path / "found.json"))
    images = [(image["file_name"], image["height"], image["width"]) for image in data_set.loadImgs([1, 2])]
    assert images == [("in/a.png", 3, 4), ("b.exr", 3, 4)]
    categories = {category["name"]: category["id"] for category in data_set.loadCats(data_set.getCatIds())}
    assert set(categories) == {"cat", "object 3"}
    annotations = data_set.loadAnns(data_set.getAnnIds(catIds=[categories["object 3"]]))
    values = [tuple(annotation[name] for name in ("image_id", "instance_id", "name")) for annotation in annotations]
    assert values == [(1, 7, "tail"), (2, 7, "")]
    assert np.array_equal(data_set.annToMask(annotations[0]).astype(bool), INSTANCES == 7)


NAMES = "a.exr: objectNames: expected a JSON object of names by number, found"
JSON = NAMES.replace("expected", "JSON: expected")


@pytest.mark.parametrize(
    ("planes", "names", "output", "message"),
    [
        ({"instance_id": INSTANCES}, "{}", "b.json", "a.exr: layers: expected the layers instance_id and object_id"),
        ({**PLANES, "object_id": np.float32(OBJECTS)}, "{}", "b.json", "a.exr: layers: expected whole numbers"),
        *((PLANES, names, "b.json", f"{NAMES} something else") for names in ("[]", 3, '{"one": "cat"}')),
        (PLANES, "{", "b.json", JSON + " Expecting property name"),
        (PLANES, "[" * 100_000, "b.json", JSON + " too deep a nesting"),
        (PLANES, '{"1": null}', "b.json", "a.exr: objectNames: expected names that are texts, found others"),
        (PLANES, "{}", "b.txt", "--output: expected a file name that ends in .json"),
    ],
)
def test_what_is_refused(folder, capsys, planes, names, output, message):
    exr.write("a.exr", planes, metadata={"objectNames": names})
    assert_refused(run(capsys, "coco", "a.exr", "-o", output), message)
    assert listing(folder) == ["a.exr"]
