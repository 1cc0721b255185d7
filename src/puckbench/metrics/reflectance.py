from __future__ import annotations

import numpy as np

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from puckbench.metrics.paired_values import distinct_values, pair_errors, same_values
from puckbench.metrics.psnr import psnr

Reflectances = tuple[Floats, Floats]
"""Points (n, 3) and their reflectances (n,)."""


def reflectance_distortion(
    reference: Reflectances, decoded: Reflectances, peak: float | None = None
) -> dict[str, float]:
    """Return the errors of the decoded reflectances.

    A point's reflectance is compared with that of the nearest point in the other cloud, in both
    directions (see `paired_values`). The larger error of both directions is returned.

    Parameters
    ----------
    reference, decoded
        Points (n, 3) and their reflectances (n,), of the original and of the decoded cloud.
    peak
        Peak of the PSNR. By default it is 255, or 65535 if a value of the original exceeds 255.
        MPEG's pc_error uses 65535 for all clouds, which adds 48.2 dB.

    Returns
    -------
    dict
        * ``reflectance_mse``: mean squared error.
        * ``reflectance_psnr``: PSNR in dB.
        * ``reflectance_peak``: the peak of the PSNR.
        * ``reflectance_max_error``: largest difference.
        * ``reflectance_lossless``: whether both clouds have the same reflectances.

    Raises
    ------
    InputError
        A cloud is empty, or a point has no finite value.
    """
    a, b = _checked(reference, "reference cloud"), _checked(decoded, "decoded cloud")
    peak = peak or (255.0 if a[1].max() <= 255 else 65535.0)
    squared, largest = pair_errors(
        distinct_values(a[0], a[1][:, None], "reference cloud"),
        distinct_values(b[0], b[1][:, None], "decoded cloud"),
    )
    return {
        "reflectance_mse": float(squared[0]),
        "reflectance_psnr": psnr(float(squared[0]), peak),
        "reflectance_peak": peak,
        "reflectance_max_error": float(largest[0]),
        "reflectance_lossless": same_values(a[1], b[1]),
    }


def _checked(cloud: Reflectances, source: str) -> Reflectances:
    points, values = cloud[0], np.asarray(cloud[1], dtype=np.float64)
    if values.shape != (len(points),) or not len(points):
        raise InputError(f"{source}: needs a reflectance for every point")
    if invalid := int(np.count_nonzero(~np.isfinite(values))):
        raise InputError(f"{source}: {invalid} of {len(values)} reflectances are not finite")
    return points, values
