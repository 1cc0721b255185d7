"""Numbers of thesis chapter 5 and of its author's repository branislavjenco/thesis-code."""

from __future__ import annotations

FAR_M = 30.0
"""Distance of the sensor from the wall in Figure 5.19; in other figures, 1 to 5 m."""

PRINTED_MEAN_M, PRINTED_STD_M = 0.000, 0.014
"""Mean and standard deviation (m) of the real VLP-16's plane residuals, equal for walls and floors
(section 5.1.3)."""

REAL_MEAN_M, REAL_STD_M = 0.0007, 0.0138
"""Mean and standard deviation (m) of the real plane residuals in Figure 5.18."""

MODEL_STDS_M = {"none": 2.7e-7, "hdl64e": 0.0652, "vlp16": 0.0186, "vlp16_divergence": 0.0198}
"""Standard deviations of the error models' residuals, walls and floors, 1 to 5 m (Figure 5.18)."""

MODEL_DISTANCES_M = {"none": 0.0108, "hdl64e": 0.0399, "vlp16": 0.0044, "vlp16_divergence": 0.0050}
"""Earth mover's distances of the error models' residuals from the real ones (Figure 5.18)."""

FAR_STDS_M = {"vlp16": 0.0163, "vlp16_divergence": 0.0171}
"""Standard deviations of the error models' residuals at 30 m (Figure 5.19)."""

BIN_STDS_M = (0.0118, 0.0127, 0.0136, 0.0137, 0.0124, 0.0133, 0.0126, 0.0134, 0.0175, 0.0246)
LARGEST_RAD = 1.315
"""Standard deviations (m) of the real residuals in ten equal bins of the angle of incidence, from 0
to `LARGEST_RAD` (Figure 5.15)."""

FITTED_TO_5_18 = {"vlp16_fig518": "vlp16", "vlp16_divergence_fig518": "vlp16_divergence"}
"""Fitted model -> the thesis's model. Fitted models reproduce the standard deviations in Figure
5.18, with a bias of 0.020 m and a ray noise of 0.010 m or, with divergence, 0.014 m. The text
states a bias of 0.014 m and a ray noise of 0.010 m for both models."""
