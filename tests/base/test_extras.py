"""Hints on extras name what works where clshade was installed from."""

import json
from importlib import metadata
from types import SimpleNamespace

import pytest
from processes import ROOT

from clshade.base import extras


def test_in_a_clone(monkeypatch, tmp_path):
    for folder, source in ((ROOT, "."), (tmp_path, ROOT)):
        monkeypatch.chdir(folder)
        assert extras.how_to_install("film") == f"pip install -e '{source}[film]'"


@pytest.mark.parametrize(
    ("origin", "source"),
    [
        ({"url": "file:///home/me/my%20clone", "dir_info": {}}, "/home/me/my clone"),
        ({"url": "https://example.org/clshade.whl"}, "clshade"),
        (None, "clshade"),
        (metadata.PackageNotFoundError("clshade"), "clshade"),
    ],
)
def test_installed_from_somewhere(monkeypatch, tmp_path, origin, source):
    def distribution(name):
        if isinstance(origin, Exception):
            raise origin
        return SimpleNamespace(read_text=lambda name: origin and json.dumps(origin))

    monkeypatch.setattr(extras, "_ROOT", tmp_path)
    monkeypatch.setattr(metadata, "distribution", distribution)
    assert extras.how_to_install("view") == f"pip install '{source}[view]'"
