"""Streams of our scenes by the reference software (benchmarks/checks/gpcc_vectors.py)."""

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpcc.coder import PROFILES, decode_geometry, encode_geometry
from gpcc.conformance import FOLDER
from gpcc.grid import quantise, unwrap
from gpcc.options import SPINNING
from gpcc.sensor import SensorDescription
from pointkit.errors import InputError
from pointkit.files import read_json
from tests.support.small_turn import SENSOR, small_turn
from tests.support.stream_damage import damaged

MANIFEST: dict[str, dict[str, Any]] = read_json(FOLDER / "manifest.json")
LEFT_OUT = {
    "bytewise_minimal": "bytewise",
    "trisoup": "trisoup",
    "quantised_in_loop": "scaling",
}
"""Vectors of tools that we do not have, and what the error says."""


def _decoded(name: str) -> np.ndarray:
    return decode_geometry((FOLDER / f"{name}.bin").read_bytes()).positions()


@pytest.mark.parametrize("name", sorted(MANIFEST.keys() - LEFT_OUT.keys()))
def test_a_stream_decodes_to_the_points_that_tmc13_decodes(name: str) -> None:
    points = _decoded(name)
    ordered = points[np.lexsort(points.T[::-1])].astype("<f8")
    assert len(points) == MANIFEST[name]["points_out"]
    assert hashlib.sha256(ordered.tobytes()).hexdigest() == MANIFEST[name]["sha256_sorted_float64"]


@pytest.mark.parametrize("name", LEFT_OUT)
def test_a_stream_with_unsupported_tools_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=LEFT_OUT[name]):
        _decoded(name)


# What the encoder is told besides the profile; not here: options that only a decoder knows.
CHOICES: dict[str, dict[str, Any]] = {
    "neighbours4_minimal": {"neighbour_avail_boundary_log2": 4},
    "siblings_minimal": {"neighbour_avail_boundary_log2": 0},
    "no_adjacent_minimal": {"adjacent_child_contextualization": False},
    "idcm2_defaults": {"inferred_direct_coding_mode": 2},
    "idcm3_defaults": {"inferred_direct_coding_mode": 3},
    "one_point_idcm_defaults": {"joint_two_point_idcm": False},
    "planar_idcm_ctc": {"inferred_direct_coding_mode": 1, "planar_mode_idcm_use": 32},
}
SPINS: dict[str, dict[str, Any]] = {
    "spin": {},
    "spin_merged": {"merge_duplicates": True},
    "spin_buffer": {"planar_buffer": True},
    "spin_no_planes": {"planar": False},
    "spin_no_direct": {"inferred_direct_coding_mode": 0},
    "spin_direct_1": {"inferred_direct_coding_mode": 1},
    "spin_direct_2": {"inferred_direct_coding_mode": 2},
    "spin_one_by_one": {"joint_two_point_idcm": False},
    "spin_cube": {"qtbt": False},
    "spin_siblings": {"neighbour_avail_boundary_log2": 0},
    "spin_away": {},
    "spin_pairs": {},
}
SENSORS = {"angular": SensorDescription((0.0,), (0.0,), 800)}
DECODER_ONLY = {
    *("zyx_ctc", "bypass_defaults", "streams_defaults"),
    *("sliced_minimal", "sliced_ctc", "tiled_defaults"),
    *(name for name in MANIFEST if name.startswith("spin")),
}
PREDICTIVE = {name for name, about in MANIFEST.items() if "--geomTreeType=1" in about["options"]}
"""See test_predictive.py."""


@pytest.mark.parametrize(
    "name", sorted(MANIFEST.keys() - LEFT_OUT.keys() - DECODER_ONLY - PREDICTIVE)
)
def test_encoding_the_decoded_points_gives_the_bytes_of_tmc13(name: str) -> None:
    stream = (FOLDER / f"{name}.bin").read_bytes()
    about, decoded = MANIFEST[name], decode_geometry(stream)
    kept = "--mergeDuplicatedPoints=0" in about["options"]
    choices = {"merge_duplicates": not kept, **CHOICES.get(name, {})}
    options = PROFILES[about["profile"]].model_copy(update=choices)
    shuffled = np.random.default_rng(0).permutation(decoded.points)
    place = {"scale": decoded.scale, "origin": decoded.origin}
    assert encode_geometry(shuffled, options, **place, sensor=SENSORS.get(name)) == stream


@pytest.mark.parametrize("name", SPINS)
def test_encoding_a_turn_with_its_sensor_gives_the_bytes_of_tmc13(name: str) -> None:
    """Points alone in a node are coded in the order of the cloud, so it is that of the turn."""
    points = small_turn().astype(int)
    if name == "spin_pairs":
        points = np.repeat(points, 2, axis=0)
    options = PROFILES["ctc"].model_copy(update={**SPINNING, **SPINS[name]})
    position = (-900, 40000, 12) if name == "spin_away" else (0, 0, 0)
    stream = encode_geometry(points, options, sensor=replace(SENSOR, position=position))
    assert stream == (FOLDER / f"{name}.bin").read_bytes()


def test_a_coarse_turn_splits_later_along_z() -> None:
    points = small_turn() / 8
    points = np.trunc(points + np.copysign(0.5, points)).astype(int)  # as C's round
    split = {
        "angular_max_node_min_dim_log2_to_split_z": 5,
        "angular_max_diff_to_split_z": 0,
    }
    options = PROFILES["ctc"].model_copy(update={**SPINNING, **split})
    heights = tuple(height / 8 for height in SENSOR.height)
    mine = encode_geometry(points, options, 1 / 8, sensor=replace(SENSOR, height=heights))
    assert mine == (FOLDER / "spin_coarse.bin").read_bytes()


def test_quantising_and_coding_gives_the_bytes_of_tmc13_from_real_coordinates_on() -> None:
    """The points of this vector are whole numbers, many of them negative."""
    about, scale = MANIFEST["away_minimal"], MANIFEST["away_minimal"]["scale"]
    positions, origin = quantise(_decoded("away_minimal"), scale=scale)
    stream = encode_geometry(positions, PROFILES[about["profile"]], scale, origin)
    assert stream == (FOLDER / "away_minimal.bin").read_bytes()


def test_damaged_streams_end_in_points_or_one_clean_error() -> None:
    """400 of the streams of benchmarks/checks/fuzz.py, which takes thousands under limits."""
    streams = [(FOLDER / f"{name}.bin").read_bytes() for name in sorted(MANIFEST)]
    outcomes = [_outcome(damaged(streams, number)) for number in range(400)]
    assert not any("\n" in outcome for outcome in outcomes)
    assert 3 < outcomes.count("finite points") < 380


def _outcome(stream: bytes) -> str:
    try:
        points = decode_geometry(unwrap(stream).stream).positions()
        return "finite points" if np.isfinite(points).all() else "\n"
    except InputError as error:
        return str(error)
