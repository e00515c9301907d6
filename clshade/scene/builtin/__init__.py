"""Scenes made in code."""
