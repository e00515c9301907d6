"""Utilities independent of rendering: validation, files, JSON, console, text tables."""
