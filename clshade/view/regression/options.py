"""Names of the plugin's options, which command lines, configuration files and messages share."""

from __future__ import annotations

FIXTURE = "clshade_image_regression"
UPDATE, OUT = "--clshade-update", "--clshade-out"
REFERENCES = "clshade_reference_images"  # in pytest's configuration file
RENEWED = "clshade_image"  # property of a test's report: state, library, key, remark; pytest-xdist sends it along
STATES = ("created", "updated", "unchanged")
