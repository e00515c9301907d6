"""Every struct of struct_layout.py has the same size and offsets on the device, with float32 and with float64 reals,
and every constant the same value."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_stages import Probe

from clshade.pipeline import struct_layout
from clshade.scene import model


def struct_text(name: str, dtype: np.dtype) -> str:
    """Return a kernel that writes the size of a struct, then each member's offset."""
    lines = ["out[0] = sizeof(struct_t);"]
    for i, member in enumerate(dtype.names, 1):
        lines.append(f"out[{i}] = (int)((private char *)&s.{member} - (private char *)&s);")
    body = " ".join(lines).replace("struct_t", name)
    return f"kernel void {name.lower()}(global const float *unused, global int *out) {{ {name} s; {body} }}\n"


STRUCTS = {
    kind: {n: t for n, t in s._asdict().items() if n != "real"}
    for kind, s in enumerate((struct_layout.SINGLE, struct_layout.DOUBLE))
}
EACH = [(kind, name) for kind, structs in STRUCTS.items() for name in structs]


@pytest.fixture(scope="module")
def probes(device):
    """Return a probe with float32 reals and one with float64 reals."""
    text = "".join(struct_text(name, dtype) for name, dtype in STRUCTS[0].items())
    values = " ".join(f"out[{i}] = {name};" for i, name in enumerate(struct_layout.CONSTANTS))
    text += f"kernel void constants(global const float *unused, global float *out) {{ {values} }}"
    return [Probe(device, text, DOUBLE=kind) for kind in STRUCTS]


def single(probe, name: str, count: int, dtype: type = np.int32) -> list:
    """Return the output of a single work-item; all write the same."""
    return probe(name, np.zeros(128, np.float32), dtype=dtype)[:count].tolist()


@pytest.mark.sampled
@pytest.mark.parametrize(("kind", "name"), EACH)
def test_sizes_and_offsets(probes, kind, name):
    dtype = STRUCTS[kind][name]
    offsets = [dtype.fields[member][1] for member in dtype.names]
    assert single(probes[kind], name.lower(), 1 + len(offsets)) == [dtype.itemsize, *offsets]


def test_constants(probes):
    """As float32, in which all of them are exact."""
    assert single(probes[0], "constants", len(struct_layout.CONSTANTS), np.float32) == list(
        struct_layout.CONSTANTS.values()
    )


def test_settings_allow_as_many_samples_as_the_structs_hold():
    assert model.MAX_SAMPLES == struct_layout.MOST_SAMPLES


@pytest.mark.parametrize(("kind", "name"), EACH)
def test_rows_keep_their_alignment(kind, name):
    """Row k of a table begins at k * itemsize, a multiple of 8 if a member needs that."""
    dtype = STRUCTS[kind][name]
    assert dtype.itemsize % (8 if any(dtype[member].base == np.float64 for member in dtype.names) else 4) == 0


def test_a_header_for_devices_without_double():
    header = struct_layout.header(with_double=False)
    assert "double" not in header
    assert header.count("} ") == struct_layout.header().count("} ")
