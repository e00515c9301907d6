"""Pixels as arrays, files and figures: EXR, PNG, tone maps, decoding, metrics, statistics, comparison."""
