"""The style of pages."""

from __future__ import annotations

from ..results import STYLE as STYLE
