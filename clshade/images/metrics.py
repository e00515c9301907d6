"""How far an image is from a reference, in the field's usual measures. Images are (M, N, 3), linear, any floats."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.json_values import plain
from ..base.validation import value_error
from .tonemap import srgb_curve

# Of relMSE: keeps black pixels from dividing by 0; a hundredth of white, as is usual.
RELATIVE_FLOOR = 1e-2
SSIM_WINDOW = 11  # pixels


@dataclass(frozen=True)
class ImageError:
    """What `image_error` found.

    rmse: root of the mean squared difference, over pixels and channels, in units of radiance (display white is 1).
    relmse: mean of squared difference / (squared reference + 1e-4).
    psnr: decibels, of the images as they are seen: held to [0, 1] and encoded by the sRGB curve. Infinite for equal ones.
    flip: mean of FLIP over the image, 0 to 1, of the same encoded images; None where `flip-evaluator` is not installed.
    """

    rmse: float
    relmse: float
    psnr: float
    flip: float | None

    def stats(self) -> dict[str, float | None]:
        """The figures, as JSON takes them: null for the infinite PSNR of equal images."""
        figures: dict[str, float | None] = plain(vars(self))
        return figures


def rmse(image: Array, reference: Array) -> float:
    return math.sqrt(float(np.mean(_squared(image, reference))))


def relmse(image: Array, reference: Array) -> float:
    scale = np.square(np.asarray(reference, np.float64)) + RELATIVE_FLOOR**2
    return float(np.mean(_squared(image, reference) / scale))


def psnr(image: Array, reference: Array) -> float:
    return decibels(float(np.mean(_squared(seen(image), seen(reference)))))


def flip(image: Array, reference: Array) -> float | None:
    return flip_of_seen(seen(image), seen(reference))


def decibels(squared: float) -> float:
    """PSNR of a mean squared difference of values from 0 to 1; infinite for none."""
    return -10.0 * math.log10(squared) if squared else math.inf


def flip_of_seen(image: Array, reference: Array) -> float | None:
    """Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020, at 67 pixels per degree: the mean
    over encoded images from 0 to 1. None without `flip-evaluator`."""
    if not has_flip():
        return None
    if np.array_equal(image, reference):  # takes seconds a megapixel otherwise
        return 0.0
    import flip_evaluator

    both = (np.ascontiguousarray(each, dtype=np.float32) for each in (reference, image))
    return float(flip_evaluator.evaluate(*both, "LDR", applyMagma=False)[1])


def ssim_of_seen(image: Array, reference: Array) -> float | None:
    """Wang et al., "Image Quality Assessment: From Error Visibility to Structural Similarity", 2004: the mean over encoded
    images from 0 to 1, Gaussian windows of 11x11 pixels. None without `scikit-image`, and for smaller images."""
    if not has_ssim() or min(image.shape[:2]) < SSIM_WINDOW:
        return None
    if np.array_equal(image, reference):
        return 1.0
    from skimage.metrics import structural_similarity

    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}  # the authors' own
    return float(structural_similarity(image, reference, data_range=1.0, channel_axis=2, **options))


def has_flip() -> bool:
    """Whether `flip-evaluator` is installed (clshade's extras `report` and `compare`)."""
    return importlib.util.find_spec("flip_evaluator") is not None


def has_ssim() -> bool:
    """Whether `scikit-image` is installed (clshade's extra `compare`)."""
    return importlib.util.find_spec("skimage") is not None


def image_error(image: Array, reference: Array) -> ImageError:
    """All measures. Raises InputError for images of different sizes."""
    if image.shape != reference.shape:
        raise value_error("image_error", "image", f"the reference's shape {reference.shape}", image)
    return ImageError(rmse(image, reference), relmse(image, reference), psnr(image, reference), flip(image, reference))


def _squared(image: Array, reference: Any) -> Array:
    return np.square(np.asarray(image, np.float64) - np.asarray(reference, np.float64))


def seen(image: Array) -> Array:
    """A linear image as a display shows it: held to [0, 1], NaN 0, and encoded by the sRGB curve."""
    return srgb_curve(np.clip(np.nan_to_num(np.asarray(image, np.float64)), 0.0, 1.0))
