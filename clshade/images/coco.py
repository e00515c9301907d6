"""Masks of instances as a COCO data set: images, categories, and an annotation for each instance seen, as JSON.

The format of the COCO object detection task. Run lengths are coded by pycocotools.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import shown
from ..base.input_files import file_error
from ..base.json_values import parse_text
from ..base.validation import value_error
from ..errors import InputError
from . import exr
from .image_file import resolution_of

LAYERS = ("instance_id", "object_id")


def masks(instances: Array) -> dict[int, dict[str, Any]]:
    """Return the mask of each instance in an image, by its number, in ascending order.

    instances: (M, N) whole numbers, the instance that each pixel shows, row 0 at the top; 0 for none.
    A mask has `segmentation`, run lengths down the columns as COCO codes them, `area` in pixels, and `bbox`, [x, y, width,
    height] with the origin at the top left corner of the image.
    Raises InputError for another shape or type, or if pycocotools is not installed.
    """
    try:
        from pycocotools import mask
    except ImportError:
        raise file_error("coco", "masks", "pycocotools", "none: `pip install pycocotools`") from None
    instances = np.asarray(instances)
    if instances.ndim != 2 or instances.dtype.kind not in "ui" or 0 in instances.shape:
        raise value_error("coco", "instances", "an array of shape (M, N) of whole numbers", instances)
    rows, columns = instances.shape
    flat = instances.ravel(order="F")
    starts = np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]) + 1])  # of runs of one number
    ends = np.append(starts[1:], flat.size)
    order = np.argsort(flat[starts], kind="stable")
    numbers, first = np.unique(flat[starts][order], return_index=True)
    result = {}
    for number, runs in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        if not number:
            continue
        edges = np.column_stack([starts[runs], ends[runs]]).ravel()
        if edges[-1] < flat.size:
            edges = np.append(edges, flat.size)
        lengths = np.diff(edges, prepend=0).tolist()  # outside and inside in turn
        coded = mask.frPyObjects({"size": [rows, columns], "counts": lengths}, rows, columns)
        result[number] = {
            "segmentation": {"size": [rows, columns], "counts": coded["counts"].decode("ascii")},
            "area": int(mask.area(coded)),
            "bbox": mask.toBbox(coded).tolist(),
        }
    return result


def data_set(files: Sequence[str | os.PathLike[str]], folder: str | os.PathLike[str] = ".") -> dict[str, Any]:
    """Return the data set of rendered images.

    files: EXR files with the layers `instance_id` and `object_id`. folder: where the data set will lie: the files' names
    are relative to it.

    It has `images`, with the PNG beside each EXR if there is one of the same size, `categories`, the objects by name, or
    "object 1" and so on, and `annotations`, which also hold `instance_id` and `name`, the instance's, else its object's.
    All ids count from 1.
    Raises InputError for a file that is no EXR or lacks a layer, or if pycocotools is not installed.
    """
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    categories: dict[str, int] = {}
    for image_id, file in enumerate(files, 1):
        channels, header = exr.read(file)
        if missing := [name for name in LAYERS if name not in channels]:
            expected = f"the layers {' and '.join(LAYERS)} (`--layers {','.join(LAYERS)}`)"
            raise file_error(shown(file), "layers", expected, f"no {missing[0]}")
        instances, objects = (channels[name] for name in LAYERS)
        if not instances.dtype == objects.dtype == np.uint32:
            raise file_error(shown(file), "layers", "whole numbers", "others")
        names, object_names = (_names(header, name, shown(file)) for name in ("instanceNames", "objectNames"))
        rows, columns = instances.shape
        picture = Path(file).with_suffix(".png")
        path = os.path.relpath(picture if resolution_of(picture) == (columns, rows) else file, folder)
        images.append({"id": image_id, "file_name": Path(path).as_posix(), "width": columns, "height": rows})
        for name in object_names.values():
            categories.setdefault(name, len(categories) + 1)
        present, first = np.unique(instances, return_index=True)
        object_of = dict(zip(present.tolist(), objects.ravel()[first].tolist(), strict=True))
        for instance, mask in masks(instances).items():
            object_name = object_names.get(object_of[instance], "")
            category = object_name or f"object {object_of[instance]}"
            category_id = categories.setdefault(category, len(categories) + 1)
            ids = {"id": len(annotations) + 1, "image_id": image_id, "category_id": category_id}
            name = names.get(instance) or object_name
            annotations.append({**ids, **mask, "iscrowd": 0, "instance_id": instance, "name": name})
    if not images:
        raise InputError("coco: files: expected at least one image, found none")
    listed = [{"id": number, "name": name, "supercategory": ""} for name, number in categories.items()]
    return {"info": {"description": "clshade"}, "images": images, "annotations": annotations, "categories": listed}


def _names(header: Mapping[str, Any], attribute: str, owner: str) -> dict[int, str]:
    """Return the names of numbers in a header written by `Frame.save`."""
    expected, names = "a JSON object of names by number", header.get(attribute, "{}")
    if isinstance(names, str):
        names = parse_text(names.encode("utf-8", "replace"), f"{owner}: {attribute}", expected)
    if not isinstance(names, dict) or not all(re.fullmatch("[0-9]{1,10}", number) for number in names):
        raise file_error(owner, attribute, expected, "something else")
    if not all(isinstance(name, str) for name in names.values()):
        raise file_error(owner, attribute, "names that are texts", "others")
    return {int(number): name for number, name in names.items() if name}
