from __future__ import annotations

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

WINDOW = 11
_SIGMA = 1.5
_K1, _K2 = 0.01, 0.03


def ssim(a: Floats, b: Floats, peak: float = 255.0) -> float:
    """Return the mean structural similarity of two images, without downsampling (Wang et al. 2004).

    Parameters
    ----------
    a, b
        Grey images (h, w).
    peak
        Largest grey value.

    Returns
    -------
    float
        Similarity, which is 1 for equal images.

    Raises
    ------
    InputError
        The images differ in size, or are smaller than the window.
    """
    if a.shape != b.shape or min(a.shape) < WINDOW:
        raise InputError(
            f"SSIM: images must be of one size, {WINDOW} pixels or more, not {a.shape}, {b.shape}"
        )
    mean_a, mean_b = _smoothed(a), _smoothed(b)
    variance_a = _smoothed(a * a) - mean_a**2
    variance_b = _smoothed(b * b) - mean_b**2
    covariance = _smoothed(a * b) - mean_a * mean_b
    c1, c2 = (_K1 * peak) ** 2, (_K2 * peak) ** 2
    top = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    bottom = (mean_a**2 + mean_b**2 + c1) * (variance_a + variance_b + c2)
    return float(np.mean(top / bottom))


def _smoothed(values: Floats) -> Floats:
    from scipy.ndimage import correlate1d

    half = WINDOW // 2
    weights = np.exp(-0.5 * (np.arange(-half, half + 1) / _SIGMA) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        values = correlate1d(values, weights, axis=axis, mode="constant")
    return values[half:-half, half:-half]
