"""The folder in which the frames of a film, or the tiles of a poster, wait until it is whole: a run that was interrupted
goes on from there."""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Iterator
from typing import Any

from ..base import console, interrupts
from ..base.atomic_files import folder_made, lock_file, naming, shown, write_bytes, write_error
from ..errors import InputError
from ..scene.description import digest_of
from ..scene.settings import FrameOptions

_LOCK = "lock"
_FRAME = re.compile(r"\d{4,}\.(exr|png)")
_TEMPORARY = re.compile(r"\.clshade-[0-9a-f]{16}\.tmp")


class FarmOptions(FrameOptions, total=False):
    """Keywords of `clshade.farm.draw_frames` that say by whom and how frames are drawn, and of `clshade.render`."""

    overwrite: bool
    workers: int
    scheduler: str | None
    timeout: float
    frame_timeout: float | None
    progress: bool
    device: str | None


def split_options(options: FarmOptions) -> tuple[dict[str, Any], FrameOptions]:
    """Split options into keywords of `draw_frames` and keywords of `clshade.render`."""
    settings: Any = {**options}
    names = FarmOptions.__annotations__.keys() - FrameOptions.__annotations__.keys()
    return {name: settings.pop(name) for name in names & settings.keys()}, settings


class FrameFolder:
    """The folder beside a film or a poster, named after it. One process at a time uses it.

    result, parts: what the file is called in messages, and what it is made of, which ends the folder's name.
    """

    def __init__(self, name: str, result: str = "film", parts: str = "frames") -> None:
        self.path = f"{name}.{parts}"
        self._result, self._parts = result, parts
        self._record = os.path.join(self.path, f"{result}.json")  # what the frames show
        self.pattern = os.path.join(self.path, "####.exr")
        self._lock: int | None = None

    @property
    def kept(self) -> bool:
        """Whether an earlier run kept the frames."""
        return (self._read() or {}).get("kept") is True

    @contextlib.contextmanager
    def of(self, content: Any, kept: bool) -> Iterator[None]:
        """Make the folder for frames that depend on `content`, see `digest_of`; frames of another content are removed.

        When the block ends without an error, the frames are removed unless they are `kept`; a folder without frames is
        always removed. Raises InputError if the folder has other files, OutputError if it cannot be written or another
        process draws the same file.
        """
        record = {"digest": digest_of(content), "kept": kept}
        if os.path.exists(self.path) and not os.path.isdir(self.path):
            raise write_error(self.path, "it is not a folder")
        with folder_made(self.path):
            try:
                self._lock = lock_file(os.path.join(self.path, _LOCK))
            except OSError:
                pass  # the file system has no locks
            else:
                if self._lock is None:
                    raise write_error(self.path, f"another process draws this {self._result}")
            try:
                with naming(self.path):
                    self._prepare(record)
                _in_use.add(self)
                yield
                if not kept:
                    self._remove()
            finally:
                self.remove_if_empty()
                self._release()
                _in_use.discard(self)

    def _release(self) -> None:
        lock, self._lock = self._lock, None
        if lock is not None:
            with contextlib.suppress(OSError):
                os.close(lock)
                os.unlink(os.path.join(self.path, _LOCK))

    def _prepare(self, record: dict[str, Any]) -> None:
        names = [name for name in os.listdir(self.path) if name != _LOCK and not _TEMPORARY.fullmatch(name)]
        earlier = self._read()
        if names and earlier is None:
            expected = f"a folder with {self._parts} of this {self._result}, or none"
            raise InputError(f"{shown(self.path)}: expected {expected}, found other files")
        if earlier is None or earlier.get("digest") != record["digest"]:
            if any(map(_FRAME.fullmatch, names)):
                console.progress(f"{shown(self.path)}: {self._parts} of another scene or other settings: drawn again")
            self._remove_frames()
        if earlier != record:
            write_bytes(self._record, json.dumps(record).encode() + b"\n")

    def _read(self) -> dict[str, Any] | None:
        """Return the record, an empty one if it is damaged, None if there is none."""
        try:
            with open(self._record, "rb") as file:
                record = json.loads(file.read(1 << 12))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, ValueError):
            return {}
        return record if isinstance(record, dict) else {}

    def _remove_frames(self) -> None:
        """Remove the frames, and half-written ones, which a killed process left."""
        for name in os.listdir(self.path):
            if _FRAME.fullmatch(name) or _TEMPORARY.fullmatch(name):
                os.unlink(os.path.join(self.path, name))

    def remove_if_empty(self) -> None:
        """Remove the folder if it has no frames."""
        with contextlib.suppress(OSError):
            if not any(map(_FRAME.fullmatch, os.listdir(self.path))):
                self._remove()

    def _remove(self) -> None:
        """Remove the frames, and the folder unless it has other files."""
        with contextlib.suppress(OSError):
            self._remove_frames()
            os.unlink(self._record)
            self._release()
            os.rmdir(self.path)


_in_use: set[FrameFolder] = set()


@interrupts.at_end
def _remove_empty_ones() -> None:
    for folder in list(_in_use):
        folder.remove_if_empty()
