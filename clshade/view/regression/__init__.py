"""Regression tests of images for projects that use clshade: a pytest plugin with the fixture
`clshade_image_regression`."""
