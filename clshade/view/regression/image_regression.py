"""The fixture `clshade_image_regression`: draws a scene, compares the bits with those of an earlier run, and tells how an
image differs: a line for each layer, and files to look at."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shlex
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

import numpy as np
import pytest

from ...base.arrays import Array
from ...base.atomic_files import folder_made, lock_file, naming, replacing_all, shown, write_bytes, write_error
from ...base.input_files import file_error, quoted, read_file
from ...base.json_values import found_text, in_line, parse_text
from ...base.spelling import hint
from ...base.validation import known, value_error
from ...errors import ClshadeError, InputError, OutputError
from ...images import compare, exr, png
from ...images.image_file import Group, Picture, read_picture
from ...images.tonemap import tonemap, tonemap_rgba
from ...pipeline.frame import Frame
from ...scene.model import Scene, default_tonemap
from ...scene.settings import LAYERS, FrameOptions
from .. import page
from . import FIXTURE, RENEWED, UPDATE

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ...pipeline.opencl.device import Device

    class Options(FrameOptions, total=False):
        """Keywords of `clshade.render`."""

        device: Device | str | None


_MAX_BYTES = 1 << 31  # of a reference image
_OPTIONS = (*FrameOptions.__annotations__, "device")
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,60}")  # no slash: a key ends with one and the name

# Libraries
VERSION = 1
HASHES = "imageHashes"  # attribute of a reference's header: its entry as JSON
IMAGE = "rgba"  # the name of the image itself, beside those of layers
_KEYS = ("clshade_images", "images")  # the version, and key of an image -> Entry
_ARRAYS = (IMAGE, *LAYERS)
_DIGEST = re.compile(r"[a-z]+\d+ \d+(x\d+)+ [0-9a-f]{64}")
_MAX_LIBRARY = 1 << 26
_PATIENCE = 60.0  # seconds to wait for other processes that write the same library
_MAX_NAME = 80  # characters of a file's name that are taken from a test's

Entry: TypeAlias = dict[str, str]  # name of an array -> `digest`


class ImageRegression:
    """Compares the images of one test, bit for bit, with those in the library beside its file.

    Call it with a `Scene`, which is drawn by `clshade.render`, or with a `Frame`.
    """

    def __init__(
        self, test: pytest.Item, *, update: bool, references: bool, out: Path | None, temporary: Callable[[str], Path]
    ) -> None:
        self._test, self._update, self._references = test, update, references
        self._out, self._temporary = out, temporary
        self._library = test.path.with_name(f"{test.path.stem}_images.json")
        self._compared: set[str] = set()

    def __repr__(self) -> str:
        return f"<{FIXTURE} of {self._key('')}>"

    def __call__(self, scene: Scene | Frame, name: str | None = None, **options: Unpack[Options]) -> Frame:
        """Compare image and layers of a scene, which is drawn, or of a frame with the library's; return the frame.

        name: of the image within its test, at most 60 letters, digits, ``_``, ``-`` and ``.``; a test with several images
        has to name all of them but one. options: keywords of `clshade.render`; none for a Frame.

        The test fails if a bit of the image or of a layer differs, if image or layer have another type or shape, if
        layers are missing or new, or if the library has no such image. With ``--clshade-update`` it passes, and the
        library is renewed. Raises InputError for a refused argument, DeviceError if no OpenCL device works.
        """
        __tracebackhide__ = True
        if name is not None and not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise value_error(FIXTURE, "name", "1 to 60 letters, digits, _, - and ., or None", name)
        key = self._key(name or "")
        if key in self._compared:
            raise value_error(FIXTURE, "name", "another one for each image of a test", name, ", for the second time")
        self._compared.add(key)
        frame = _drawn(scene, options)
        try:
            message = self._check(key, frame)
        except ClshadeError as error:
            message = str(error)
        if message:
            pytest.fail(f"{FIXTURE}: {message}", pytrace=False)
        return frame

    def _key(self, name: str) -> str:
        """Return an image's key: classes, test and parameters as pytest writes them, and the image's name."""
        chain = [node.name for node in self._test.listchain() if isinstance(node, (pytest.Class, pytest.Item))]
        return "::".join(chain) + (f"/{name}" if name else "")

    def _shown(self, path: Path) -> str:
        """Return a path for messages, relative to where pytest was started if that is above it."""
        start = self._test.config.invocation_params.dir
        return shown(path.relative_to(start) if path.is_relative_to(start) else path)

    def _check(self, key: str, frame: Frame) -> str:
        """Compare an image with the library's, or renew that. Return the message of a failed test, "" if it passes."""
        arrays = {IMAGE: frame.rgba, **{name: frame[name] for name in frame.layers}}
        expected, actual = read_library(self._library).get(key), {name: digest(array) for name, array in arrays.items()}
        if self._update:
            self._renew(key, frame, expected, actual)
            return ""
        if actual == expected:
            return ""
        title, lines = f"{self._shown(self._library)} has no image {key}", list[str]()
        failure = _Failure(frame, reference_path(self._library, key), expected)
        if expected is not None:
            title = f"{key} differs from {self._shown(self._library)}"
            lines = _difference_lines(expected, actual, failure)
        try:
            lines.append(failure.write(self._folder(key)))
        except OutputError as error:
            lines.append(str(error))
        test = f"{self._shown(self._test.path)}::{self._key('')}"
        lines.append(f"if the result is right: pytest {shlex.quote(test)} {UPDATE}")
        return "\n  ".join([title, *lines])

    def _folder(self, key: str) -> Path:
        """Return the folder for the files of an image that differs."""
        name = file_name(key)
        if self._out is None:
            return self._temporary(name)
        root, tests = self._test.config.rootpath, self._test.path.with_suffix("")
        return self._out / (tests.relative_to(root) if tests.is_relative_to(root) else tests.name) / name

    def _renew(self, key: str, frame: Frame, expected: Entry | None, actual: Entry) -> None:
        """Put the image into the library if it is not there, and note that for the summary."""
        state, remark, failure = "created", "", _Failure(frame, reference_path(self._library, key), expected)
        if expected is not None:
            state = "unchanged" if actual == expected else "updated"
            remark = "; ".join(_difference_lines(expected, actual, failure)) if actual != expected else ""
        if state != "unchanged" or (self._references and failure.reference is None):
            metadata = {**frame.metadata(deterministic=True), HASHES: json.dumps(actual)}
            encode = partial(exr.encode, channels=frame.channels(), metadata=metadata, window="drawn")
            put_image(self._library, key, actual, encode if self._references else None)
        self._test.user_properties.append((RENEWED, (state, self._shown(self._library), key, remark)))


def _drawn(scene: Scene | Frame, options: Options) -> Frame:
    known(FIXTURE, options, (*_OPTIONS, "name"))
    if isinstance(scene, Frame):
        for name, value in options.items():
            raise value_error(FIXTURE, name, "no option for a Frame, which is drawn already", value)
        return scene
    if not isinstance(scene, Scene):
        raise value_error(FIXTURE, "scene", "a Scene or a Frame", scene)
    from ...pipeline.renderer import render

    return render(scene, **options)


class _Failure:
    """A frame, and the image of the library that it should be; None if that is not at hand, and why. path: of that
    image."""

    def __init__(self, frame: Frame, path: Path, expected: Entry | None) -> None:
        self.frame, self._path = frame, path
        channels = exr.flatten(frame.channels())
        with np.errstate(over="ignore"):  # in the types in which an EXR stores them
            for name, plane in channels.items():
                channels[name] = plane.astype(np.float32) if plane.dtype == np.float64 else plane
        self.result = Picture(channels, frame.metadata(deterministic=True), name="result")
        self.reference: Picture | None = None
        self.lacking = f"there is no reference image {shown(path)}"
        if expected is None or not path.exists():
            return
        try:
            picture = read_picture(path)
        except InputError as error:
            self.lacking = f"no reference image: {error}"
            return
        self.lacking = f"{shown(path)} is not the image of the library, and is not shown"
        if picture.header.get(HASHES) == json.dumps(expected):
            self.reference = replace(picture, name="reference")

    def write(self, folder: Path) -> str:
        """Write result, reference, difference and their page into a folder, and return a line that names them.

        Raises OutputError.
        """
        names = ["result"]
        with folder_made(folder):
            self.frame.write(folder / "result", deterministic=True)
            if self.reference is not None:
                names.append("reference")
                write_bytes(folder / "reference.exr", read_file(self._path, _MAX_BYTES))
                convert, names_used = (
                    (tonemap_rgba, "RGBA") if self.frame.scene.background is None else (tonemap, "RGB")
                )
                pixels = np.stack([self.reference.channels[name] for name in names_used], axis=-1)
                png.write(folder / "reference.png", convert(pixels, default_tonemap(self.frame.scene)))
                if self.reference.shape == self.result.shape:
                    names.append("difference")
                    self._write_difference(folder)
            pictures = {picture.name: picture for picture in (self.result, self.reference) if picture is not None}
            title = f"result and reference of {self.frame.scene.name or 'an image'}"
            page.view(pictures, title, tonemap=default_tonemap(self.frame.scene)).save(folder / "index.html")
        return f"{', '.join(names)} as EXR and PNG, and index.html, which shows them: {shown(folder)}"

    def _write_difference(self, folder: Path) -> None:
        from ...images import compare_figure, figures

        assert self.reference is not None
        layers = compare.chosen_layers(self.result, self.reference)
        channels, references = self.result.channels, self.reference.channels
        errors = {
            name: compare.errors_of(*(Group("", (name,), (planes[name],)) for planes in (channels, references)))
            for name in channels
            if name in references
        }
        exr.write(folder / "difference.exr", errors)
        figure = compare_figure.draw(layers, encoded=False, titles=(self.result.name, self.reference.name))
        figures.save(figure, folder / "difference.png")


def _difference_lines(expected: Entry, actual: Entry, failure: _Failure) -> list[str]:
    """Return a line for each array that differs, for a header that does, and on a reference that is not at hand."""
    lines = []
    for name in sorted({*expected, *actual}, key=[*actual, *expected].index):
        before, now = (entry[name].rpartition(" ")[0] if name in entry else "none" for entry in (expected, actual))
        if before != now:
            lines.append(f"{name}: expected {before}, found {now}")
    different = ", ".join(name for name, text in actual.items() if name in expected and expected[name] != text)
    reference = failure.reference
    if reference is None:
        return [*lines, f"{different}: other bits; {failure.lacking}"] if different else lines
    if reference.shape != failure.result.shape:
        return lines
    worst = []
    for name, pair in compare.chosen_layers(failure.result, reference).items():
        errors = compare.errors_of(*pair)
        if count := int(np.count_nonzero(errors)):
            y, x = np.unravel_index(np.argmax(errors), errors.shape)
            values, wanted = (" ".join(f"{plane[y, x]:.7g}" for plane in group.planes) for group in pair)
            place = f"most at column {x}, row {y} from the top"
            worst.append(f"{name}: {count} of {errors.size} pixels differ, {place}: expected {wanted}, found {values}")
    if different and not worst:
        worst = [f"{different}: other bits, equal values in float32"]
    facts, facts_now = _header_facts(reference), _header_facts(failure.result)
    pairs = {name: (facts.get(name, "none"), facts_now.get(name, "none")) for name in {**facts, **facts_now}}
    headers = [f"{n}: expected {in_line(was)}, found {in_line(now)}" for n, (was, now) in pairs.items() if was != now]
    return [*lines, *worst, *headers]


def _header_facts(picture: Picture) -> dict[str, Any]:
    """Return the settings in a header by name, and the scene; settings with their default may be left out."""
    pieces = re.split(r", (?=\w+=)", str(picture.header.get("settings", "")))
    settings = {f"settings, {name}": value for name, _, value in (piece.partition("=") for piece in pieces) if value}
    return {**settings, "scene": picture.header.get("scene", "none")}


# Libraries of images: a JSON file of hashes beside each file of tests, and an EXR of each image.


def digest(array: Array) -> str:
    """Return type, shape and SHA-256 of an array's bytes in C order, little-endian: `float32 240x320x4 9f86...`."""
    ordered = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    return f"{array.dtype.name} {'x'.join(map(str, array.shape))} {hashlib.sha256(ordered.data).hexdigest()}"


def reference_path(library: Path, key: str) -> Path:
    """Return the EXR of an image, in a folder beside its library."""
    return library.with_suffix("") / f"{file_name(key)}.exr"


def file_name(key: str) -> str:
    """Return the key as a file's name; with a hash if it is too long for one, has characters that some file systems
    refuse, or upper case letters, which some do not tell from lower case."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", key).strip(".-")[:_MAX_NAME]
    return name if name.lower() == key else f"{name}-{hashlib.sha256(key.encode('utf-8', 'replace')).hexdigest()[:8]}"


def read_library(library: Path) -> dict[str, Entry]:
    """Return the entries of a library, key -> Entry; none if there is no such file.

    Raises InputError, one line that names the file and the place, for a file that is no library.
    """
    try:
        data = read_file(library, _MAX_LIBRARY)
    except ValueError:
        if os.path.lexists(library):
            raise
        return {}
    owner = shown(library)
    content = _object(owner, "", parse_text(data, owner, "a library of images", unique=True), _KEYS)
    version, images = map(content.get, _KEYS)
    if version != VERSION or isinstance(version, bool):
        raise file_error(owner, _KEYS[0], f"version {VERSION}", found_text(version))
    entries = _object(owner, _KEYS[1], images)
    for key, entry in entries.items():
        place = f"images, {quoted(key)}"
        for name, text in _object(owner, place, entry, _ARRAYS).items():
            if not isinstance(text, str) or not _DIGEST.fullmatch(text):
                raise file_error(owner, f"{place}, {name}", "type, shape and SHA-256", found_text(text))
        if IMAGE not in entry:
            raise file_error(owner, place, f"{IMAGE} among its keys", ", ".join(entry) or "none")
    return entries


def _object(owner: str, place: str, value: Any, keys: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return an object of JSON. keys: the allowed ones; none: all. Raises InputError for anything else."""
    if not isinstance(value, dict):
        raise file_error(owner, place or "JSON", "an object", found_text(value))
    for key in value:
        if keys and key not in keys:
            expected = f"one of {', '.join(keys)}"
            raise file_error(owner, f"{place}, key" if place else "key", expected, f"{quoted(key)}{hint(key, keys)}")
    return value


def put_image(library: Path, key: str, entry: Entry, encode: Callable[[BinaryIO], Any] | None) -> None:
    """Put an entry into a library, and what `encode` writes into the file of its reference image, both or neither.

    Entries that other processes put there at the same time are kept. Raises OutputError if a file cannot be written, and
    as `read_library`.
    """
    with _locked(library):
        entries = {**read_library(library), key: entry}
        text = json.dumps(dict(zip(_KEYS, (VERSION, dict(sorted(entries.items()))), strict=True)), indent=2) + "\n"
        contents: dict[Path, Callable[[BinaryIO], Any]] = {library: lambda file: file.write(text.encode())}
        if encode is not None:
            contents = {reference_path(library, key): encode, **contents}
        with folder_made(next(iter(contents)).parent), replacing_all(*contents) as files:
            for (path, write), file in zip(contents.items(), files, strict=True):
                with naming(path):
                    write(file)


@contextlib.contextmanager
def _locked(library: Path) -> Iterator[None]:
    """Hold the lock of a library, a file in the folder for temporary ones: nothing is left beside the tests."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    name = hashlib.sha256(os.fsencode(os.path.realpath(library))).hexdigest()[:16]
    path = os.path.join(tempfile.gettempdir(), f"clshade-{user}-{name}.lock")
    with naming(path):
        until = time.monotonic() + _PATIENCE
        while (descriptor := lock_file(path)) is None:
            if time.monotonic() > until:
                raise write_error(library, f"another process has held {shown(path)} for {_PATIENCE:.0f} s")
            time.sleep(0.01)
    try:
        yield
    finally:
        os.close(descriptor)
