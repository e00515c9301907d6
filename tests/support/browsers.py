"""Headless Chromium, and pages in it that record what goes wrong."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
WITHOUT_GL = ("--disable-gpu", "--disable-3d-apis")
READY_MS = 60_000  # a loaded machine takes seconds to compile shaders


@contextlib.contextmanager
def chromium() -> Iterator[Callable[..., Any]]:
    """Yield a function that starts a browser with the given arguments; skip the test where there is none.

    Within the block asyncio takes this thread's loop for a running one.
    """
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    executable = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if executable is None:
        pytest.skip("Chromium is not installed")
    with api.sync_playwright() as playwright:
        yield lambda *arguments: playwright.chromium.launch(
            executable_path=executable, args=["--no-sandbox", *arguments]
        )


def opened(browser: Any, path: Path, width: int = 640, height: int = 400) -> Any:
    """Open a page from a file and wait until it has drawn; `page.faults` gets its errors, requests and dialogs."""
    page = browser.new_page(viewport={"width": width, "height": height})
    page.faults = []
    page.on("console", lambda message: page.faults.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("dialog", lambda dialog: (page.faults.append(dialog.message), dialog.dismiss()))
    page.on("request", lambda request: request.url.startswith(("file:", "data:")) or page.faults.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready]", timeout=READY_MS, state="attached")
    return page


def until(page: Any, expression: str) -> Any:
    """Return the first true value of an expression. (Playwright's own function needs `eval`, which pages forbid.)"""
    ends = time.monotonic() + READY_MS / 1e3
    while time.monotonic() < ends:
        answer = page.evaluate(expression)
        if answer:
            return answer
        page.wait_for_timeout(20)
    raise AssertionError(f"never true: {expression}")
