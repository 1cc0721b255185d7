"""Numbers that the thesis or its author's repository branislavjenco/thesis-code published.

Data sets and codecs are named by roles. A role is one of the thesis's data sets or codecs, which a
data set or codec of a run may represent (`jenco2022.needs`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pointkit.yaml_files import read_yaml

if TYPE_CHECKING:
    import pandas as pd

OBJECTS, ROOMS, CLEAN, NOISY = "objects", "rooms", "clean scans", "noisy scans"
"""The thesis's data sets: CAPOD, S3DIS, and virtual scans of S3DIS without and with noise."""

SAMPLED = "sampled rooms"
"""Role of rooms whose points are sampled on meshes, so that the number of points is a setting."""

DRACO, GPCC, GPCC_AS_RUN, PCGCV1, PCGCV2 = "draco", "gpcc", "gpcc_as_run", "pcgcv1", "pcgcv2"
CLASSICAL = (DRACO, GPCC_AS_RUN, GPCC)
LEARNED = (PCGCV1, PCGCV2)
SCANS = (CLEAN, NOISY)
ALL_ROOMS = (ROOMS, SAMPLED)
DATASETS = (OBJECTS, ROOMS, SAMPLED, CLEAN, NOISY)

RATES = frozenset(f"r{number}" for number in range(1, 9))

FAR_M = 30.0
"""Distance of the sensor from the wall, in m, in Figure 5.19. In other figures, it is 1 to 5 m."""

PRINTED_MEAN_M, PRINTED_STD_M = 0.000, 0.014
"""Mean and standard deviation, in m, of the real VLP-16's plane residuals, which are the same for
walls and floors (section 5.1.3).
"""

REAL_MEAN_M, REAL_STD_M = 0.0007, 0.0138
"""Mean and standard deviation, in m, of the real plane residuals in Figure 5.18."""

MODEL_STDS_M = {"none": 2.7e-7, "hdl64e": 0.0652, "vlp16": 0.0186, "vlp16_divergence": 0.0198}
"""Standard deviations, in m, of the residuals of error models on walls and floors at 1 to 5 m
(Figure 5.18).
"""

MODEL_DISTANCES_M = {"none": 0.0108, "hdl64e": 0.0399, "vlp16": 0.0044, "vlp16_divergence": 0.0050}
"""Earth mover's distances, in m, of error models' residuals from the real ones (Figure 5.18)."""

FAR_STDS_M = {"vlp16": 0.0163, "vlp16_divergence": 0.0171}
"""Standard deviations, in m, of the residuals of error models at 30 m (Figure 5.19)."""

BIN_STDS_M = (0.0118, 0.0127, 0.0136, 0.0137, 0.0124, 0.0133, 0.0126, 0.0134, 0.0175, 0.0246)
LARGEST_RAD = 1.315
"""Standard deviations, in m, of the real residuals in ten equal bins of the angle of incidence, and
the upper end of the last bin, in rad (Figure 5.15).
"""

FITTED_TO_5_18 = {"vlp16_fig518": "vlp16", "vlp16_divergence_fig518": "vlp16_divergence"}
"""Error models that were fitted to Figure 5.18, and the thesis's models that they stand for.

Fitted models reproduce the standard deviations in Figure 5.18, with a bias of 0.020 m and a ray
noise of 0.010 m or, with divergence, 0.014 m. The text of the thesis states a bias of 0.014 m and a
ray noise of 0.010 m for both models.
"""

_DISTANCES = ("cd_plane", "hausdorff_sq_plane")


def medians_of_thesis() -> pd.DataFrame:
    """Return the medians over clouds in thesis figure 6.5, which were read off to about 5 %.

    Returns
    -------
    DataFrame
        A row for each data set, codec and rate ("r1" is the coarsest), with the columns ``dataset``
        and ``codec`` (roles, such as "rooms" and "gpcc_as_run"), ``cloud`` (always "median"),
        ``rate``, ``bpp`` (bits per input point; only for the first and the last rate), ``cd_plane``
        (Chamfer distance, point to plane) and ``hausdorff_sq_plane`` (squared Hausdorff distance),
        both in squared units of the cube [0, 1023].
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
