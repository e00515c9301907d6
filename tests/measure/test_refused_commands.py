"""Refused command lines of reports, measurements and judges: nothing is measured, and no file is made or changed."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import assert_refused, listing, run

from clshade.measure.bench import bench
from clshade.measure.report import report

# Command line, parts of its message
REFUSED = [
    ("bench object-1024", "workload", "'object-1024'", "did you mean 'object-"),
    ("bench quads --samples 4", "--samples", "'quads'", "workload"),
    ("bench --against lvmpipe", "--against", "'lvmpipe'", "'llvmpipe'"),
    ("bench -o file/x", "file", "not a folder"),
    ("conform --only operation", "--only", "did you mean 'operations'?"),
    ("conform --device none_such", "'none_such'"),
    ("grade file course --html x.html", "--html"),
    ("grade --list x.png", "IMAGE: expected none with --list, found 'x.png'"),
    ("grade x.png course --look studio", "--look: the right image is drawn as --preset says"),
    ("render --check 1e4", "expected a number of pixels or all"),
    ("report icosphere --only guro", "--only", "standard", "'guro'"),
    ("report icosphere --format png,gif", "--format", "png, pdf, svg", "'gif'"),
    ("report icosphere --out figure.pdf", "--out", "expected a folder", "--format pdf"),
    ("report icosphere --budget -3", "--budget", "'-3'"),
    ("report icosphere --budget 5ms --tolerance 1e-3", "--tolerance", "not allowed with", "--budget"),
    ("report icosphere --out file/x", "file/x", "--out"),
    ("report icosphere --out full", "report.json"),
    ("report teapot --course", "--course: expected a course scene"),
    ("report course --course -o a.pdf", "a browser prints the page as PDF"),
    ("report course --course -o no/a.html", "there is no folder"),
    ("report course --course --no-shadows", "--no-shadows: cannot go with --course"),
    ("stability --case nothing", "--case: expected names or numbers of shared-edges", "'nothing'"),
    ("stability --case 6 --format pdf", "--format", "--case"),
    ("stability --case 6 --out file/x", "file/x", "--out"),
    ("stability no_such_scene", "SCENE: expected a file or one of teapot", "'no_such_scene'"),
    ("stability --samples 4", "--samples: needs a SCENE"),
]


@pytest.mark.usefixtures("opened")
@pytest.mark.parametrize("row", REFUSED, ids=[row[0] for row in REFUSED])
def test_refused(folder, capsys, monkeypatch, row):
    for module, name in ((report, "study"), (bench, "measure")):
        monkeypatch.setattr(module, name, lambda *arguments: pytest.fail("something was measured"))
    Path("file").touch()
    Path("full/report.json").mkdir(parents=True)
    command, *parts = row
    assert_refused(run(capsys, *command.split()), *parts)
    assert listing(folder) == ["file", "full", "full/report.json"]
