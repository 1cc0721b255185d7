"""The adaptive models of octree geometry: which there are, and where each one's state is kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.gpcc.arithmetic import HALF
from puckbench.codecs.gpcc.compiled import integer
from puckbench.codecs.gpcc.tables import MAP_COUNT, MAP_SIZE

# Indices into Models.probabilities; a comment gives the number where there are several. They are
# no literals to the compiler, which would compile the coding of a bit anew for each.
OCCUPANCY = integer(0)  # 32
SINGLE_CHILD = integer(32)
DUPLICATES_GT0 = integer(33)
DUPLICATES_GT1 = integer(34)
DUPLICATES_PREFIX = integer(35)
IS_DIRECT = integer(36)
DIRECT_POINTS_GT1 = integer(37)
SAME_BIT = integer(38)  # 3 axes x 5
PLANAR_MODE = integer(53)  # 3 axes
PLANE_UNKNOWN = integer(56)  # 3
PLANE = integer(59)  # 3 axes x 3 x 4
_COUNT = 95


class Models(NamedTuple):
    """probabilities: (95,) of a zero, 16 bits. maps: from occupancy contexts to models, flat."""

    probabilities: NDArray[np.uint16]
    maps: NDArray[np.uint8]


def fresh_models() -> Models:
    """Every model as at the start of a slice."""
    probabilities = np.full(_COUNT, HALF, dtype=np.uint16)
    return Models(probabilities, np.full(MAP_COUNT * MAP_SIZE, 127, dtype=np.uint8))


def copied(models: Models) -> Models:
    """The models as they are now, to come back to."""
    return Models(models.probabilities.copy(), models.maps.copy())
