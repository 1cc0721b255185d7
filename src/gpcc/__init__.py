"""Encoder and decoder of G-PCC (ISO/IEC 23090-9:2023): positions and attributes of points.

Streams are those of TMC13 release-v14.0, the reference software, whose names of options and syntax
elements are used. `pointkit.errors.InputError` is raised for damaged or unsupported streams, and
for points that cannot be encoded.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from gpcc.attributes.cloud import DecodedCloud as DecodedCloud
    from gpcc.attributes.cloud import decode_cloud as decode_cloud
    from gpcc.attributes.cloud import encode_cloud as encode_cloud
    from gpcc.attributes.options import ATTRIBUTE_PROFILES as ATTRIBUTE_PROFILES
    from gpcc.attributes.options import AttributeOptions as AttributeOptions
    from gpcc.coder import DecodedGeometry as DecodedGeometry
    from gpcc.coder import decode_geometry as decode_geometry
    from gpcc.coder import encode_geometry as encode_geometry
    from gpcc.conformance import ConformanceStream as ConformanceStream
    from gpcc.conformance import Verdict as Verdict
    from gpcc.conformance import conformance_streams as conformance_streams
    from gpcc.conformance import decode_rows as decode_rows
    from gpcc.conformance import verdicts as verdicts
    from gpcc.grid import InputGrid as InputGrid
    from gpcc.grid import quantise as quantise
    from gpcc.lossless import decode_voxels as decode_voxels
    from gpcc.lossless import encode_voxels as encode_voxels
    from gpcc.options import PROFILES as PROFILES
    from gpcc.options import SPINNING as SPINNING
    from gpcc.options import GpccOptions as GpccOptions
    from gpcc.predictive_coder import PredictiveOptions as PredictiveOptions
    from gpcc.predictive_coder import encode_predictive_geometry as encode_predictive_geometry
    from gpcc.sensor import SensorDescription as SensorDescription

__getattr__, __dir__, __all__ = lazy(
    __name__,
    coder=("DecodedGeometry", "decode_geometry", "encode_geometry"),
    conformance=(
        "ConformanceStream",
        "Verdict",
        "conformance_streams",
        "decode_rows",
        "verdicts",
    ),
    grid=("InputGrid", "quantise"),
    lossless=("decode_voxels", "encode_voxels"),
    options=("PROFILES", "SPINNING", "GpccOptions"),
    predictive_coder=("PredictiveOptions", "encode_predictive_geometry"),
    sensor=("SensorDescription",),
    **{
        "attributes.cloud": ("DecodedCloud", "decode_cloud", "encode_cloud"),
        "attributes.options": ("ATTRIBUTE_PROFILES", "AttributeOptions"),
    },
)
