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

FITTED_TO_5_18 = {
    "vlp16_fig518": "vlp16",
    "vlp16_divergence_fig518": "vlp16_divergence",
}
"""Names of models, and those whose printed spreads their parameters give: a bias of 0.020 m, and
0.010 m or, with divergence, 0.014 m for a ray. The text states 0.014 m and 0.010 m for both."""
