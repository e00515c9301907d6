"""The folder in which a film's frames wait until it is whole: a run that was interrupted goes on from there."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import pickle
import re
from collections.abc import Iterator
from typing import Any

from ..base import console, interrupts
from ..base.atomic_files import folder_made, naming, shown, write_bytes, write_error
from ..errors import InputError

ENDING = ".frames"  # of the folder, after the film's name
_RECORD = "film.json"  # which film the frames are of
_FRAME = re.compile(r"\d{4,}\.(exr|png)")
_TEMPORARY = re.compile(r"\.clshade-[0-9a-f]{16}\.tmp")


def digest_of(*values: Any) -> str:
    """Return a digest of what frames depend on. Equal values have equal digests in every process, if they came about in
    the same way; two that differ for another reason only cost a second drawing."""
    sink = _Digest()
    pickle.Pickler(sink, protocol=5).dump(values)
    return sink.hash.hexdigest()


class _Digest:
    def __init__(self) -> None:
        self.hash = hashlib.sha256()

    def write(self, data: Any) -> int:
        self.hash.update(data)
        return memoryview(data).nbytes


class FrameFolder:
    """The folder beside a film, named after it."""

    def __init__(self, film: str) -> None:
        self.path = film + ENDING
        self.pattern = os.path.join(self.path, "####.exr")

    @property
    def kept(self) -> bool:
        """Whether an earlier run was told to keep the frames."""
        return (self._read() or {}).get("kept") is True

    @contextlib.contextmanager
    def of(self, digest: str, kept: bool) -> Iterator[None]:
        """Make the folder for frames of this digest; those of another one are removed. If there are no frames at the end
        of the block, the folder is removed, too. kept: frames that are to stay when the film is whole.

        Raises InputError if the folder has other files, OutputError if it cannot be written.
        """
        if os.path.exists(self.path) and not os.path.isdir(self.path):
            raise write_error(self.path, "it is not a folder")
        with folder_made(self.path):
            with naming(self.path):
                self._prepare({"digest": digest, "kept": kept})
            _in_use.add(self)
            try:
                yield
            finally:
                self.remove_if_empty()
                _in_use.discard(self)

    def _prepare(self, record: dict[str, Any]) -> None:
        names = [name for name in os.listdir(self.path) if not _TEMPORARY.fullmatch(name)]
        found = self._read()
        if names and found is None:
            expected = "a folder with frames of this film, or none"
            raise InputError(f"{shown(self.path)}: expected {expected}, found other files")
        if found is None or found.get("digest") != record["digest"]:
            if any(map(_FRAME.fullmatch, names)):
                console.progress(f"{shown(self.path)}: frames of another scene or other settings: drawn again")
            self._remove_frames()
        if found != record:
            write_bytes(self._record, json.dumps(record).encode() + b"\n")

    @property
    def _record(self) -> str:
        return os.path.join(self.path, _RECORD)

    def _read(self) -> dict[str, Any] | None:
        """Return what the record says, nothing if it is damaged, None if there is none."""
        try:
            with open(self._record, "rb") as file:
                found = json.loads(file.read(1 << 12))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _remove_frames(self) -> None:
        for name in os.listdir(self.path):
            if _FRAME.fullmatch(name):
                os.unlink(os.path.join(self.path, name))

    def remove_if_empty(self) -> None:
        """Remove the folder if it has no frames."""
        if not any(map(_FRAME.fullmatch, os.listdir(self.path))):
            self.remove()

    def remove(self) -> None:
        """Remove the frames, and the folder unless it has other files."""
        with contextlib.suppress(OSError):
            self._remove_frames()
            os.unlink(self._record)
            os.rmdir(self.path)


_in_use: set[FrameFolder] = set()


@interrupts.at_end
def _remove_empty_ones() -> None:
    for folder in list(_in_use):
        folder.remove_if_empty()
