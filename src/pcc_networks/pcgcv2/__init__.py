"""PCGCv2: a network that codes the geometry of a cloud at several scales, by sparse convolutions.

`load_weights` reads trained weights, `encode` compresses points to bytes, and `decode` returns
points.

References
----------
Wang et al.: "Multiscale Point Cloud Geometry Compression", DCC 2021.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.pcgcv2.codec import decode as decode
    from pcc_networks.pcgcv2.codec import encode as encode
    from pcc_networks.pcgcv2.model import PCGCv2 as PCGCv2
    from pcc_networks.pcgcv2.model import Pcgcv2Shape as Pcgcv2Shape
    from pcc_networks.pcgcv2.stream import CodingTools as CodingTools
    from pcc_networks.pcgcv2.stream import Pcgcv2Stream as Pcgcv2Stream
    from pcc_networks.pcgcv2.stream import read_stream as read_stream
    from pcc_networks.pcgcv2.stream import write_coded as write_coded
    from pcc_networks.pcgcv2.weights import Pcgcv2Weights as Pcgcv2Weights
    from pcc_networks.pcgcv2.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    model=("PCGCv2", "Pcgcv2Shape"),
    stream=("CodingTools", "Pcgcv2Stream", "read_stream", "write_coded"),
    weights=("Pcgcv2Weights", "load_weights"),
)
