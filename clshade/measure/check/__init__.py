"""The error of one image: pixels of it against the float64 oracle, within derived bounds."""
