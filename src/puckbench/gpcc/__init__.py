"""G-PCC geometry (ISO/IEC 23090-9): octree and predictive coding that TMC13 reads and writes.

Names are those of the standard and of its reference software, TMC13 release-v14.0.
"""

from typing import TYPE_CHECKING

from puckbench.core.lazy import lazy

if TYPE_CHECKING:
    from puckbench.gpcc.coder import DecodedGeometry as DecodedGeometry
    from puckbench.gpcc.coder import decode_geometry as decode_geometry
    from puckbench.gpcc.coder import encode_geometry as encode_geometry

__getattr__, __dir__, __all__ = lazy(
    __name__,
    coder=("DecodedGeometry", "decode_geometry", "encode_geometry"),
)
