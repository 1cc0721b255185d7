from __future__ import annotations

import logging
from pathlib import Path

from pointkit.geometry.cloud import Floats

_LOG = logging.getLogger(__name__)
LARGEST_M, SMALLEST_M = 1000.0, 0.05
"""Limits of plausible extents: sensors reach 300 m, but rooms in millimetres span thousands of
units; objects below 5 cm are smaller than a spinning sensor's errors."""
_SURVEY_SUFFIXES = (".las", ".laz", ".e57")
"""Formats that define the unit; clouds in them may span kilometres."""


def warn_of_implausible_extent(path: Path, box: Floats) -> None:
    """Log a warning if the bounding box (2, 3) of a file suggests a unit other than the metre."""
    extent = float((box[1] - box[0]).max())
    if path.suffix.lower() in _SURVEY_SUFFIXES or SMALLEST_M <= extent <= LARGEST_M:
        return
    advice = "if its unit is not the metre, name it (--metres-per-unit 0.001: millimetres)"
    _LOG.warning("%s: spans %.4g m: %s", path, extent, advice)
