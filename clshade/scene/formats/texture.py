"""Textures from an image file's path, an array, or a Texture; and the images to which scene files refer."""

from __future__ import annotations

import contextlib
import os
import re
import warnings
from collections.abc import Callable

from numpy.typing import ArrayLike

from ...base.atomic_files import Path, shown
from ...base.input_files import beside, file_error, quoted, read_file
from ...errors import InputError
from ...images.decode import MAX_BYTES, CodedImage, decode_image, read_image
from ..model import Lookup, Texture, Wrap

MAX_PIXELS = 1 << 28  # of all images of a scene: 3 GiB as linear float32 RGB
MAX_MISSING = 256  # files for which the names of others are tried, as that takes time
_BYTES = 8  # of an image that is none, for which it counts as a pixel


class Images:
    """The images of a scene file, each decoded once. One that cannot be had is left out, with a warning: a texture never
    costs the picture.

    scene: path of the scene file. At most MAX_PIXELS pixels are decoded in all, those of damaged images too.
    """

    def __init__(self, scene: Path) -> None:
        self.scene, self._left, self._missing = scene, MAX_PIXELS, 0
        self._images: dict[tuple[str, bool], CodedImage | None] = {}
        self._paths: dict[tuple[str, str | None], str | None] = {}
        self._names: dict[str, dict[str, str]] = {}

    def has(self, reference: str, owner: str, field: str) -> bool:
        """Return whether `beside` finds a file."""
        with contextlib.suppress(InputError):
            return beside(self.scene, reference, owner, field) is not None
        return False

    def find(
        self, reference: str, owner: str, field: str, folder: str | None = None, *, optional: bool = False
    ) -> str | None:
        """Return the path of a file as `beside` does, or else, with a warning, of the file of that name beside the scene:
        exporters write the paths of the machine they ran on, and Windows takes either case. None, with a warning unless
        it is optional, if there is neither. A reference is sought, and warned of, once."""
        key = reference, folder
        if key not in self._paths:
            path = self._search(reference, owner, field, folder, optional)
            if path is None and optional:
                return None
            self._paths[key] = path
        return self._paths[key]

    def _search(self, reference: str, owner: str, field: str, folder: str | None, optional: bool) -> str | None:
        root = os.path.dirname(os.fspath(self.scene)) or "."
        name = re.split(r"[\\/:]", reference)[-1].strip("\"'")
        tried = [(reference, folder or root), (name, folder or root), (name, root)]
        problem = f"{owner}: {field}: there is no file {quoted(reference)}"
        try:
            path = beside(self.scene, reference, owner, field, folder)
            if path is not None:
                return path
        except InputError as error:
            problem, tried = str(error), tried[1:]
        self._missing += 1
        if self._missing == MAX_MISSING:
            warnings.warn(f"{problem}: drawn without it, and without more of such files", stacklevel=2)
        if self._missing >= MAX_MISSING:
            return None
        for other, place in tried:
            with contextlib.suppress(InputError):
                spelled = self._spelled(other, place)
                path = beside(self.scene, spelled, owner, field, place)
                if path is not None:
                    warnings.warn(f"{problem}: {quoted(spelled)} is read", stacklevel=2)
                    return path
        if not optional:
            warnings.warn(f"{problem}: drawn without it", stacklevel=2)
        return None

    def _spelled(self, reference: str, folder: str) -> str:
        """Return a relative path in the upper and lower case of the files that are there."""
        parts: list[str] = []
        top = os.path.realpath(os.path.dirname(os.fspath(self.scene)) or ".")
        for part in reference.replace("\\", "/").split("/"):
            if part in ("", "."):
                continue
            place = os.path.join(folder, *parts)
            if place not in self._names and os.path.commonpath([os.path.realpath(place), top]) == top:
                with contextlib.suppress(OSError):
                    names = sorted(os.listdir(place))
                    self._names[place] = {name.casefold(): name for name in names} | {name: name for name in names}
            there = self._names.get(place, {})
            spelled = there.get(part) or there.get(part.casefold())
            if spelled is None:
                return reference
            parts.append(spelled)
        return "/".join(parts)

    def texture(self, path: str, wrap: Wrap = "repeat") -> Texture | None:
        """Return the texture of the image in a file, without its alpha, see `decoded`."""
        image = self.at(path, srgb=True)
        if image is not None and image.shape[2] == 4:
            warnings.warn(f"{shown(path)}: image: its alpha channel is left out", stacklevel=2)
        return None if image is None else Texture(image[:, :, :3], wrap=wrap, name=os.path.basename(path))

    def at(self, path: str, *, srgb: bool) -> CodedImage | None:
        """Return the image in a file, see `decoded`."""
        return self.decoded(shown(path), lambda: read_file(path, MAX_BYTES), srgb=srgb)

    def decoded(self, owner: str, read: Callable[[], bytes | memoryview | None], *, srgb: bool) -> CodedImage | None:
        """Return an image as `decode_image` does; None, with a warning, if it cannot be read or decoded.

        owner: its name. read: returns its content, or None if it has already warned of it.
        """
        if (owner, srgb) not in self._images:
            data: bytes | memoryview = b""
            image = None
            try:
                self._count(0)
                data = read() or b""
                image = decode_image(data, owner, srgb=srgb, count=self._count) if data else None
            except InputError as error:
                self._left -= len(data) // _BYTES
                warnings.warn(f"{error}: drawn without it", stacklevel=2)
            self._images[owner, srgb] = image
        return self._images[owner, srgb]

    def _count(self, pixels: int) -> None:
        self._left -= pixels
        if self._left < 0:
            raise file_error(shown(self.scene), "images", f"at most {MAX_PIXELS} pixels in all", "more")


def as_texture(source: Path | ArrayLike | Texture, *, srgb: bool, lookup: Lookup = "standard") -> Texture:
    """Return a Texture from an image file's path, an array (see `Texture`: taken as linear) or a Texture (as it is)."""
    if isinstance(source, Texture):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Texture(read_image(source, srgb=srgb), lookup=lookup, name=os.path.basename(os.fspath(source)))
    return Texture(source, lookup=lookup)
