"""The fixture `clshade_image_regression`: draws a scene, compares the bits with those of an earlier run, and tells how an
image differs: a line for each layer, and files to look at."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from ...base.atomic_files import folder_made, shown, write_bytes
from ...base.input_files import read_file
from ...base.json_values import in_line
from ...base.validation import known, value_error
from ...errors import ClshadeError, InputError, OutputError
from ...images import compare, exr, png
from ...images.channels import Group
from ...images.image_file import Picture, read_picture
from ...images.tonemap import tonemap
from ...images.transparency import tonemap_rgba
from ...pipeline.frame import Frame
from ...scene.model import Scene, default_tonemap
from ...scene.settings import FrameOptions
from .. import page
from . import FIXTURE, RENEWED, UPDATE, library

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ...pipeline.opencl.device import Device

    class Options(FrameOptions, total=False):
        """Keywords of `clshade.render`."""

        device: Device | str | None


_MAX_BYTES = 1 << 31  # of a reference image
_OPTIONS = (*FrameOptions.__annotations__, "device")
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,60}")  # no slash: a key ends with one and the name


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
        """Compare image and layers of a scene, which is drawn, or of a frame with the library's.

        Parameters
        ----------
        scene : Scene or Frame
            What to draw, or what was drawn.
        name : str, optional
            Name of the image within its test, at most 60 letters, digits, ``_``, ``-`` and ``.``. A
            test with several images has to name all of them but one.
        **options
            Keywords of `clshade.render`; none for a Frame.

        Returns
        -------
        Frame
            The frame that was compared.

        Raises
        ------
        InputError
            If an argument is refused.
        DeviceError
            If no OpenCL device works.

        Notes
        -----
        The test fails if a bit of the image or of a layer differs, if image or layer have another
        type or shape, if layers are missing or new, or if the library has no such image. With
        ``--clshade-update`` it passes, and the library is renewed.
        """
        __tracebackhide__ = True
        key = self._new_key(name)
        frame = _drawn(scene, options)
        try:
            message = self._check(key, frame)
        except ClshadeError as error:
            message = str(error)
        if message:
            pytest.fail(f"{FIXTURE}: {message}", pytrace=False)
        return frame

    def _new_key(self, name: str | None) -> str:
        if name is not None and not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise value_error(FIXTURE, "name", "1 to 60 letters, digits, _, - and ., or None", name)
        key = self._key(name or "")
        if key in self._compared:
            raise value_error(FIXTURE, "name", "another one for each image of a test", name, ", for the second time")
        self._compared.add(key)
        return key

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
        expected, actual = library.read(self._library).get(key), library.entry_of(frame)
        if self._update:
            self._renew(key, frame, expected, actual)
            return ""
        if actual == expected:
            return ""
        title, failure = f"{self._shown(self._library)} has no image {key}", _Failure(frame)
        lines: list[str] = []
        if expected is not None:
            title = f"{key} differs from {self._shown(self._library)}"
            failure.read_reference(library.reference_path(self._library, key), expected)
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
        name = library.file_name(key)
        if self._out is None:
            return self._temporary(name)
        root, tests = self._test.config.rootpath, self._test.path.with_suffix("")
        return self._out / (tests.relative_to(root) if tests.is_relative_to(root) else tests.name) / name

    def _renew(self, key: str, frame: Frame, expected: library.Entry | None, actual: library.Entry) -> None:
        """Put the image into the library if it is not there, and note that for the summary."""
        state, remark, failure = "created", "", _Failure(frame)
        if expected is not None:
            failure.read_reference(library.reference_path(self._library, key), expected)
            state = "unchanged" if actual == expected else "updated"
            remark = "; ".join(_difference_lines(expected, actual, failure)) if actual != expected else ""
        if state != "unchanged" or (self._references and failure.reference is None):
            metadata = {**frame.metadata(deterministic=True), library.HASHES: json.dumps(actual)}
            encode = partial(exr.encode, channels=frame.channels(), metadata=metadata, window="drawn")
            library.put(self._library, key, actual, encode if self._references else None)
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
    """A frame, and the image that it should be, if that is at hand.

    reference: None without a file, or if the file has other hashes. lacking: why there is none.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        channels = exr.flatten(frame.channels())
        with np.errstate(over="ignore"):  # in the types in which an EXR stores them
            for name, plane in channels.items():
                channels[name] = plane.astype(np.float32) if plane.dtype == np.float64 else plane
        self.result = Picture(channels, frame.metadata(deterministic=True), name="result")
        self.reference: Picture | None = None
        self.lacking = ""
        self._path: Path | None = None

    def read_reference(self, path: Path, entry: library.Entry) -> None:
        """Read the reference image, if it belongs to `entry`."""
        if not path.exists():
            self.lacking = f"there is no reference image {shown(path)}"
            return
        try:
            picture = read_picture(path)
        except InputError as error:
            self.lacking = f"no reference image: {error}"
            return
        if picture.header.get(library.HASHES) != json.dumps(entry):
            self.lacking = f"{shown(path)} is not the image of the library, and is not shown"
            return
        self._path, self.reference = path, Picture(picture.channels, picture.header, name="reference")

    def write(self, folder: Path) -> str:
        """Write result, reference, difference and their page into a folder, and return a line that names them.

        Raises OutputError.
        """
        names = ["result"]
        with folder_made(folder):
            self.frame.write(folder / "result", deterministic=True)
            if self.reference is not None and self._path is not None:
                names.append("reference")
                write_bytes(folder / "reference.exr", read_file(self._path, _MAX_BYTES))
                is_opaque, operator = self.frame.scene.background is not None, default_tonemap(self.frame.scene)
                pixels = np.stack([self.reference.channels[name] for name in "RGBA"[: 3 if is_opaque else 4]], axis=-1)
                codes = tonemap(pixels, operator, 0.0) if is_opaque else tonemap_rgba(pixels, operator, 0.0)
                png.write(folder / "reference.png", codes)
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
            name: compare.errors_of(Group("", (name,), (plane,)), Group("", (name,), (references[name],)))
            for name, plane in channels.items()
            if name in references
        }
        exr.write(folder / "difference.exr", errors)
        figure = compare_figure.draw(layers, encoded=False, titles=(self.result.name, self.reference.name))
        figures.save(figure, folder / "difference.png")


def _difference_lines(expected: library.Entry, actual: library.Entry, failure: _Failure) -> list[str]:
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
    pairs = compare.chosen_layers(failure.result, reference)
    worst = [line for name, pair in pairs.items() if (line := _worst_line(name, pair))]
    if different and not worst:
        worst = [f"{different}: other bits, equal values in float32"]
    facts, facts_now = _header_facts(reference), _header_facts(failure.result)
    headers = [
        f"{name}: expected {in_line(facts.get(name, 'none'))}, found {in_line(facts_now.get(name, 'none'))}"
        for name in {**facts, **facts_now}
        if facts.get(name) != facts_now.get(name)
    ]
    return [*lines, *worst, *headers]


def _header_facts(picture: Picture) -> dict[str, Any]:
    """Return the settings in a header by name, and the scene; settings with their default may be left out."""
    pieces = re.split(r", (?=\w+=)", str(picture.header.get("settings", "")))
    settings = {f"settings, {name}": value for name, _, value in (piece.partition("=") for piece in pieces) if value}
    return {**settings, "scene": picture.header.get("scene", "none")}


def _worst_line(name: str, pair: tuple[Group, Group]) -> str:
    """Return how many pixels of a layer differ, and the values where they differ most; "" if none does."""
    errors = compare.errors_of(*pair)
    count = int(np.count_nonzero(errors))
    if not count:
        return ""
    y, x = np.unravel_index(np.argmax(errors), errors.shape)
    values, wanted = (" ".join(f"{plane[y, x]:.7g}" for plane in group.planes) for group in pair)
    return (
        f"{name}: {count} of {errors.size} pixels differ, most at column {x}, row {y} from the top: "
        f"expected {wanted}, found {values}"
    )
