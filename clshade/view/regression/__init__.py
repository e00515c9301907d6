"""Regression tests of images for projects that use clshade: a pytest plugin with the fixture `image_regression`."""
