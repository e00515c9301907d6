"""Knows nothing about rendering: validation, files, JSON, console, text tables."""
