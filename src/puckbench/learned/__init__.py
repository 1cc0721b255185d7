"""Learned codecs of point-cloud geometry: PCGCv1, PCGCv2, a sparse octree net, and RENO.

Each network is a sub-package (`pcgcv1`, `pcgcv2`, `octree_net`, `reno`) with `load_weights`,
`encode` and `decode`. Damaged streams, weights of another network and points that cannot be encoded
raise `puckbench.core.errors.InputError`.
"""

from typing import TYPE_CHECKING

from puckbench.core.lazy import lazy

if TYPE_CHECKING:
    from puckbench.learned.catalogue import WeightsHeader as WeightsHeader
    from puckbench.learned.catalogue import header_of as header_of
    from puckbench.learned.catalogue import shipped as shipped
    from puckbench.learned.grid_level import choose_grid_level as choose_grid_level
    from puckbench.learned.training import train as train

__getattr__, __dir__, __all__ = lazy(
    __name__,
    catalogue=("WeightsHeader", "header_of", "shipped"),
    grid_level=("choose_grid_level",),
    training=("train",),
)
