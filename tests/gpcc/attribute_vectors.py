"""A small cloud, and the options with which the reference software coded it.

`benchmarks/checks/gpcc_attribute_vectors.py` makes the streams.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpcc.attributes.options import AttributeOptions
from gpcc.conformance import FOLDER as GEOMETRY_FOLDER
from gpcc.options import GpccOptions
from gpcc.predictive_coder import PredictiveOptions
from gpcc.sensor import SensorDescription

FOLDER = GEOMETRY_FOLDER / "attributes"
Rows = NDArray[np.int64]

_LASERS = 8
_ANGLES = tuple(round(0.05 * k - 0.2, 3) for k in range(_LASERS))
SENSOR = SensorDescription(_ANGLES, (0.0,) * _LASERS, 100)


def points() -> Rows:
    """Return a turn of a sensor in a room, with some equal points (n, 3)."""
    azimuth = np.repeat(np.arange(100) * (2 * np.pi / 100), _LASERS)
    elevation = np.tile(_ANGLES, 100)
    distance = 900 / np.maximum(abs(np.cos(azimuth)), abs(np.sin(azimuth)))
    distance += 30 * np.sin(40 * azimuth + 9 * elevation)
    rays = np.column_stack([np.cos(azimuth), np.sin(azimuth), elevation])
    cloud = np.rint(rays * distance[:, None]).astype(np.int64)
    cloud[::50] = cloud[7]
    return cloud


def reflectances(cloud: Rows) -> Rows:
    waves = np.sin(cloud[:, 0] / 60) + np.cos(cloud[:, 1] / 45) + cloud[:, 2] / 300
    return np.clip(120 + 50 * waves + np.arange(len(cloud)) % 7, 0, 255).astype(np.int64)


def colours(cloud: Rows) -> Rows:
    first = reflectances(cloud)
    second = np.clip(255 - first + np.arange(len(cloud)) % 5, 0, 255)
    return np.column_stack([first, second, (first + 2 * second) // 3])


_KEPT = ("--mergeDuplicatedPoints=0",)
_PLAIN = ("--planarEnabled=0", "--qtbtEnabled=0", "--inferredDirectCodingMode=0")
_PLAIN = (*_PLAIN, "--neighbourAvailBoundaryLog2=8")
_LASER_OPTIONS = (
    *("--angularEnabled=1", f"--numLasers={_LASERS}", "--planarBufferDisabled=1"),
    f"--lasersTheta={','.join(map(str, _ANGLES))}",
    f"--lasersZ={','.join(['0'] * _LASERS)}",
    f"--lasersNumPhiPerTurn={','.join(['100'] * _LASERS)}",
)
GEOMETRIES = {
    "octree": (*_PLAIN, *_KEPT),
    "merged": _PLAIN,
    "angular": (*_PLAIN, *_KEPT, *_LASER_OPTIONS),
    "trees": ("--geomTreeType=1", *_KEPT, "--predGeomSort=2", "--predGeomAzimuthSortPrecision=8"),
}
_ALL = {"intraLodPredictionSkipLayers": 0, "levelOfDetailCount": 8}
_REFLECTANCE = "--attribute=reflectance"


def _options(**values: Any) -> tuple[str, ...]:
    return tuple(f"--{name}={value}" for name, value in values.items())


VECTORS = {
    "nearest": (
        "octree",
        (
            *_options(levelOfDetailCount=0, intraLodPredictionSkipLayers=0),
            *_options(direct_avg_predictor_disabled_flag=1, lod_neigh_bias="1,2,3"),
            _REFLECTANCE,
        ),
    ),
    "distance": ("octree", (*_options(**_ALL, qp=16, predWeightBlending=1), _REFLECTANCE)),
    "centroid": (
        "trees",
        (*_options(**_ALL, lodDecimator=2, lodSamplingPeriod=3, bitdepth=12), _REFLECTANCE),
    ),
    "angular": ("angular", (*_options(**_ALL, spherical_coord_flag=1), _REFLECTANCE)),
    "both": (
        "octree",
        (
            *_options(**_ALL, colourMatrix=8, interComponentPredictionEnabled=1),
            "--attribute=color",
            *_options(max_num_direct_predictors=1, interComponentPredictionEnabled=0),
            *_options(attrOffset=-3, attrScale=2),
            _REFLECTANCE,
        ),
    ),
    "lifting": (
        "octree",
        (*_options(transformType=2, levelOfDetailCount=8, lodDecimator=1, qp=28), _REFLECTANCE),
    ),
    "lifting_colours": (
        "merged",
        (
            *_options(transformType=2, levelOfDetailCount=8, qp=28, qpChromaOffset=2),
            *_options(qpLayerOffsetsLuma="1,0,-2", qpLayerOffsetsChroma="0,1,1"),
            "--attribute=color",
        ),
    ),
    "raht": ("octree", (*_options(transformType=0, qp=22), _REFLECTANCE)),
    "raht_colours": ("merged", (*_options(transformType=0, qp=22), "--attribute=color")),
}
"""Geometry and options of each stream."""

_OCTREE = GpccOptions(merge_duplicates=False)
OURS: dict[str, tuple[GpccOptions | PredictiveOptions, dict[str, AttributeOptions]]] = {
    "nearest": (
        _OCTREE,
        {
            "reflectance": AttributeOptions(
                level_of_detail_count=0,
                intra_lod_prediction_skip_layers=0,
                direct_avg_predictor_disabled=True,
                lod_neigh_bias=(1, 2, 3),
            )
        },
    ),
    "distance": (
        _OCTREE,
        {
            "reflectance": AttributeOptions(
                level_of_detail_count=8,
                intra_lod_prediction_skip_layers=0,
                qp=16,
                pred_weight_blending=True,
            )
        },
    ),
    "centroid": (
        PredictiveOptions(azimuth_sort_precision=8.0),
        {
            "reflectance": AttributeOptions(
                level_of_detail_count=8,
                intra_lod_prediction_skip_layers=0,
                lod_decimator="centroid",
                lod_sampling_period=(3,),
                bitdepth=12,
            )
        },
    ),
    "angular": (
        GpccOptions(merge_duplicates=False, planar_buffer=False),
        {
            "reflectance": AttributeOptions(
                level_of_detail_count=8, intra_lod_prediction_skip_layers=0, spherical_coord=True
            )
        },
    ),
    "both": (
        _OCTREE,
        {
            "color": AttributeOptions(
                level_of_detail_count=8,
                intra_lod_prediction_skip_layers=0,
                colour_matrix="ycgco",
                inter_component_prediction=True,
            ),
            "reflectance": AttributeOptions(
                level_of_detail_count=8,
                intra_lod_prediction_skip_layers=0,
                max_num_direct_predictors=1,
                attr_offset=-3,
                attr_scale=2,
            ),
        },
    ),
    "lifting": (
        _OCTREE,
        {
            "reflectance": AttributeOptions(
                transform="lifting", level_of_detail_count=8, lod_decimator="periodic", qp=28
            )
        },
    ),
    "lifting_colours": (
        GpccOptions(),
        {
            "color": AttributeOptions(
                transform="lifting",
                level_of_detail_count=8,
                qp=28,
                qp_chroma_offset=2,
                qp_layer_offsets_luma=(1, 0, -2),
                qp_layer_offsets_chroma=(0, 1, 1),
            )
        },
    ),
    "raht": (_OCTREE, {"reflectance": AttributeOptions(transform="raht", qp=22)}),
    "raht_colours": (GpccOptions(), {"color": AttributeOptions(transform="raht", qp=22)}),
}
"""The same as options of our encoder."""
