"""Arrays on disk, by what they are computed from."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.pipeline import shading_tables

ROW = np.zeros(2, [("a", "i4"), ("b", "f4", 3)])
TABLE = np.arange(12.0, dtype=np.float32).reshape(3, 4)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(shading_tables, "cache_root", lambda: tmp_path)
    return tmp_path / "tables"


def computed(code, *inputs: bytes) -> int:
    """Ask for arrays; return how often they were computed."""
    calls = []

    def compute():
        calls.append(1)
        return ROW, TABLE

    row, table = shading_tables.kept([code], inputs, compute)
    assert (row.dtype, row.tobytes()) == (ROW.dtype, ROW.tobytes())
    assert table.dtype == np.float32
    assert np.array_equal(table, TABLE)
    return len(calls)


def test_equal_inputs_and_code_are_computed_once(folder, tmp_path):
    code = tmp_path / "code.py"
    code.write_text("one")
    assert [computed(code, *inputs) for inputs in ([b"ab"], [b"ab"], [b"a", b"b"], [b"ab"])] == [1, 0, 1, 0]
    code.write_text("two")
    assert [computed(code, b"ab"), computed(code, b"ab")] == [1, 0]


@pytest.mark.parametrize("place", [0, 40, 200, -40, -1])
def test_damaged_files_are_computed_again(folder, tmp_path, place):
    code = tmp_path / "code.py"
    code.write_text("")
    computed(code)
    (path,) = folder.iterdir()
    data = bytearray(path.read_bytes())
    for damaged in (data[:place], data[:place] + bytes([data[place] ^ 0x55]) + data[place:][1:]):
        path.write_bytes(damaged)
        computed(code)
    assert computed(code) == 0


def test_without_a_folder_arrays_are_computed_each_time(folder, tmp_path):
    folder.write_text("a file")
    assert [computed(tmp_path / "none.py") for _ in range(2)] == [1, 1]
    assert [computed(folder) for _ in range(2)] == [1, 1]


def test_only_the_last_files_are_kept(folder, tmp_path):
    code = tmp_path / "code.py"
    code.write_text("")
    for k in range(11):
        computed(code, bytes([k]))
    assert len(list(folder.iterdir())) == 8
    assert computed(code, bytes([10])) == 0
