"""The error of one image: its pixels compared with the float64 oracle, within derived bounds."""
