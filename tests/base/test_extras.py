"""Hints on extras name what works where clshade was installed from."""

from __future__ import annotations

import json
from importlib import metadata
from types import SimpleNamespace

import pytest
from processes import ROOT

from clshade.base import extras


def test_in_a_clone(monkeypatch, tmp_path):
    monkeypatch.chdir(ROOT)
    assert extras.how_to_install("film") == "pip install -e '.[film]'"
    monkeypatch.chdir(tmp_path)
    assert extras.how_to_install("film") == f"pip install -e '{ROOT}[film]'"


@pytest.mark.parametrize(
    ("origin", "source"),
    [
        ({"url": "file:///home/me/my%20clone", "dir_info": {}}, "/home/me/my clone"),
        ({"url": "https://example.org/clshade.whl"}, "clshade"),
        (None, "clshade"),
    ],
)
def test_installed_from_somewhere(monkeypatch, tmp_path, origin, source):
    monkeypatch.setattr(extras, "_ROOT", tmp_path)
    distribution = SimpleNamespace(read_text=lambda name: origin and json.dumps(origin))
    monkeypatch.setattr(metadata, "distribution", lambda name: distribution)
    assert extras.how_to_install("view") == f"pip install '{source}[view]'"


def test_not_installed(monkeypatch, tmp_path):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(extras, "_ROOT", tmp_path)
    monkeypatch.setattr(metadata, "distribution", missing)
    assert extras.how_to_install("view") == "pip install 'clshade[view]'"
