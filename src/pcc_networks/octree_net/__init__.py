"""Sparse octree net: a network that codes voxels without loss, and that a CPU can train.

`load_weights` reads trained weights, `encode` compresses points to bytes, and `decode` returns
points.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.octree_net.codec import decode as decode
    from pcc_networks.octree_net.codec import encode as encode
    from pcc_networks.octree_net.model import OctreeNet as OctreeNet
    from pcc_networks.octree_net.model import OctreeNetShape as OctreeNetShape
    from pcc_networks.octree_net.stream import OctreeNetStream as OctreeNetStream
    from pcc_networks.octree_net.stream import read_stream as read_stream
    from pcc_networks.octree_net.stream import write_stream as write_stream
    from pcc_networks.octree_net.weights import OctreeNetWeights as OctreeNetWeights
    from pcc_networks.octree_net.weights import load_weights as load_weights
    from pcc_networks.octree_net.weights import save_weights as save_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    model=("OctreeNet", "OctreeNetShape"),
    stream=("OctreeNetStream", "read_stream", "write_stream"),
    weights=("OctreeNetWeights", "load_weights", "save_weights"),
)
