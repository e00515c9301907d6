"""Regression tests of images for projects that use clshade: a pytest plugin with the fixture
`clshade_image_regression`."""

from __future__ import annotations

FIXTURE = "clshade_image_regression"
UPDATE, OUT = "--clshade-update", "--clshade-out"
REFERENCES = "clshade_reference_images"  # in pytest's configuration file
RENEWED = "clshade_image"  # property of a test's report: state, library, key, remark; pytest-xdist sends it along
STATES = ("created", "updated", "unchanged")
