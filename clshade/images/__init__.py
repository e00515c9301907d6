"""Pixels as arrays, files and figures: EXR, PNG, tone mapping, decoding, metrics, statistics, comparison."""
