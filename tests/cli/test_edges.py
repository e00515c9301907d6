"""Options for edges drawn as lines."""

from __future__ import annotations

import pytest
from command_line import needs_device, run

from clshade.cli.main import _parser
from clshade.cli.scene import chosen_settings
from clshade.images import exr
from clshade.scene.edges import Edges


def chosen(*options: str) -> Edges | None:
    arguments = ["render", *options]
    return chosen_settings(_parser(arguments).parse_args(arguments)).get("edges")


def test_options_become_edges():
    assert chosen() is None
    assert chosen("--edges", "silhouette,feature") == Edges(("feature", "silhouette"))
    options = ("--edges", "all", "--edge-angle", "45", "--edge-width", "2", "--edge-color", "1,0.5,0", "--edges-only")
    assert chosen(*options) == Edges("all", angle=45, width=2, color=(1, 0.5, 0), only=True)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--edge-width", "3"), "--edge-width: needs --edges"),
        (("--edges-only",), "--edges-only: needs --edges"),
        (("--edges", "all", "--edge-color", "0,0,-1"), "--edge-color: expected a name such as white, #rrggbb"),
    ],
)
def test_refused_options(capsys, tmp_path, options, expected):
    code, out, lines = run(capsys, "render", "quads", *options, "-o", tmp_path / "out")
    assert (code, out, len(lines)) == (2, "", 1)
    assert expected in lines[0]
    assert not list(tmp_path.iterdir())


@pytest.mark.long
@needs_device
def test_only_files_with_edges_name_them(capsys, tmp_path):
    for name, options in (("plain", ()), ("lined", ("--edges", "all"))):
        assert run(capsys, "render", "quads", "--resolution", "32,24", *options, "-o", tmp_path / name)[0] == 0
    found = {name: exr.read(tmp_path / f"{name}.exr")[1]["settings"] for name in ("plain", "lined")}
    assert "edges" not in found["plain"]
    assert "edges=Edges(kinds=('all',)" in found["lined"]
