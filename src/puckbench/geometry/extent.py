"""Extents that speak for another unit than the metre."""

from __future__ import annotations

import logging
from pathlib import Path

from puckbench.geometry.cloud import Floats

_LOG = logging.getLogger(__name__)
LARGEST_M, SMALLEST_M = 1000.0, 0.05
"""A room in millimetres spans thousands, a sensor sees 300 m at most; an object of less than 5 cm
is smaller than the errors of a spinning sensor."""
_SURVEYS = (".las", ".laz", ".e57")
"""Formats whose unit is the metre, or is named in the file; clouds of these span kilometres."""


def remark_extent(path: Path, box: Floats) -> None:
    """Log one line where a cloud or a mesh in metres is so large or small that its unit is another.

    Parameters
    ----------
    path
        Of the file.
    box
        Lowest and highest corner, (2, 3), m; where it lies does not matter.
    """
    extent = float((box[1] - box[0]).max())
    if path.suffix.lower() in _SURVEYS or SMALLEST_M <= extent <= LARGEST_M:
        return
    advice = "if its unit is not the metre, name it (--metres-per-unit 0.001: millimetres)"
    _LOG.warning("%s: spans %.4g m: %s", path, extent, advice)
