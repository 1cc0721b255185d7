"""LiZIP: a perceptron that predicts each point of a LiDAR scan from three points before it.

`load_weights` reads a file of the authors, `encode` compresses points to bytes, and `decode`
returns points. The streams are those of the authors' program in C++, behind a header.

References
----------
Shibu, Karim and Zito: "LiZIP: An Auto-Regressive Compression Framework for LiDAR Point Clouds",
arXiv 2603.23162, 2026.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.lizip.codec import decode as decode
    from pcc_networks.lizip.codec import encode as encode
    from pcc_networks.lizip.stream import LizipStream as LizipStream
    from pcc_networks.lizip.stream import read_stream as read_stream
    from pcc_networks.lizip.stream import write_stream as write_stream
    from pcc_networks.lizip.weights import LizipWeights as LizipWeights
    from pcc_networks.lizip.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    stream=("LizipStream", "read_stream", "write_stream"),
    weights=("LizipWeights", "load_weights"),
)
