"""Masks of instances as a COCO data set: images, categories, and an annotation for each instance seen, as JSON.

The format of the COCO object detection task. Run lengths are coded by pycocotools.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import shown
from ..base.input_files import file_error
from ..errors import InputError
from . import exr

LAYERS = ("instance_id", "object_id")


def masks(instances: Array) -> dict[int, dict[str, Any]]:
    """Return the mask of each instance in an image.

    Parameters
    ----------
    instances : ndarray, (M, N) of integers
        Number of the instance that each pixel shows, row 0 at the top; 0 for none.

    Returns
    -------
    dict of int to dict
        For each number, in ascending order: `segmentation`, run lengths down the columns as COCO
        codes them, `area` in pixels, and `bbox`, [x, y, width, height] with the origin at the top
        left corner of the image.

    Raises
    ------
    InputError
        pycocotools is not installed.
    """
    try:
        from pycocotools import mask
    except ImportError:
        raise file_error("coco", "masks", "pycocotools", "none: `pip install pycocotools`") from None
    numbers, index, counts = np.unique(instances, return_inverse=True, return_counts=True)
    index = index.reshape(instances.shape)
    found = {}
    for k, number in enumerate(numbers.tolist()):
        if not number:
            continue
        own = index == k
        coded = mask.encode(np.asfortranarray(own, dtype=np.uint8))
        columns, rows = np.flatnonzero(own.any(axis=0)), np.flatnonzero(own.any(axis=1))
        box = columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1
        found[number] = {
            "segmentation": {"size": list(instances.shape), "counts": coded["counts"].decode("ascii")},
            "area": int(counts[k]),
            "bbox": [float(each) for each in box],
        }
    return found


def data_set(files: Sequence[str | os.PathLike[str]], folder: str | os.PathLike[str] = ".") -> dict[str, Any]:
    """Return the data set of rendered images.

    Parameters
    ----------
    files : sequence of paths
        EXR files with the layers `instance_id` and `object_id`.
    folder : path, default "."
        Where the data set will lie: the files' names are relative to it.

    Returns
    -------
    dict
        `images`, with the PNG beside each EXR if there is one, `categories`, the objects by name,
        or ``object 1`` and so on, and `annotations`, which also hold the number and name of the
        instance, `instance_id` and `name`. All ids count from 1.

    Raises
    ------
    InputError
        A file is no EXR or lacks a layer, or pycocotools is not installed.
    """
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    categories: dict[str, int] = {}
    for number, file in enumerate(files, 1):
        instances, objects, header = _read(file)
        names, object_names = (_names(header, name, shown(file)) for name in ("instanceNames", "objectNames"))
        picture = Path(file).with_suffix(".png")
        seen = picture if picture.is_file() else Path(file)
        rows, columns = instances.shape
        images.append({"id": number, "file_name": os.path.relpath(seen, folder), "width": columns, "height": rows})
        for each in object_names.values():
            categories.setdefault(each, len(categories) + 1)
        present, first = np.unique(instances, return_index=True)
        object_of = dict(zip(present.tolist(), objects.ravel()[first].tolist(), strict=True))
        for instance, mask in masks(instances).items():
            category = object_names.get(object_of[instance]) or f"object {object_of[instance]}"
            facts = {
                "id": len(annotations) + 1,
                "image_id": number,
                "category_id": categories.setdefault(category, len(categories) + 1),
            }
            own = {"iscrowd": 0, "instance_id": instance, "name": names.get(instance, "")}
            annotations.append({**facts, **mask, **own})
    if not images:
        raise InputError("coco: files: expected at least one image, found none")
    listed = [{"id": number, "name": name, "supercategory": ""} for name, number in categories.items()]
    return {"info": {"description": "clshade"}, "images": images, "annotations": annotations, "categories": listed}


def _read(file: str | os.PathLike[str]) -> tuple[Array, Array, dict[str, Any]]:
    """Return the layers of LAYERS and the header of an EXR file."""
    channels, header = exr.read(file)
    missing = [name for name in LAYERS if name not in channels]
    if missing:
        expected = f"the layers {' and '.join(LAYERS)} (`--layers {','.join(LAYERS)}`)"
        raise file_error(shown(file), "layers", expected, f"no {missing[0]}")
    instances, objects = (channels[name] for name in LAYERS)
    if not all(plane.dtype == np.uint32 for plane in (instances, objects)):
        raise file_error(shown(file), "layers", "whole numbers", "others")
    return instances, objects, header


def _names(header: Mapping[str, Any], attribute: str, owner: str) -> dict[int, str]:
    """Return the names of numbers in a header written by `Frame.save`."""
    try:
        found = json.loads(header.get(attribute, "{}"))
        return {int(number): str(name) for number, name in found.items()}
    except (ValueError, TypeError, AttributeError):
        raise file_error(owner, attribute, "a JSON object of names by number", "something else") from None
