"""Published numbers: the thesis's, and those of its author's repository branislavjenco/thesis-code.

Names of data sets and codecs here are roles, which a run's data sets and codecs may have (`needs`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pointkit.yaml_files import read_yaml

if TYPE_CHECKING:
    import pandas as pd

OBJECTS, ROOMS, CLEAN, NOISY = "objects", "rooms", "clean scans", "noisy scans"
"""The thesis's data sets: CAPOD, S3DIS, and scans of S3DIS without and with noise."""

SAMPLED = "sampled rooms"
"""Rooms whose points are sampled on meshes, so that the number of points is a setting."""

DRACO, GPCC, GPCC_AS_RUN, PCGCV1, PCGCV2 = "draco", "gpcc", "gpcc_as_run", "pcgcv1", "pcgcv2"
CLASSICAL = (DRACO, GPCC_AS_RUN, GPCC)
LEARNED = (PCGCV1, PCGCV2)
SCANS = (CLEAN, NOISY)
ALL_ROOMS = (ROOMS, SAMPLED)
DATASETS = (OBJECTS, ROOMS, SAMPLED, CLEAN, NOISY)

RATES = frozenset(f"r{number}" for number in range(1, 9))

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

_DISTANCES = ("cd_plane", "hausdorff_sq_plane")


def medians_of_thesis() -> pd.DataFrame:
    """Return the medians over clouds of thesis figure 6.5, read to about 5 %, as rows of results.

    Returns
    -------
    DataFrame
        A row for each data set, codec and rate ("r1" is the coarsest), with the columns
        ``dataset`` and ``codec`` (roles, such as "rooms" and "gpcc_as_run"), ``cloud`` (always
        "median"), ``rate``, ``bpp`` (bits per input point; only for the first and the last rate),
        ``cd_plane`` (Chamfer distance, point to plane) and ``hausdorff_sq_plane`` (squared
        Hausdorff distance), both in squared units of the cube [0, 1023].
    """
    import pandas as pd

    rows = []
    for dataset, codecs in read_yaml(Path(__file__).with_suffix(".yaml")).items():
        for codec, curves in codecs.items():
            names = {"dataset": dataset, "cloud": "median", "codec": codec}
            distances = list(zip(*(curves[name] for name in _DISTANCES), strict=True))
            ends = dict(zip((1, len(distances)), curves["bpp"], strict=True))
            for number, values in enumerate(distances, 1):
                numbers = {"bpp": ends.get(number), **dict(zip(_DISTANCES, values, strict=True))}
                rows.append({**names, "rate": f"r{number}", **numbers})
    return pd.DataFrame(rows).astype({"bpp": float})
