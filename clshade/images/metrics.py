"""Standard measures of image error. Images are (M, N, 3), linear, of any float type."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array
from ..base.json_values import plain
from ..base.validation import value_error
from .tonemap import srgb_curve

# Of relMSE, against division by 0 in black pixels; a hundredth of white, as is usual.
RELATIVE_FLOOR = 1e-2
SSIM_WINDOW = 11  # pixels


@dataclass(frozen=True)
class ImageError:
    """The result of `image_error`."""

    rmse: float  # root mean squared error over pixels and channels, in units of radiance (display white is 1)
    relmse: float  # mean of squared error / (squared reference + 1e-4)
    psnr: float  # decibels, of the display images: clamped to [0, 1] and sRGB-encoded; infinite for equal ones
    flip: float | None  # mean of FLIP of these images, 0 to 1; None if `flip-evaluator` is not installed

    def stats(self) -> dict[str, float | None]:
        """Return the figures for JSON: null for the infinite PSNR of equal images."""
        return {**plain(vars(self))}


def image_error(image: Array, reference: Array) -> ImageError:
    """Return all measures. Raises InputError for images of different sizes."""
    if image.shape != reference.shape:
        raise value_error("image_error", "image", f"the reference's shape {reference.shape}", image)
    shown = seen(image), seen(reference)
    psnr = decibels(float(np.mean(np.square(shown[0] - shown[1]))))
    return ImageError(rmse(image, reference), relmse(image, reference), psnr, flip_of_seen(*shown))


def rms(difference: Array) -> float:
    """Return the root mean square."""
    return math.sqrt(float(np.mean(np.square(difference, dtype=np.float64))))


def rmse(image: Array, reference: Array) -> float:
    return rms(np.subtract(image, reference, dtype=np.float64))


def relmse(image: Array, reference: Array) -> float:
    squared = np.square(np.subtract(image, reference, dtype=np.float64))
    return float(np.mean(squared / (np.square(np.asarray(reference, np.float64)) + RELATIVE_FLOOR**2)))


def scale_end(difference: Array) -> float:
    """Return where a scale of colors for differences, 0 or more, ends: 98 % of those above 0 are within; 1 without any."""
    positive = difference[difference > 0.0]
    return float(np.quantile(positive, 0.98)) if positive.size else 1.0


def seen(image: Array) -> Array:
    """Return a linear image as a display shows it: clamped to [0, 1], NaN 0, and sRGB-encoded."""
    return srgb_curve(np.clip(np.nan_to_num(np.asarray(image, np.float64)), 0.0, 1.0))


def decibels(squared: float) -> float:
    """Return the PSNR for a mean squared error of values from 0 to 1; infinite for 0."""
    return -10.0 * math.log10(squared) if squared else math.inf


def has_flip() -> bool:
    """Return whether `flip-evaluator` is installed (clshade's extras `report` and `compare`)."""
    return importlib.util.find_spec("flip_evaluator") is not None


def flip_of_seen(image: Array, reference: Array) -> float | None:
    """Return the mean FLIP of encoded images from 0 to 1, at 67 pixels per degree. None without `flip-evaluator`.

    Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020.
    """
    if not has_flip():
        return None
    if np.array_equal(image, reference):  # otherwise seconds per megapixel
        return 0.0
    import flip_evaluator

    both = (np.ascontiguousarray(pixels, dtype=np.float32) for pixels in (reference, image))
    return float(flip_evaluator.evaluate(*both, "LDR", applyMagma=False)[1])


def has_ssim() -> bool:
    """Return whether `scikit-image` is installed (clshade's extra `compare`)."""
    return importlib.util.find_spec("skimage") is not None


def ssim_of_seen(image: Array, reference: Array) -> float | None:
    """Return the mean SSIM of encoded images from 0 to 1, with Gaussian windows of 11x11 pixels.

    Wang et al., "Image Quality Assessment: From Error Visibility to Structural Similarity", 2004. None without
    `scikit-image`, and for smaller images.
    """
    if not has_ssim() or min(image.shape[:2]) < SSIM_WINDOW:
        return None
    if np.array_equal(image, reference):
        return 1.0
    from skimage.metrics import structural_similarity

    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}  # as in the paper
    return float(structural_similarity(image, reference, data_range=1.0, channel_axis=2, **options))
