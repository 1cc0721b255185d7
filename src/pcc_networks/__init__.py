"""Neural networks that compress point clouds: PCGCv1, PCGCv2, sparse octree net and others.

Each network is a sub-package (`pcgcv1`, `pcgcv2`, `octree_net`, `reno`, `lizip`, `polopcac`) with
three functions. `load_weights` reads trained weights, `encode` compresses points to bytes, and
`decode` returns points from these bytes; `polopcac` codes attributes of points instead. They raise
`pointkit.errors.InputError` if a stream is damaged, weights belong to another network, or points
cannot be encoded.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.catalogue import WeightsHeader as WeightsHeader
    from pcc_networks.catalogue import header_of as header_of
    from pcc_networks.catalogue import shipped as shipped
    from pcc_networks.grid_level import choose_grid_level as choose_grid_level
    from pcc_networks.training import train as train

__getattr__, __dir__, __all__ = lazy(
    __name__,
    catalogue=("WeightsHeader", "header_of", "shipped"),
    grid_level=("choose_grid_level",),
    training=("train",),
)
