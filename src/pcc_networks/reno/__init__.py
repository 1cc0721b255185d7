"""RENO: a network that codes the voxels of a LiDAR scan without loss, by sparse convolutions.

`load_weights` reads a checkpoint of the authors, `encode` compresses points to bytes, and `decode`
returns points.

References
----------
You et al.: "RENO: Real-Time Neural Compression for 3D LiDAR Point Clouds", CVPR 2025.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.reno.codec import decode as decode
    from pcc_networks.reno.codec import encode as encode
    from pcc_networks.reno.stream import RenoStream as RenoStream
    from pcc_networks.reno.stream import read_stream as read_stream
    from pcc_networks.reno.stream import write_stream as write_stream
    from pcc_networks.reno.weights import RenoWeights as RenoWeights
    from pcc_networks.reno.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    stream=("RenoStream", "read_stream", "write_stream"),
    weights=("RenoWeights", "load_weights"),
)
