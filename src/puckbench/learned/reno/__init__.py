"""RENO: lossless coding of LiDAR voxels by sparse convolutions.

`load_weights` reads a checkpoint of the authors.

References
----------
You et al.: "RENO: Real-Time Neural Compression for 3D LiDAR Point Clouds", CVPR 2025.
"""

from typing import TYPE_CHECKING

from puckbench.core.lazy import lazy

if TYPE_CHECKING:
    from puckbench.learned.reno.codec import decode as decode
    from puckbench.learned.reno.codec import encode as encode
    from puckbench.learned.reno.stream import RenoStream as RenoStream
    from puckbench.learned.reno.stream import read_stream as read_stream
    from puckbench.learned.reno.stream import write_stream as write_stream
    from puckbench.learned.reno.weights import RenoWeights as RenoWeights
    from puckbench.learned.reno.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    stream=("RenoStream", "read_stream", "write_stream"),
    weights=("RenoWeights", "load_weights"),
)
