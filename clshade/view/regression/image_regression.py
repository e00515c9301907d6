"""The fixture `clshade_image_regression`: draws a scene and compares the bits with those of an earlier run."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import pytest

from ...base.atomic_files import shown
from ...base.validation import known, value_error
from ...errors import ClshadeError, OutputError
from ...images import exr
from ...pipeline.frame import Frame
from ...scene.model import Scene
from ...scene.settings import FrameOptions
from . import library
from .failure import Failure, difference_lines
from .options import FIXTURE, RENEWED, UPDATE

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ...pipeline.opencl.device import Device

    class Options(FrameOptions, total=False):
        """Keywords of `clshade.render`."""

        device: Device | str | None


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
        self._library = library.library_path(test.path)
        self._compared: set[str] = set()

    def __repr__(self) -> str:
        return f"<{FIXTURE} of {self._key('')}>"

    def __call__(self, scene: Scene | Frame, name: str | None = None, **options: Unpack[Options]) -> Frame:
        """Draw a scene, or take a frame, and compare image and layers with the library's.

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
            message = self._renew(key, frame) if self._update else self._compare(key, frame)
        except ClshadeError as error:
            message = str(error)
        if message:
            pytest.fail(f"{FIXTURE}: {message}", pytrace=False)
        return frame

    def _new_key(self, name: str | None) -> str:
        if name is not None and not (isinstance(name, str) and _NAME.fullmatch(name)):
            expected = "1 to 60 letters, digits, _, - and ., or None"
            raise value_error(FIXTURE, "name", expected, name)
        key = self._key(name or "")
        if key in self._compared:
            expected = "another one for each image of a test"
            raise value_error(FIXTURE, "name", expected, name, ", for the second time")
        self._compared.add(key)
        return key

    def _key(self, name: str) -> str:
        """Return the key of an image: classes, test and parameters as pytest writes them, and the image's name."""
        chain = [node.name for node in self._test.listchain() if isinstance(node, (pytest.Class, pytest.Item))]
        return "::".join(chain) + (f"/{name}" if name else "")

    def _shown(self, path: Path) -> str:
        """Return a path for messages, relative to where pytest was started if that is above it."""
        start = self._test.config.invocation_params.dir
        return shown(path.relative_to(start) if path.is_relative_to(start) else path)

    def _command(self) -> str:
        """Return the command that renews the images of this test."""
        test = f"{self._shown(self._test.path)}::{self._key('')}"
        return f"pytest {shlex.quote(test)} {UPDATE}"

    def _compare(self, key: str, frame: Frame) -> str:
        """Return what to say of an image that is not the library's, or ""."""
        expected, found = library.read(self._library).get(key), library.entry_of(frame)
        if found == expected:
            return ""
        title = f"{self._shown(self._library)} has no image {key}"
        failure = Failure(frame)
        lines = []
        if expected is not None:
            title = f"{key} differs from {self._shown(self._library)}"
            failure.read_reference(library.reference_path(self._library, key), expected)
            lines = difference_lines(expected, found, failure)
        try:
            lines.append(failure.write(self._folder(key)))
        except OutputError as error:
            lines.append(str(error))
        lines.append(f"if the result is right: {self._command()}")
        return "\n  ".join([title, *lines])

    def _folder(self, key: str) -> Path:
        """Return the folder for the files of an image that differs."""
        if self._out is None:
            return self._temporary(library.file_name(key))
        root = self._test.config.rootpath
        tests = self._test.path.with_suffix("")
        return (
            self._out / (tests.relative_to(root) if tests.is_relative_to(root) else tests.name) / library.file_name(key)
        )

    def _renew(self, key: str, frame: Frame) -> str:
        """Put the image into the library if it is not there, and note that for the summary."""
        expected, found = library.read(self._library).get(key), library.entry_of(frame)
        failure = Failure(frame)
        if expected is not None:
            failure.read_reference(library.reference_path(self._library, key), expected)
        state = "unchanged" if found == expected else "created" if expected is None else "updated"
        remark = "; ".join(difference_lines(expected, found, failure)) if expected and found != expected else ""
        if found != expected or (self._references and failure.reference is None):
            library.put(self._library, key, found, self._encoder(frame, found) if self._references else None)
        self._test.user_properties.append((RENEWED, (state, self._shown(self._library), key, remark)))
        return ""

    def _encoder(self, frame: Frame, entry: library.Entry) -> Callable[[BinaryIO], Any]:
        metadata = {**frame.metadata(deterministic=True), library.HASHES: json.dumps(entry)}
        return lambda file: exr.encode(file, frame.channels(), metadata=metadata, window="drawn")


def _drawn(scene: Scene | Frame, options: Options) -> Frame:
    known(FIXTURE, options, (*_OPTIONS, "name"))
    if isinstance(scene, Frame):
        for name, value in options.items():
            expected = "no option for a Frame, which is drawn already"
            raise value_error(FIXTURE, name, expected, value)
        return scene
    if not isinstance(scene, Scene):
        raise value_error(FIXTURE, "scene", "a Scene or a Frame", scene)
    from ...pipeline.renderer import render

    return render(scene, **options)
