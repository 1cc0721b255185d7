"""Adaptive contexts of octree geometry (`GeometryOctreeContexts` of TMC13)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpcc.arithmetic import HALF
from gpcc.compiled import integer
from gpcc.tables import CTX_MAP_COUNT, CTX_MAP_SIZE

# Indices into the probabilities; a comment states the number of contexts if there are several.
# `integer` hides the values from the compiler, which would compile code_bit once for each literal.
CTX_OCCUPANCY = integer(0)  # 32
CTX_SINGLE_CHILD = integer(32)
CTX_DUP_POINT_CNT_GT0 = integer(33)
CTX_DUP_POINT_CNT_GT1 = integer(34)
CTX_DUP_POINT_CNT_EGL = integer(35)
CTX_BLOCK_SKIP_TH = integer(36)
CTX_NUM_IDCM_POINTS_GT1 = integer(37)
CTX_SAME_BIT_HIGH = integer(38)  # 3 axes x 5
CTX_PLANAR_MODE = integer(53)  # 3 axes
CTX_PLANE_LAST_INDEX_Z = integer(56)  # 3
CTX_PLANE_LAST_INDEX = integer(59)  # 3 axes x 3 x 4
CTX_THETA_RES = integer(95)  # 3
CTX_THETA_RES_SIGN = integer(98)
CTX_THETA_RES_EXP = integer(99)
CTX_PLANE_ANGULAR = integer(100)  # 4
CTX_PLANE_ANGULAR_IDCM = integer(104)  # 4
CTX_PLANE_ANGULAR_PHI = integer(108)  # 8
CTX_PLANE_ANGULAR_PHI_IDCM = integer(116)  # 8
_COUNT = 124


class Contexts(NamedTuple):
    """Adaptive state of an octree coder.

    probabilities: see `arithmetic.Encoder`.
    ctx_idx_maps: see `octree.SliceState`.
    """

    probabilities: NDArray[np.uint16]
    ctx_idx_maps: NDArray[np.uint8]


def initial_contexts() -> Contexts:
    probabilities = np.full(_COUNT, HALF, dtype=np.uint16)
    return Contexts(probabilities, np.full(CTX_MAP_COUNT * CTX_MAP_SIZE, 127, dtype=np.uint8))
