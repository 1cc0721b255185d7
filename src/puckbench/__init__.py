"""A reproducible benchmark of point-cloud compression on virtual and real LiDAR scans.

As a library::

    import puckbench

    puck = puckbench.open_codec("puck")
    for turn in puckbench.turns("recording.pcap"):
        stream = puckbench.encoded(puck, turn, "2mm")
        decoded = puckbench.decoded(puck, stream)
        print(8 * len(stream) / len(turn), puckbench.measures(turn, decoded)["range_rms_mm"])
"""

import sys
from typing import TYPE_CHECKING

from pointkit.lazy import lazy
from puckbench.moved import MovedModules

if TYPE_CHECKING:
    from puckbench.library import InputError as InputError
    from puckbench.library import PointCloud as PointCloud
    from puckbench.library import bd_rate as bd_rate
    from puckbench.library import compare as compare
    from puckbench.library import decoded as decoded
    from puckbench.library import encoded as encoded
    from puckbench.library import encoded_within as encoded_within
    from puckbench.library import measures as measures
    from puckbench.library import open_codec as open_codec
    from puckbench.library import prepare as prepare
    from puckbench.library import read_cloud as read_cloud
    from puckbench.library import turns as turns

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy(
    __name__,
    library=(
        *("InputError", "PointCloud", "bd_rate", "compare", "decoded", "encoded"),
        *("encoded_within", "measures", "open_codec", "prepare", "read_cloud", "turns"),
    ),
)

sys.meta_path.append(MovedModules())
