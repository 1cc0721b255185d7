"""A codec that describes a point cloud by planes in an octree and by surfaces of revolution.

`encode` compresses coordinates (n, 3) to bytes, at the rate of a `PrimitiveSettings`. Three
functions decompress these bytes: `decode` returns points, `decode_surface` returns points with
normals, and `decode_mesh` returns triangles that are labelled by primitive.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from primitive_codec.decoder import DecodedSurface as DecodedSurface
    from primitive_codec.decoder import decode as decode
    from primitive_codec.decoder import decode_surface as decode_surface
    from primitive_codec.mesh_reconstruction import decode_mesh as decode_mesh
    from primitive_codec.mode_decision import SurfaceCache as SurfaceCache
    from primitive_codec.mode_decision import encode as encode
    from primitive_codec.settings import RATES as RATES
    from primitive_codec.settings import PrimitiveSettings as PrimitiveSettings

__getattr__, __dir__, __all__ = lazy(
    __name__,
    decoder=("DecodedSurface", "decode", "decode_surface"),
    mesh_reconstruction=("decode_mesh",),
    mode_decision=("SurfaceCache", "encode"),
    settings=("RATES", "PrimitiveSettings"),
)
