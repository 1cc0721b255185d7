from __future__ import annotations

import logging
from pathlib import Path

from pointkit.geometry.cloud import Floats

_LOG = logging.getLogger(__name__)
LARGEST_M, SMALLEST_M = 1000.0, 0.05
"""Largest and smallest plausible extent of a cloud, in m.

Sensors reach 300 m, but rooms in millimetres span thousands of units. Objects below 5 cm are
smaller than a spinning sensor's errors.
"""
_SURVEY_SUFFIXES = (".las", ".laz", ".e57")
"""Formats that define the unit of length; clouds in these formats may span kilometres."""


def warn_of_implausible_extent(path: Path, box: Floats) -> None:
    """Log a warning if the extent of a file's cloud suggests that its unit is not the metre.

    Parameters
    ----------
    path
        The file, which the warning names.
    box
        The lowest and the highest corner of the cloud's bounding box, (2, 3).
    """
    extent = float((box[1] - box[0]).max())
    if path.suffix.lower() in _SURVEY_SUFFIXES or SMALLEST_M <= extent <= LARGEST_M:
        return
    advice = "if its unit is not the metre, name it (--metres-per-unit 0.001: millimetres)"
    _LOG.warning("%s: spans %.4g m: %s", path, extent, advice)
