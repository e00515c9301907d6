"""Scenes and their sources: model, camera, built-in scenes, file formats."""
