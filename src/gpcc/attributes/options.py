"""Options of the encoder of attributes, with TMC13's names, and named sets of options."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pointkit.models import Model

_Byte = Annotated[int, Field(ge=0, le=255)]
_SearchRange = Annotated[int, Field(ge=-1, le=1_100_000)]
_Factor = Annotated[int, Field(ge=1, le=256)]
_Share = Annotated[int, Field(ge=0, le=256)]
_Period = Annotated[int, Field(ge=2, le=1 << 24)]
_QpOffset = Annotated[int, Field(ge=-99, le=99)]


class AttributeOptions(Model):
    """Options of the encoder of an attribute, which have the names and meanings of TMC13's.

    The defaults predict each point's value from up to three near points. With the default `qp` 4,
    this is lossless for reflectances, and also for colours if `colour_matrix` is not ``bt709``.
    """

    transform: Literal["raht", "predicting", "lifting"] = Field(
        "predicting", description="transform of the values"
    )
    bitdepth: int = Field(8, ge=1, le=16, description="bits of each value")
    attr_scale: int = Field(
        1, ge=1, le=1 << 16, description="divisor of reflectances before coding"
    )
    attr_offset: int = Field(
        0, ge=-0xFFFF, le=0xFFFF, description="subtracted from reflectances before scaling"
    )
    colour_matrix: Literal["identity", "bt709", "ycgco"] = Field(
        "bt709", description="conversion of colours before coding; ycgco is reversible"
    )
    raht_prediction_enabled: bool = Field(True, description="predict coefficients of RAHT")
    raht_prediction_threshold0: int = Field(
        2, ge=0, le=19, description="least number of a grandparent's neighbours"
    )
    raht_prediction_threshold1: int = Field(
        6, ge=0, le=19, description="least number of a parent's neighbours"
    )
    number_of_nearest_neighbors_in_prediction: int = Field(
        3, ge=1, le=3, description="maximum number of neighbours that predict a point"
    )
    adaptive_prediction_threshold: _Byte = Field(
        64,
        description="least difference between neighbours, in 8 bits, at which one of them may be "
        "the prediction",
    )
    intra_lod_search_range: _SearchRange = Field(
        -1, description="points searched in the same level; -1: all"
    )
    inter_lod_search_range: _SearchRange = Field(
        -1, description="points searched in coarser levels; -1: all"
    )
    lod_neigh_bias: tuple[_Factor, _Factor, _Factor] = Field(
        (1, 1, 1), description="factors of distances along x, y and z"
    )
    lod_decimator: Literal["distance", "periodic", "centroid"] = Field(
        "distance", description="how points of coarser levels are selected"
    )
    lod_sampling_period: tuple[_Period, ...] = Field(
        (4,),
        min_length=1,
        description="n for each level from the finest: one of n points is in coarser levels",
    )
    max_num_direct_predictors: int = Field(
        3, ge=0, le=3, description="number of neighbours that may be the prediction"
    )
    direct_avg_predictor_disabled: bool = Field(
        False, description="do not predict by the average where a neighbour may predict"
    )
    pred_weight_blending: bool = Field(
        False, description="adapt weights to the distances between neighbours"
    )
    level_of_detail_count: _Byte = Field(
        1, description="maximum number of levels of detail, minus 1"
    )
    dist2: int = Field(
        0, ge=0, le=20, description="log2 of the distance of points in the finest level"
    )
    dist2_percentile_estimate: float = Field(
        0.85, ge=0, lt=1, description="share of points nearer to another than that distance"
    )
    intra_lod_prediction_skip_layers: Annotated[int, Field(ge=-1, le=255)] = Field(
        -1,
        description="number of finest levels whose points do not predict each other; -1: all",
    )
    inter_component_prediction: bool = Field(
        False, description="predict components from the first (predicting transform)"
    )
    last_component_prediction: bool = Field(
        True, description="predict the third component from the second (lifting transform)"
    )
    canonical_point_order: bool = Field(
        False, description="with one level: keep the order of the geometry"
    )
    spherical_coord: bool = Field(
        False, description="with a sensor: distances in radius, azimuth and laser"
    )
    qp: int = Field(
        4, ge=4, le=51, description="quantisation parameter; 4 is lossless if predicting"
    )
    qp_chroma_offset: int = Field(
        0, ge=-47, le=47, description="added to it for the second and third component"
    )
    qp_layer_offsets_luma: tuple[_QpOffset, ...] = Field(
        (), description="added to it for each level from the coarsest"
    )
    qp_layer_offsets_chroma: tuple[_QpOffset, ...] = Field(
        (), description="further offsets of the second and third component"
    )
    quant_neigh_weight: tuple[_Share, _Share, _Share] = Field(
        (16, 8, 4), description="shares of a point's weight that its neighbours get, of 256"
    )


_NEAREST = AttributeOptions(
    level_of_detail_count=0,
    intra_lod_prediction_skip_layers=0,
    direct_avg_predictor_disabled=True,
)
ATTRIBUTE_PROFILES = {
    "defaults": AttributeOptions(),
    "lossless": AttributeOptions(
        level_of_detail_count=12, intra_lod_prediction_skip_layers=0, colour_matrix="ycgco"
    ),
    "lossless_lidar": _NEAREST,
    "near_lossless_lidar": _NEAREST.replaced(qp=16),
    "lifting": AttributeOptions(transform="lifting", level_of_detail_count=12, qp=34),
    "lifting_lidar": AttributeOptions(
        transform="lifting", level_of_detail_count=12, lod_decimator="periodic", qp=34
    ),
    "raht": AttributeOptions(transform="raht", qp=34),
}
"""Named sets of options.

`defaults` are those of TMC13. The others are MPEG's test conditions for a transform; names with
`_lidar` are for frames of sensors (category 3). Lossy sets have a medium rate, which `qp` changes.
"""

_QPS = (51, 46, 40, 34, 28, 22)
"""Quantisation parameters of the rates r01 to r06 of MPEG's common test conditions."""
_SCALES = (1 / 8, 1 / 4, 1 / 2, 3 / 4, 7 / 8, 15 / 16)
"""Scales of the rates r01 to r06 for clouds of 10 bits."""
_LOG2_STEPS = np.log2([0.004, 0.008, 0.032, 0.064, 0.256, 0.512])
"""Log2 of the grid steps (m) of the rates r06 to r01 for frames of 18 bits at 1 mm."""
_EIGHT_BITS, _TO_EIGHT_BITS = 255, 257


def qp_of_scale(scale: float) -> int:
    """Return the quantisation parameter (QP) that suits the scale at which positions are coded.

    It is interpolated between the rates of MPEG's test conditions for clouds of 10 bits.
    """
    return round(float(np.interp(scale, _SCALES, _QPS)))


def qp_of_step(step_m: float) -> int:
    """Return the quantisation parameter (QP) that suits a grid step of the positions in metres.

    It is interpolated between the rates of MPEG's test conditions for frames of sensors.
    """
    return round(float(np.interp(np.log2(step_m), _LOG2_STEPS, _QPS[::-1])))


def mpeg_conditions(
    attributes: Mapping[str, NDArray[Any]],
    qp: int | None,
    transform: Literal["raht", "lifting"] = "raht",
    *,
    spherical: bool = False,
) -> dict[str, AttributeOptions]:
    """Return the options with which MPEG's test conditions code attributes.

    Parameters
    ----------
    attributes
        Values by name, as in `encode_cloud`: ``color`` of 8 bits, ``reflectance`` of 8 or 16 bits.
    qp
        Quantisation parameter of all attributes, from 4 to 51; None selects lossless coding. Lossy
        coding divides reflectances of 16 bits by 257, so that they have 8 bits.
    transform
        Transform for lossy coding.
    spherical
        Whether distances between points are measured in radius, azimuth and laser index.

    Returns
    -------
    dict
        The options of each attribute by name, for `encode_cloud`.
    """
    chosen = {}
    for name, values in attributes.items():
        lidar = "_lidar" if name == "reflectance" else ""
        lossy = "raht" if transform == "raht" else f"lifting{lidar}"
        options = ATTRIBUTE_PROFILES[f"lossless{lidar}" if qp is None else lossy]
        more: dict[str, Any] = {"spherical_coord": spherical}
        is_wide = bool(lidar) and values.max(initial=0) > _EIGHT_BITS
        if qp is not None:
            more |= {"qp": qp, "attr_scale": _TO_EIGHT_BITS if is_wide else 1}
        elif is_wide:
            more["bitdepth"] = 16
        chosen[name] = options.replaced(**more)
    return chosen
