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
from . import exr, png

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
        The array has another shape or type, or pycocotools is not installed.
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
    found = {}
    for number, own in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        if not number:
            continue
        edges = np.column_stack([starts[own], ends[own]]).ravel()
        if edges[-1] < flat.size:
            edges = np.append(edges, flat.size)
        lengths = np.diff(edges, prepend=0).tolist()  # of what is outside and inside in turn
        coded = mask.frPyObjects({"size": [rows, columns], "counts": lengths}, rows, columns)
        found[number] = {
            "segmentation": {"size": [rows, columns], "counts": coded["counts"].decode("ascii")},
            "area": int(mask.area(coded)),
            "bbox": mask.toBbox(coded).tolist(),
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
        `images`, with the PNG beside each EXR if there is one of the same size, `categories`, the
        objects by name, or ``object 1`` and so on, and `annotations`, which also hold the number and
        name of the instance, else its object's, `instance_id` and `name`. All ids count from 1.

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
        rows, columns = instances.shape
        picture = Path(file).with_suffix(".png")
        seen = picture if png.resolution(picture) == (columns, rows) else file
        name = Path(os.path.relpath(seen, folder)).as_posix()
        images.append({"id": number, "file_name": name, "width": columns, "height": rows})
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
            own = {
                "iscrowd": 0,
                "instance_id": instance,
                "name": names.get(instance) or object_names.get(object_of[instance], ""),
            }
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
    expected = "a JSON object of names by number"
    written = header.get(attribute, "{}")
    found = (
        parse_text(written.encode("utf-8", "replace"), f"{owner}: {attribute}", expected)
        if isinstance(written, str)
        else written
    )
    if not isinstance(found, dict) or not all(re.fullmatch("[0-9]{1,10}", number) for number in found):
        raise file_error(owner, attribute, expected, "something else")
    if not all(isinstance(name, str) for name in found.values()):
        raise file_error(owner, attribute, "names that are texts", "others")
    return {int(number): name for number, name in found.items() if name}
