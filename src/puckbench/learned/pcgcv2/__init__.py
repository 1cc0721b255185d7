"""PCGCv2: multiscale learned point-cloud geometry coding with sparse convolutions.

References
----------
Wang et al.: "Multiscale Point Cloud Geometry Compression", DCC 2021.
"""

from typing import TYPE_CHECKING

from puckbench.core.lazy import lazy

if TYPE_CHECKING:
    from puckbench.learned.pcgcv2.codec import decode as decode
    from puckbench.learned.pcgcv2.codec import encode as encode
    from puckbench.learned.pcgcv2.model import PCGCv2 as PCGCv2
    from puckbench.learned.pcgcv2.model import Pcgcv2Shape as Pcgcv2Shape
    from puckbench.learned.pcgcv2.stream import CodingTools as CodingTools
    from puckbench.learned.pcgcv2.stream import Pcgcv2Stream as Pcgcv2Stream
    from puckbench.learned.pcgcv2.stream import read_stream as read_stream
    from puckbench.learned.pcgcv2.stream import write_coded as write_coded
    from puckbench.learned.pcgcv2.training_settings import Pcgcv2Training as Pcgcv2Training
    from puckbench.learned.pcgcv2.weights import Pcgcv2Weights as Pcgcv2Weights
    from puckbench.learned.pcgcv2.weights import load_weights as load_weights

__getattr__, __dir__, __all__ = lazy(
    __name__,
    codec=("decode", "encode"),
    model=("PCGCv2", "Pcgcv2Shape"),
    stream=("CodingTools", "Pcgcv2Stream", "read_stream", "write_coded"),
    training_settings=("Pcgcv2Training",),
    weights=("Pcgcv2Weights", "load_weights"),
)
