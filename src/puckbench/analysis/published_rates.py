"""Numbers of the thesis's chapter 6, to hold ours against: medians read off its Figure 6.5.

Read to about 5 %; distances in squared units of the cube [0, 1023], point-to-plane, Hausdorff's
squared as the thesis has it. Rates are r1 and on, r1 the smallest bitrate.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

OBJECTS, ROOMS, CLEAN, NOISY = "objects", "rooms", "clean scans", "noisy scans"
"""The thesis's data sets by what they are: CAPOD, S3DIS, its scans without and with noise."""

_Medians = dict[str, dict[str, tuple[float, ...]]]

CD_PLANE: _Medians = {
    OBJECTS: {
        "draco": (433, 113, 26, 6.7, 1.6, 0.34, 0.086, 0.022),
        "gpcc_as_run": (6.2, 1.7, 0.81, 0.36, 0.36, 0.29, 0.30, 0.29),
        "pcgcv1": (2.8, 1.4, 1.9, 3.1, 5.0, 7.3),
        "pcgcv2": (3.7, 1.06, 0.66, 0.50, 0.42, 0.41, 0.40),
    },
    ROOMS: {
        "draco": (276, 82, 22, 5.6, 1.36, 0.35, 0.082, 0.021),
        "gpcc_as_run": (5.6, 1.4, 0.78, 0.34, 0.43, 0.32, 0.35, 0.32),
        "pcgcv1": (7.0, 2.0, 2.2, 2.2, 3.7, 2.9),
        "pcgcv2": (17.9, 4.3, 1.7, 1.45, 1.9, 1.27, 1.02),
    },
    CLEAN: {
        "draco": (258, 81, 22, 5.8, 1.42, 0.38, 0.084, 0.021),
        "gpcc_as_run": (5.3, 1.45, 0.74, 0.35, 0.41, 0.30, 0.33, 0.32),
        "pcgcv1": (7.3, 3.2, 2.7, 3.6, 5.8, 5.8),
        "pcgcv2": (11.4, 3.9, 1.02, 0.78, 0.81, 0.71, 0.68),
    },
    NOISY: {
        "draco": (115, 34, 10.7, 3.9, 0.97, 0.35, 0.082, 0.021),
        "gpcc_as_run": (3.6, 1.1, 0.63, 0.32, 0.36, 0.29, 0.30, 0.29),
        "pcgcv1": (2.7, 2.0, 3.4, 3.3, 3.6, 3.7),
        "pcgcv2": (5.6, 3.1, 2.1, 1.5, 1.2, 1.1, 1.06),
    },
}

HAUSDORFF_SQ_PLANE: _Medians = {
    OBJECTS: {
        "draco": (2660, 709, 189, 43, 10.7, 2.6, 0.68, 0.18),
        "gpcc_as_run": (42, 11.4, 8.9, 2.9, 5.8, 4.3, 4.7, 2.7),
        "pcgcv1": (542, 433, 1060, 2080, 2980, 3560),
        "pcgcv2": (346, 211, 148, 94, 58, 55, 44),
    },
    ROOMS: {
        "draco": (2280, 648, 169, 40, 10.5, 2.5, 0.65, 0.17),
        "gpcc_as_run": (40, 10.9, 8.2, 2.7, 5.3, 3.9, 4.3, 2.6),
        "pcgcv1": (2720, 1110, 1590, 1780, 2720, 2850),
        "pcgcv2": (3260, 928, 1160, 793, 1190, 554, 331),
    },
    CLEAN: {
        "draco": (2400, 648, 173, 41, 11.4, 2.8, 0.68, 0.18),
        "gpcc_as_run": (41, 10.9, 8.2, 2.7, 5.3, 3.9, 4.3, 2.6),
        "pcgcv1": (3730, 2650, 2720, 2980, 3410, 3410),
        "pcgcv2": (2380, 2600, 1780, 1660, 2180, 2180, 1660),
    },
    NOISY: {
        "draco": (2180, 620, 169, 41, 10.5, 2.6, 0.63, 0.18),
        "gpcc_as_run": (39, 10.9, 8.6, 2.7, 5.6, 4.1, 4.5, 2.7),
        "pcgcv1": (1250, 1990, 2280, 2280, 2720, 2600),
        "pcgcv2": (1160, 1270, 868, 742, 620, 567, 648),
    },
}

BPP_ENDS: dict[str, dict[str, tuple[float, float]]] = {
    OBJECTS: {
        "draco": (0.016, 8),
        "gpcc_as_run": (0.057, 4.8),
        "pcgcv1": (0.10, 1.95),
        "pcgcv2": (0.031, 1.7),
    },
    ROOMS: {
        "draco": (0.015, 8),
        "gpcc_as_run": (0.027, 5.8),
        "pcgcv1": (0.048, 5.6),
        "pcgcv2": (0.014, 4.2),
    },
    CLEAN: {
        "draco": (2.8, 17),
        "gpcc_as_run": (0.038, 2.5),
        "pcgcv1": (0.082, 1.2),
        "pcgcv2": (0.022, 1.0),
    },
    NOISY: {
        "draco": (3.2, 22),
        "gpcc_as_run": (0.10, 7.3),
        "pcgcv1": (0.14, 3.9),
        "pcgcv2": (0.021, 5.0),
    },
}
"""Bits per point at the ends of each curve of Figure 6.6, which are medians of a tenth of the
clouds and rates each."""


def median_rows() -> Iterator[dict[str, Any]]:
    """The medians as rows of a table of results, one for each data set, codec and rate.

    ``dataset`` is what the set is, ``codec`` what the codec is (see
    `puckbench.analysis.claims.roles`); ``bpp`` is known of the first and last rate alone.
    """
    for dataset, codecs in CD_PLANE.items():
        for codec, values in codecs.items():
            ends = dict(zip((1, len(values)), BPP_ENDS[dataset][codec], strict=True))
            squared = HAUSDORFF_SQ_PLANE[dataset][codec]
            for number, (cd, hd) in enumerate(zip(values, squared, strict=True), 1):
                names = {"dataset": dataset, "cloud": "median", "codec": codec}
                found = {"bpp": ends.get(number), "cd_plane": cd, "hausdorff_sq_plane": hd}
                yield {**names, "rate": f"r{number}", **found}
