"""Inter-LPCM: networks that predict the points of a spinning sensor's turn along its lines.

`load_weights` reads the weights of the authors, `encode` compresses a turn to bytes, and `decode`
returns its points in the same order. Points are predicted from those before them in their line
and, if both sides have it, from the preceding turn.

References
----------
Sun et al.: "Inter-LPCM: Learning-based Inter-Frame Predictive Coding for LiDAR Point Cloud
Compression", arXiv 2605.18006, 2026.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pcc_networks.inter_lpcm.codec import CodedTurn as CodedTurn
    from pcc_networks.inter_lpcm.codec import decode as decode
    from pcc_networks.inter_lpcm.codec import encode as encode
    from pcc_networks.inter_lpcm.codec import encode_turn as encode_turn
    from pcc_networks.inter_lpcm.prediction import reference_of as reference_of
    from pcc_networks.inter_lpcm.stream import read_stream as read_stream
    from pcc_networks.inter_lpcm.weights import LpcmWeights as LpcmWeights
    from pcc_networks.inter_lpcm.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("CodedTurn", "decode", "encode", "encode_turn"),
    prediction=("reference_of",),
    stream=("read_stream",),
    weights=("LpcmWeights", "load_weights"),
)
