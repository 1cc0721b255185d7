"""The places of the latent in all cubes at once, and their neighbours: for coding in contexts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.learned.adaptive_entropy import Expected, decode_in_context, encode_in_context
from puckbench.codecs.learned.pcgcv1.cubes import Whole
from puckbench.codecs.learned.pcgcv1.laplace import Chosen, table
from puckbench.codecs.learned.pcgcv1.occupied_blocks import Support
from puckbench.codecs.learned.sparse.voxels import AXIS_BITS, Table, morton_keys, pyramid

Integers = NDArray[np.int32]
_MOST = 2**20
"""Cells, whose latent and contexts take some 500 bytes each."""


@dataclass(frozen=True)
class Cells:
    """The blocks that count, of all cubes.

    order: (n,) that puts them into Morton order; they come cube by cube. neighbours: (27, n), in
    Morton order.
    """

    order: Whole
    neighbours: Table

    def encode(self, latent: Integers, chosen: Chosen) -> bytes:
        """Code integers (n, channels), cube by cube, with the tables chosen for them."""
        expected = _expected(chosen, self.order)
        return encode_in_context(latent[self.order], self.neighbours, expected)

    def decode(self, data: bytes, chosen: Chosen) -> Integers:
        """The integers (n, channels) of `encode`; InputError when the data are damaged."""
        latent = np.empty(chosen.table.shape, np.int32)
        expected = _expected(chosen, self.order)
        latent[self.order] = decode_in_context(data, self.neighbours, expected)
        return latent


def cells_of(support: Support) -> Cells | None:
    """The cells of cubes; None if there are none, too many, or too far apart for their keys."""
    cube, *inside = np.nonzero(support.blocks)
    if not 0 < len(cube) <= _MOST:
        return None
    corners = support.positions - support.positions.min(axis=0)
    cells = corners[cube] * support.blocks.shape[-1] + np.column_stack(inside)
    if cells.max() >= 2**AXIS_BITS:
        return None
    keys = morton_keys(cells)
    order = np.argsort(keys)
    return Cells(order, pyramid(keys[order], 0)[0][0].neighbours)


def _expected(chosen: Chosen, order: Whole) -> Expected:
    used, number = np.unique(chosen.table[order], return_inverse=True)
    shape = chosen.table.shape
    return Expected(tuple(map(table, used.tolist())), number.reshape(shape), chosen.centre[order])
