"""PCGCv1: a network that codes a cloud's geometry in dense cubes of voxels, with a hyper-prior.

`load_weights` reads trained weights, `encode` compresses points to bytes, and `decode` returns
points.

References
----------
Wang et al.: "Lossy Point Cloud Geometry Compression via End-to-End Learning", IEEE TCSVT 2021.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.pcgcv1.codec import decode as decode
    from pcc_networks.pcgcv1.codec import encode as encode
    from pcc_networks.pcgcv1.model import PCGCv1 as PCGCv1
    from pcc_networks.pcgcv1.model import Pcgcv1Shape as Pcgcv1Shape
    from pcc_networks.pcgcv1.stream import Pcgcv1Stream as Pcgcv1Stream
    from pcc_networks.pcgcv1.stream import read_stream as read_stream
    from pcc_networks.pcgcv1.stream import write_stream as write_stream
    from pcc_networks.pcgcv1.weights import Pcgcv1Weights as Pcgcv1Weights
    from pcc_networks.pcgcv1.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    model=("PCGCv1", "Pcgcv1Shape"),
    stream=("Pcgcv1Stream", "read_stream", "write_stream"),
    weights=("Pcgcv1Weights", "load_weights"),
)
