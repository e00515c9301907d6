"""Measurements of images and runs: check, report, stability, bench."""
