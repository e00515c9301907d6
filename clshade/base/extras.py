"""How to install an extra of clshade: from the clone or the folder that it was installed from."""

from __future__ import annotations

import json
import shlex
from importlib import metadata
from pathlib import Path
from urllib.parse import unquote, urlsplit

_ROOT = Path(__file__).resolve().parents[2]


def how_to_install(extra: str) -> str:
    """Return the command that installs the extra."""
    if (_ROOT / "pyproject.toml").is_file():
        return _command("." if Path.cwd() == _ROOT else str(_ROOT), extra, "-e ")
    try:
        origin = urlsplit(
            json.loads(metadata.distribution("clshade").read_text("direct_url.json") or "{}").get("url", "")
        )
    except (metadata.PackageNotFoundError, ValueError):
        origin = urlsplit("")
    return _command(unquote(origin.path) if origin.scheme == "file" else "clshade", extra)


def _command(source: str, extra: str, option: str = "") -> str:
    return f"pip install {option}{shlex.quote(f'{source}[{extra}]')}"
