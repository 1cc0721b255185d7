"""Clouds and options of the conformance vectors that `benchmarks/checks/gpcc_vectors.py` makes."""

from tests.support.small_turn import SENSOR, STEPS

IN_LOOP = ("--positionQuantisationEnabled=1", "--positionBaseQp=8")
LASER = ("--lasersTheta=0", "--lasersZ=0", "--lasersNumPhiPerTurn=800")
KEPT = "--mergeDuplicatedPoints=0"
SLICED = ("--partitionMethod=4", "--sliceMaxPoints=1500", "--sliceMinPoints=500")

TREES = "--geomTreeType=1"
BY_AZIMUTH = (TREES, KEPT, "--predGeomSort=2", "--predGeomAzimuthSortPrecision=1024")
CONTINUED = (*SLICED, "--entropyContinuationEnabled=1")
SPINNING = (
    *("--angularEnabled=1", "--numLasers=8"),
    f"--lasersTheta={','.join(map(repr, SENSOR.tan_elevation))}",
    f"--lasersZ={','.join(repr(-height) for height in SENSOR.height)}",
    f"--lasersNumPhiPerTurn={','.join([str(STEPS)] * 8)}",
)


def spherical(radius_log2: int, azimuth_log2: int) -> tuple[str, ...]:
    """Options of a sensor's trees, with the residuals in x, y, z quantised where the radius is."""
    speed = round(2 ** (12 + azimuth_log2) / STEPS)
    steps = (f"--positionAzimuthScaleLog2={azimuth_log2}", f"--positionAzimuthSpeed={speed}")
    lossy = ("--positionQuantisationEnabled=1", "--positionBaseQp=58") if radius_log2 else ()
    return (
        *(*BY_AZIMUTH, *SPINNING, *steps, *lossy),
        f"--positionRadiusInvScaleLog2={radius_log2}",
    )


SPARSE = (
    *(KEPT, "--inferredDirectCodingMode=3", "--maxNumQtBtBeforeOt=6", "--planarModeIdcmUse=32"),
    *(*SPINNING, "--planarBufferDisabled=1"),
)
"""The octree's options for a spinning sensor in the common test conditions, beside `ctc`."""


# name: cloud, profile, scale, further options
VECTORS: dict[str, tuple[str, str, float, tuple[str, ...]]] = {
    "clean_minimal_0125": ("clean", "minimal", 0.125, ()),
    "clean_minimal_1": ("clean", "minimal", 1, ()),
    "clean_ctc_05": ("clean", "ctc", 0.5, ()),
    "clean_defaults_05": ("clean", "defaults", 0.5, ()),
    "noisy_minimal_0375": ("noisy", "minimal", 0.375, ()),
    "noisy_minimal_1": ("noisy", "minimal", 1, ()),
    "noisy_minimal_third": ("noisy", "minimal", 1 / 3, ()),
    "noisy_ctc_0125": ("noisy", "ctc", 0.125, ()),
    "noisy_ctc_1": ("noisy", "ctc", 1, ()),
    "noisy_arena_0125": ("noisy", "defaults", 0.125, ()),
    "noisy_arena_0875": ("noisy", "defaults", 0.875, ()),
    "noisy_arena_1": ("noisy", "defaults", 1, ()),
    "object_ctc_0625": ("object", "ctc", 0.625, ()),
    "object_arena_025": ("object", "defaults", 0.25, ()),
    "object_minimal_kept": ("object", "minimal", 0.0625, (KEPT,)),
    "object_ctc_kept": ("object", "ctc", 0.0625, (KEPT,)),
    "object_defaults_kept": ("object", "defaults", 0.125, (KEPT,)),
    "deep16_minimal": ("deep16", "minimal", 1, ()),
    "deep18_ctc": ("deep18", "ctc", 1, ()),
    "deep21_minimal": ("deep21", "minimal", 1, ()),
    "deep21_defaults": ("deep21", "defaults", 1, ()),
    "away_minimal": ("away", "minimal", 0.5, ()),
    "away_ctc": ("away", "ctc", 1, ()),
    "flat_minimal": ("flat", "minimal", 1, ()),
    "flat_ctc": ("flat", "ctc", 1, ()),
    "line_minimal": ("line", "minimal", 1, ()),
    "line_defaults": ("line", "defaults", 1, ()),
    "one_minimal": ("one", "minimal", 1, ()),
    "one_ctc": ("one", "ctc", 1, ()),
    "one_defaults": ("one", "defaults", 1, ()),
    "two_minimal": ("two", "minimal", 1, ()),
    "two_ctc": ("two", "ctc", 1, ()),
    "same_minimal_kept": ("same", "minimal", 1, (KEPT,)),
    "same_ctc_kept": ("same", "ctc", 1, (KEPT,)),
    "full_minimal": ("full", "minimal", 1, ()),
    "full_ctc": ("full", "ctc", 1, ()),
    "sliced_minimal": ("object", "minimal", 0.5, SLICED),
    "sliced_ctc": ("object", "ctc", 0.5, SLICED),
    "tiled_defaults": ("object", "defaults", 0.5, ("--tileSize=256", *SLICED)),
    "neighbours4_minimal": ("noisy", "minimal", 0.25, ("--neighbourAvailBoundaryLog2=4",)),
    "siblings_minimal": ("noisy", "minimal", 0.25, ("--neighbourAvailBoundaryLog2=0",)),
    "no_adjacent_minimal": ("noisy", "minimal", 0.25, ("--adjacentChildContextualization=0",)),
    "idcm2_defaults": ("noisy", "defaults", 0.5, ("--inferredDirectCodingMode=2",)),
    "idcm3_defaults": ("deep16", "defaults", 1, ("--inferredDirectCodingMode=3",)),
    "one_point_idcm_defaults": ("deep16", "defaults", 1, ("--jointTwoPointIdcm=0",)),
    "planar_idcm_ctc": ("deep16", "ctc", 1, ("--planarModeIdcmUse=32",)),
    "zyx_ctc": ("away", "ctc", 1, ("--geometry_axis_order=0",)),
    "bypass_defaults": ("away", "defaults", 1, ("--cabac_bypass_stream_enabled_flag=1",)),
    "streams_defaults": ("away", "defaults", 1, ("--numOctreeEntropyStreams=3",)),
    "bytewise_minimal": ("few", "minimal", 1, ("--bitwiseOccupancyCoding=0",)),
    "predictive": ("few", "defaults", 1, ("--geomTreeType=1",)),
    "trisoup": ("few", "defaults", 1, ("--trisoupNodeSizeLog2=3",)),
    "quantised_in_loop": ("few", "defaults", 1, (*IN_LOOP, "--positionQuantisationMethod=0")),
    "angular": ("few", "defaults", 1, ("--angularEnabled=1", "--numLasers=1", *LASER)),
    "spin": ("turn", "ctc", 1, SPARSE),
    "spin_merged": ("turn", "ctc", 1, (*SPARSE, "--mergeDuplicatedPoints=1")),
    "spin_buffer": ("turn", "ctc", 1, (*SPARSE, "--planarBufferDisabled=0")),
    "spin_no_planes": ("turn", "ctc", 1, (*SPARSE, "--planarEnabled=0")),
    "spin_no_direct": ("turn", "ctc", 1, (*SPARSE, "--inferredDirectCodingMode=0")),
    "spin_direct_1": ("turn", "ctc", 1, (*SPARSE, "--inferredDirectCodingMode=1")),
    "spin_direct_2": ("turn", "ctc", 1, (*SPARSE, "--inferredDirectCodingMode=2")),
    "spin_one_by_one": ("turn", "ctc", 1, (*SPARSE, "--jointTwoPointIdcm=0")),
    "spin_cube": ("turn", "ctc", 1, (*SPARSE, "--qtbtEnabled=0")),
    "spin_siblings": ("turn", "ctc", 1, (*SPARSE, "--neighbourAvailBoundaryLog2=0")),
    "spin_away": ("turn", "ctc", 1, (*SPARSE, "--lidarHeadPosition=-900,40000,12")),
    "spin_coarse": ("turn", "ctc", 0.125, SPARSE),
    "spin_pairs": ("pairs", "ctc", 1, SPARSE),
    "spin_one": ("one", "ctc", 1, SPARSE),
    "spin_sliced": ("turn", "ctc", 1, (*SPARSE, *SLICED)),
    "spin_continued": ("turn", "ctc", 1, (*SPARSE, *CONTINUED)),
    "spin_streams": ("turn", "ctc", 1, (*SPARSE, "--numOctreeEntropyStreams=5")),
    "spin_bypass": ("turn", "ctc", 1, (*SPARSE, "--cabac_bypass_stream_enabled_flag=1")),
    "spin_zyx": ("turn", "ctc", 1, (*SPARSE, "--geometry_axis_order=0")),
    "spin_zxy": ("turn", "ctc", 1, (*SPARSE, "--geometry_axis_order=3")),
    "trees_given": ("turn", "defaults", 1, (TREES, KEPT, "--predGeomSort=0")),
    "trees_morton": ("turn", "defaults", 1, (TREES, KEPT, "--predGeomSort=1")),
    "trees_azimuth": ("turn", "defaults", 1, (TREES, "--predGeomSort=2")),
    "trees_radius": ("turn", "defaults", 1, (TREES, KEPT, "--predGeomSort=3")),
    "trees_short": ("turn", "defaults", 1, (*BY_AZIMUTH, "--predGeomTreePtsMax=300")),
    "trees_dense": ("object", "defaults", 0.25, (TREES, "--predGeomSort=1")),
    "trees_qp": ("turn", "defaults", 1, (*BY_AZIMUTH, *IN_LOOP, "--positionBaseQp=29")),
    "trees_qps": (
        *("turn", "defaults", 1),
        (*BY_AZIMUTH, *IN_LOOP, "--positionQpMultiplierLog2=2", "--positionSliceQpOffset=-3"),
    ),
    "trees_one": ("one", "defaults", 1, (TREES,)),
    "trees_two": ("two", "defaults", 1, (TREES,)),
    "trees_same": ("same", "defaults", 1, (TREES, KEPT)),
    "trees_sliced": ("turn", "defaults", 1, (*BY_AZIMUTH, *SLICED)),
    "trees_bypass": ("turn", "defaults", 1, (*BY_AZIMUTH, "--cabac_bypass_stream_enabled_flag=1")),
    "turn_0": ("turn", "defaults", 1, spherical(0, 12)),
    "turn_1": ("turn", "defaults", 1, spherical(1, 12)),
    "turn_4": ("turn", "defaults", 1, spherical(4, 9)),
    "turn_8": ("turn", "defaults", 1, spherical(8, 7)),
    "turn_angles": ("turn", "defaults", 1, (*spherical(0, 12), "--predGeomAzimuthQuantization=0")),
    "turn_short": ("turn", "defaults", 1, (*spherical(0, 12), "--predGeomTreePtsMax=300")),
    "turn_continued": ("turn", "defaults", 1, (*spherical(2, 11), *CONTINUED)),
    "turn_zyx": ("turn", "defaults", 1, (*spherical(0, 12), "--geometry_axis_order=0")),
    "turn_one_laser": (
        "few",
        "defaults",
        1,
        (TREES, *LASER, "--angularEnabled=1", "--numLasers=1"),
    ),
}
