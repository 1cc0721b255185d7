"""PoLoPCAC: a network that codes the reflectances and colours of a point cloud without loss.

`load_weights` reads a checkpoint of the authors, `encode` compresses attributes of points to bytes,
and `decode` returns the attributes of these points. Positions are not coded.

References
----------
You, Gao, Ma: "Efficient and Generic Point Model for Lossless Point Cloud Attribute Compression",
arXiv 2404.06936, 2024.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.polopcac.codec import decode as decode
    from pcc_networks.polopcac.codec import encode as encode
    from pcc_networks.polopcac.stream import read_stream as read_stream
    from pcc_networks.polopcac.weights import PolopcacWeights as PolopcacWeights
    from pcc_networks.polopcac.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    stream=("read_stream",),
    weights=("PolopcacWeights", "load_weights"),
)
