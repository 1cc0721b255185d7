from __future__ import annotations

import numpy as np

from puckbench.core.errors import InputError
from puckbench.geometry.morton import Ints
from puckbench.gpcc import predictive, predictive_encoder
from puckbench.gpcc.arithmetic import Probabilities, consumed, encoder, enlarged, finish
from puckbench.gpcc.kd_tree import Int32s
from puckbench.gpcc.prediction_tree import PredictionTree
from puckbench.gpcc.predictive import Tools, TreeNodes
from puckbench.gpcc.predictive_encoder import NODE_BYTES, EncoderState
from puckbench.gpcc.slices import CodedSlice, sensor_position, slice_decoder
from puckbench.gpcc.spherical import sphere
from puckbench.gpcc.syntax import GeometryHeader, GeometryParameterSet, SequenceParameterSet, Three

_FAULTS = {
    predictive.TOO_MANY_POINTS: "a slice holds more points than it says",
    predictive.EXHAUSTED: "a slice's data are damaged or truncated",
    predictive.DAMAGED: "a slice's data are damaged or truncated",
}
_MOST_INTERVAL_LOG2 = 30


def decode_trees(
    coded: CodedSlice,
    sps: SequenceParameterSet,
    gps: GeometryParameterSet,
    contexts: Probabilities,
    axes: Three,
    origin: Three,
) -> TreeNodes:
    tools = tools_of(coded.header, gps, axes, origin)
    nodes = empty_nodes(coded.points, angular=tools.angular)
    coder = slice_decoder(contexts, coded, sps)
    done = predictive.decode_trees(coder, tools, nodes)
    if done < 0 or consumed(coder) > coder.state[4]:
        fault = _FAULTS[done if done < 0 else predictive.EXHAUSTED]
        raise InputError(f"G-PCC stream: {fault}")
    if done != coded.points:
        raise InputError("G-PCC stream: a slice holds fewer points than it says")
    return nodes


def placed(points: Int32s, axes: Three, origin: Three) -> Ints:
    """Convert points (n, 3) from the coded axes to x, y, z, and add `origin`."""
    result: Ints = (
        points.astype(np.int64)[:, axes] if axes != (0, 1, 2) else points.astype(np.int64)
    )
    result += origin
    return result


def tools_of(
    header: GeometryHeader, gps: GeometryParameterSet, axes: Three, origin: Three
) -> Tools:
    """Return the coding tools of a slice; raise InputError if invalid."""
    multiplier = gps.geom_qp_multiplier_log2
    slice_qp = (gps.geom_base_qp + header.geom_slice_qp_offset) << multiplier
    if not 0 <= slice_qp <= predictive.MOST_QP:
        raise InputError("G-PCC stream: the header of a slice is damaged")
    # TMC13 writes a negative difference as an unsigned 32-bit number.
    interval = (gps.geom_qp_offset_intvl_log2 + header.geom_qp_offset_intvl_log2_delta) % (1 << 32)
    return Tools(
        unique_points=bool(gps.geom_unique_points_flag),
        angular=bool(gps.geom_angular_mode_enabled_flag),
        azimuth_scaling=bool(gps.azimuth_scaling_enabled_flag),
        azimuth_speed=gps.geom_angular_azimuth_speed_minus1 + 1,
        min_radius=header.pgeom_min_radius,
        resid_abs_log2_bits=header.pgeom_resid_abs_log2_bits,
        scaling=bool(gps.geom_scaling_enabled_flag),
        qp_multiplier_log2=multiplier,
        slice_qp=slice_qp,
        qp_interval=1 << min(interval, _MOST_INTERVAL_LOG2),
        sphere=sphere(gps, sensor_position(header, gps, axes, origin)),
    )


def empty_nodes(points: int, *, angular: bool) -> TreeNodes:
    return TreeNodes(
        np.empty((points, 3), dtype=np.int32),
        np.empty((points if angular else 0, 3), dtype=np.int32),
        np.empty(points, dtype=np.int32),
        np.empty(points, dtype=np.int32),
    )


def encode_trees(
    tree: PredictionTree,
    points: Int32s,
    positions: Int32s,
    tools: Tools,
    contexts: Probabilities,
    order: Int32s,
) -> bytes | None:
    """Return the arithmetic-coded part of a data unit, or None if a residual does not fit.

    points, positions, order: see `predictive_encoder.EncoderState`.
    """
    stack = np.empty(len(points) + 2, dtype=np.int32)
    state = EncoderState(tree, points, positions, stack, np.zeros(4, dtype=np.int64), order)
    coder = encoder(contexts, NODE_BYTES + 4 * len(points))
    while True:
        ended = predictive_encoder.encode_trees(coder, tools, state)
        if ended != predictive_encoder.FULL:
            break
        coder = enlarged(coder, NODE_BYTES + len(coder.data))
    return finish(coder) if ended == predictive_encoder.DONE else None
