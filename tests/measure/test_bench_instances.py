"""`bench --instances`: its table, its files, and failure if both ways differ in their bits."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from devices import working_devices

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.measure.bench import instances, instances_apart
from clshade.measure.bench.instances import InstanceTiming


def timing(way: str, count: int, mib: float | None, digest: str = "same") -> InstanceTiming:
    return InstanceTiming(way, count, 80 * count, 50 * count, 0.5, 1.5, 20.0, mib, digest)


@pytest.fixture
def fake(monkeypatch):
    """Each instance takes 1 KiB from one copy, 8 KiB from copies, beyond 1000 MiB."""

    def drawn(way, count, device, frames):
        return timing(way, count, 1000.0 + (count - 2) * (1 if way == "one" else 8) / 1024.0)

    monkeypatch.setattr(instances, "_draw", drawn)


def test_what_each_instance_takes(fake, tmp_path):
    out, prefix = io.StringIO(), str(tmp_path / "many")
    assert instances.run((1_000_002, 1002), frames=1, out=prefix, stream=out)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"many.{kind}" for kind in ("csv", "json", "md", "png")]
    rows = [line.split(",") for line in Path(f"{prefix}.csv").read_text().replace('"', "").splitlines()]
    assert len(rows) == 7
    found = json.loads(Path(f"{prefix}.json").read_text())["timings"]
    assert [(each["instances"], each["way"]) for each in found] == [
        (count, way) for count in (2, 1002, 1_000_002) for way in ("one", "many")
    ]
    # 8 MiB of 1002 copies are within the noise.
    measured = instances.ManyInstances("", tuple(InstanceTiming(**each) for each in found))
    assert [row[8] for row in measured.rows()] == ["-", "-", "-", "-", "1,024", "8,192"]
    assert [row[9] for row in measured.rows()[-2:]] == ["12.8", "102"]
    assert out.getvalue().count(" yes") == 6


def test_other_bits_fail(monkeypatch):
    monkeypatch.setattr(instances, "_draw", lambda way, count, *_: timing(way, count, None, way if count > 2 else ""))
    out = io.StringIO()
    assert not instances.run((1000,), frames=1, stream=out)
    assert out.getvalue().count(" NO") == 2


def test_refusals(capsys):
    with pytest.raises(InputError, match="more than 2 instances"):
        instances.run((2,), frames=1)
    for further in (("quads",), ("--targets",), ("--scaling",), ("--peers", "none"), ("--turn", "3")):
        assert main(["bench", *further, "--instances", "1000"]) == 2
        assert "either --instances" in capsys.readouterr().err
    assert main(["bench", "--instances", "many"]) == 2


def test_instances_of_the_bench_do_not_overlap():
    matrices, side = instances_apart.placements(1000)
    assert side == 10
    assert len(np.unique(matrices[:, :3, 3], axis=0)) == 1000
    lengths = np.linalg.norm(matrices[:, :3, :3], axis=1)
    assert lengths.max() <= 0.35 + 1e-12
    assert np.allclose(lengths, lengths[:, :1])


@pytest.mark.long
@pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")
def test_a_hundred_instances_each_way():
    out = io.StringIO()
    assert instances.run((100,), frames=2, stream=out)
    assert "8,000" in out.getvalue()
