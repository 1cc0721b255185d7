"""Draco's sequential method, through DracoPy: points in their order, each one kept."""

from __future__ import annotations

from puckbench.codecs.draco import DracoCodec
from puckbench.codecs.registry import CODECS


@CODECS.register("draco_sequential")
class DracoSequential(DracoCodec):
    """Draco (Google), sequential method: differences along the order of the points.

    A rate is the step of the grid.
    """

    title = "Draco (sequential)"
    use = "clouds in metres whose order counts, as point_cloud_transport sends them"
    colour = "#3A8FB7"
    marker = "H"
    line = "-."
    rank = 140
    keeps_order = True
