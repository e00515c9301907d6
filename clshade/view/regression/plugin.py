"""The pytest plugin `clshade`: its options, the fixture `clshade_image_regression`, the summary of what was renewed.

pytest imports this module at the start of every run, so nothing that draws is imported before a test asks for an image.
"""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from . import OUT, REFERENCES, RENEWED, STATES, UPDATE

if TYPE_CHECKING:
    from .image_regression import ImageRegression

_SHORT = "image_regression"  # another name of the fixture, where no other plugin has it


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("clshade", "regression tests of images")
    group.addoption(
        UPDATE,
        action="store_true",
        help="keep the images that the tests draw as their references: missing ones are created, different ones renewed",
    )
    group.addoption(
        OUT,
        metavar="DIR",
        help="folder for the reference, result and difference of each image that differs (default: a temporary one)",
    )
    parser.addini(
        REFERENCES,
        f"whether {UPDATE} keeps an EXR of each image beside its hashes (default: true)",
        type="bool",
        default=True,
    )


class _ShortName:
    @pytest.fixture
    def image_regression(self, clshade_image_regression: ImageRegression) -> ImageRegression:
        """`clshade_image_regression` under a short name; pytest-regressions has a fixture of this name."""
        return clshade_image_regression


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    if not any(hasattr(plugin, _SHORT) for plugin in config.pluginmanager.get_plugins()):
        config.pluginmanager.register(_ShortName(), "clshade-short-name")


@pytest.fixture
def clshade_image_regression(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> ImageRegression:
    """Draw a scene and compare image and layers, bit for bit, with those of an earlier run."""
    from .image_regression import ImageRegression

    out = request.config.getoption(OUT)
    return ImageRegression(
        request.node,
        update=request.config.getoption(UPDATE),
        references=request.config.getini(REFERENCES),
        out=None if out is None else Path(request.config.invocation_params.dir, out),
        temporary=tmp_path_factory.mktemp,
    )


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    reports = chain.from_iterable(terminalreporter.stats.values())
    properties = chain.from_iterable(getattr(report, "user_properties", ()) for report in reports)
    renewed = {tuple(value[1:3]): value for name, value in properties if name == RENEWED}  # library and key
    if not renewed:
        return
    terminalreporter.section("clshade images")
    for _, (state, library, key, remark) in sorted(renewed.items()):
        if state != "unchanged":
            terminalreporter.line(f"{state} {library}: {key}{remark and f' ({remark})'}")
    states = [state for state, *_ in renewed.values()]
    terminalreporter.line(", ".join(f"{states.count(state)} {state}" for state in STATES if state in states))
