"""The mistakes that are modeled, in the order in which they are preferred where several give the same image."""

from . import coverage, image, lights, terms, textures

MISTAKES = (
    *image.PLACES,
    *coverage.MISTAKES,
    *lights.MISTAKES,
    *terms.MISTAKES,
    *textures.MISTAKES,
    *image.VALUES,
)
