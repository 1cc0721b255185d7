"""Numbers of the thesis's chapter 5, to hold ours against.

Those that its text and figures print, and those of the samples behind its figures, which are in its
author's public repository (branislavjenco/thesis-code) as pictures and notebooks. The real
residuals themselves are not published: only these moments of them.
"""

from __future__ import annotations

FAR_M = 30.0
"""The distance of Figure 5.19; everything else in the chapter is measured from nearer."""

PRINTED_MEAN_M, PRINTED_STD_M = 0.000, 0.014
"""Residuals of the real VLP-16, walls and floors alike (section 5.1.3)."""

REAL_MEAN_M, REAL_STD_M = 0.0007, 0.0138
"""The same in the sample of Figure 5.18."""

MODEL_STDS_M = {"none": 2.7e-7, "hdl64e": 0.0652, "vlp16": 0.0186, "vlp16_divergence": 0.0198}
"""Residuals of the error models, walls and floors from 1 to 5 m (Figure 5.18)."""

MODEL_DISTANCES_M = {
    "none": 0.0108,
    "hdl64e": 0.0399,
    "vlp16": 0.0044,
    "vlp16_divergence": 0.0050,
}
"""Earth mover's distance of the same residuals to the real ones."""

FAR_STDS_M = {"vlp16": 0.0163, "vlp16_divergence": 0.0171}
"""Residuals from 30 m (Figure 5.19)."""

BIN_STDS_M = (0.0118, 0.0127, 0.0136, 0.0137, 0.0124, 0.0133, 0.0126, 0.0134, 0.0175, 0.0246)
LARGEST_RAD = 1.315
"""Real residuals in ten bins of equal width from no incidence to this (Figure 5.15)."""

FITTING_OPTIONS: dict[str, dict[str, float]] = {
    "vlp16": {"bias_sigma_m": 0.020, "ray_sigma_m": 0.010},
    "vlp16_divergence": {"bias_sigma_m": 0.020, "ray_sigma_m": 0.014},
}
"""Parameters that give the printed spreads; the text states 0.014 and 0.010 for both."""
