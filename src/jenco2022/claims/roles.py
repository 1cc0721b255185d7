from __future__ import annotations

from jenco2022.published_rates import CLEAN, NOISY, OBJECTS, ROOMS

SAMPLED = "sampled rooms"
"""Rooms whose points are sampled on meshes, so that the number of points is a setting."""

DRACO, GPCC, GPCC_AS_RUN, PCGCV1, PCGCV2 = "draco", "gpcc", "gpcc_as_run", "pcgcv1", "pcgcv2"
CLASSICAL = (DRACO, GPCC_AS_RUN, GPCC)
LEARNED = (PCGCV1, PCGCV2)
SCANS = (CLEAN, NOISY)
ALL_ROOMS = (ROOMS, SAMPLED)
DATASETS = (OBJECTS, ROOMS, SAMPLED, CLEAN, NOISY)

RATES = frozenset(f"r{number}" for number in range(1, 9))
