"""How to install an extra of clshade: from the clone or the folder that it was installed from."""

from __future__ import annotations

import contextlib
import json
import shlex
from importlib import metadata
from pathlib import Path
from urllib.parse import unquote, urlsplit

_ROOT = Path(__file__).resolve().parents[2]


def how_to_install(extra: str) -> str:
    source, option = "clshade", ""
    if (_ROOT / "pyproject.toml").is_file():
        source, option = "." if Path.cwd() == _ROOT else str(_ROOT), "-e "
    else:
        with contextlib.suppress(metadata.PackageNotFoundError, ValueError):
            text = metadata.distribution("clshade").read_text("direct_url.json") or "{}"
            origin = urlsplit(json.loads(text).get("url", ""))
            source = unquote(origin.path) if origin.scheme == "file" else source
    return f"pip install {option}{shlex.quote(f'{source}[{extra}]')}"
