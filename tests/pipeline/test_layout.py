"""Every struct of kernels/structs.h has the same size and offsets on the device, with float32 and with float64 reals,
and every constant the same value."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.measure.conform import structs
from clshade.measure.conform.case import Bench
from clshade.pipeline import struct_layout
from clshade.scene import settings

STRUCTS = {kind: s.types for kind, s in enumerate((struct_layout.SINGLE, struct_layout.DOUBLE))}
EACH = [(kind, name) for kind, structs in STRUCTS.items() for name in structs]


def test_sizes_and_offsets(device):
    """And the constants, as float32, in which all of them are exact."""
    bench, cases = Bench(device), structs.cases(device.has_fp64)
    assert len(cases) == (1 + device.has_fp64) * len(STRUCTS[0]) + 1
    for case in cases:
        wrong = bench.wrong(case)
        assert wrong is None, f"{case.title}: {wrong}"


def test_settings_allow_as_many_samples_as_the_structs_hold():
    assert settings.MAX_SAMPLES == struct_layout.MOST_SAMPLES


@pytest.mark.parametrize(("kind", "name"), EACH)
def test_rows_keep_their_alignment(kind, name):
    """Row k of a table begins at k * itemsize, a multiple of 8 if a member needs that."""
    dtype = STRUCTS[kind][name]
    assert dtype.itemsize % (8 if any(dtype[member].base == np.float64 for member in dtype.names) else 4) == 0


def test_a_header_for_devices_without_double():
    header = struct_layout.header(with_double=False)
    assert "double" not in header
    assert header.count("} ") == struct_layout.header().count("} ")
