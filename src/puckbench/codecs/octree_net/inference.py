"""Convolution of some rows of a level, as the coder needs it: no gradients, everything in chunks.

The sums are exact (see `fixed`), so the result is that of the layer's own `forward`.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.codecs.octree_net.fixed import activated, rounded, streamed, weight
from puckbench.codecs.octree_net.model import Layer
from puckbench.codecs.sparse.convolution import accumulate, products_of, site
from puckbench.codecs.sparse.crew import Crew, Scratch
from puckbench.codecs.sparse.layout import rows_layout
from puckbench.codecs.sparse.voxels import CENTRE, Table


def convolved_rows(
    layer: Layer, features: Tensor, table: Table, rows: NDArray[np.int64] | None, crew: Crew
) -> Tensor:
    """Features (m, width) of some rows, or of all, after a layer has been added to them.

    features: (n, width) of all voxels. table: their neighbours, (27, n).
    """
    own = features if rows is None else features[torch.from_numpy(rows)]
    where = site(table if rows is None else table[:, rows], rows_layout(), crew)
    products = products_of(weight(layer.kernel), rows_layout())
    bias, read = rounded(layer.bias), activated(features)[:, None]
    result = torch.empty_like(own)

    def work(chunk: slice, scratch: Scratch) -> None:
        sums = torch.addmm(bias, activated(own[chunk]), products[CENTRE])
        accumulate(read, where, products, chunk, scratch, sums[:, None])
        result[chunk] = streamed(own[chunk] + sums)

    crew.over(len(own), where.chunk(own.shape[1]), work)
    return result
