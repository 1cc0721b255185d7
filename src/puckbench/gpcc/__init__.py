"""Point cloud codec G-PCC (ISO/IEC 23090-9:2023): geometry and attributes.

Streams and names are those of TMC13 release-v14.0, the reference software. Damaged or unsupported
streams, and points that cannot be encoded, raise `puckbench.core.errors.InputError`.
"""

from typing import TYPE_CHECKING

from puckbench.core.lazy import lazy

if TYPE_CHECKING:
    from puckbench.gpcc.attributes.cloud import DecodedCloud as DecodedCloud
    from puckbench.gpcc.attributes.cloud import decode_cloud as decode_cloud
    from puckbench.gpcc.attributes.cloud import encode_cloud as encode_cloud
    from puckbench.gpcc.attributes.options import ATTRIBUTE_PROFILES as ATTRIBUTE_PROFILES
    from puckbench.gpcc.attributes.options import AttributeOptions as AttributeOptions
    from puckbench.gpcc.coder import DecodedGeometry as DecodedGeometry
    from puckbench.gpcc.coder import decode_geometry as decode_geometry
    from puckbench.gpcc.coder import encode_geometry as encode_geometry
    from puckbench.gpcc.conformance import ConformanceStream as ConformanceStream
    from puckbench.gpcc.conformance import Verdict as Verdict
    from puckbench.gpcc.conformance import conformance_streams as conformance_streams
    from puckbench.gpcc.conformance import decode_rows as decode_rows
    from puckbench.gpcc.conformance import program_decoder as program_decoder
    from puckbench.gpcc.conformance import verdicts as verdicts
    from puckbench.gpcc.grid import InputGrid as InputGrid
    from puckbench.gpcc.grid import quantise as quantise
    from puckbench.gpcc.lossless import decode_voxels as decode_voxels
    from puckbench.gpcc.lossless import encode_voxels as encode_voxels
    from puckbench.gpcc.options import PROFILES as PROFILES
    from puckbench.gpcc.options import SPINNING as SPINNING
    from puckbench.gpcc.options import GpccOptions as GpccOptions
    from puckbench.gpcc.predictive_coder import PredictiveOptions as PredictiveOptions
    from puckbench.gpcc.predictive_coder import (
        encode_predictive_geometry as encode_predictive_geometry,
    )
    from puckbench.gpcc.sensor import SensorDescription as SensorDescription

__getattr__, __dir__, __all__ = lazy(
    __name__,
    coder=("DecodedGeometry", "decode_geometry", "encode_geometry"),
    conformance=(
        "ConformanceStream",
        "Verdict",
        "conformance_streams",
        "decode_rows",
        "program_decoder",
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
