from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pointkit.confusion import IGNORED
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.seeding import generator
from puckbench.geometry.labels import REMISSION, class_labels
from puckbench.metrics.metric_registry import METRICS
from puckbench.metrics.segmentation import (
    PREFIXES,
    WITHIN_M,
    Classes,
    JudgedScan,
    Rows,
    SegmentationMetric,
    segmentation_columns,
    segmentation_measure,
)

CODE = (
    *("puckbench.metrics.segmentation", "puckbench.geometry.labels"),
    "lidar_segmentation.*",
)

NAME, MININET = PREFIXES
_NEEDS = ("lidar_segmentation", "torch")
_MEMORY_MB = 800
_OWN, _TINY = "our network", "3D-MiniNet"


def _weights(network: str = "streets", **_: Any) -> Iterable[Path]:
    from lidar_segmentation.weights_file import weights_path

    return [weights_path(network)]


def _folder(weights: str = "", **_: Any) -> Iterable[Path]:
    from lidar_segmentation.mininet import mininet_files

    return mininet_files(Path(weights))


@METRICS.register(
    NAME,
    columns=segmentation_columns(NAME, _OWN),
    measures=segmentation_measure(NAME, "Segmentation, our network"),
    needs=_NEEDS,
    files=_weights,
    memory_mb=_MEMORY_MB,
)
class Segmentation(SegmentationMetric):
    """Name the class of each decoded point by a network of `lidar_segmentation`, and judge it.

    The metric judges every point of the original scan, by its label and by the class of the decoded
    point that answers for it (`puckbench.metrics.segmentation`).

    The scan and its decoded forms are displaced by the same random vector (`network_shift`) before
    the network sees them. Otherwise the borders of its cells would lie on the grids of codecs in
    every scan, since both are around the sensor.

    Parameters
    ----------
    reference
        Labelled scan in m, with the sensor at the origin, and x right, y forward, z up.
    network
        Name of shipped weights (``streets``, ``rooms``), or a file of weights.
    within_m
        Largest distance, in m, of a decoded point that answers for an original one.

    Raises
    ------
    InputError
        The scan is not in metres, has no labels, or labels without a class of the network.
    """

    def __init__(
        self, reference: PointCloud, *, network: str = "streets", within_m: float = WITHIN_M
    ) -> None:
        from lidar_segmentation import SegmentationNetwork, open_network

        opened = open_network(network)
        if not isinstance(opened, SegmentationNetwork):
            raise InputError(f"segmentation: {network} is of 3D-MiniNet, for the metric {MININET}")
        true, joined = _true_classes(reference, opened)
        shift = network_shift(reference.xyz, opened.cell_m)

        def predict(points: Floats, _: Rows) -> Classes:
            return np.asarray(joined(opened.predict(points + shift)))

        scan = JudgedScan(reference.xyz, true, opened.classes, predict, within_m)
        super().__init__(NAME, scan, f"{Path(network).name} {opened.digest}")


@METRICS.register(
    MININET,
    columns=segmentation_columns(MININET, _TINY),
    measures=segmentation_measure(MININET, "Segmentation, 3D-MiniNet"),
    needs=_NEEDS,
    files=_folder,
    memory_mb=_MEMORY_MB,
)
class MiniNetSegmentation(SegmentationMetric):
    """Semantic segmentation of decoded scans of an HDL-64E by 3D-MiniNet.

    The network also reads the share of light that came back. A decoded point gets that of the
    nearest original point, if the cloud has a field ``remission``, since no bits are counted for
    it; otherwise, all points get the mean of the training.

    Parameters
    ----------
    reference
        Labelled scan in m, with the sensor at the origin, and x right, y forward, z up.
    weights
        Folder with the published weights.
    columns
        Number of columns of the range image. The published number suits whole scans of an HDL-64E;
        scans that are range images themselves have fewer.
    within_m
        Largest distance, in m, of a decoded point that answers for an original one.

    Raises
    ------
    InputError
        The scan is not in metres, has no labels, or labels without a class of the network; or a
        file of weights is missing or of another network.
    """

    def __init__(
        self,
        reference: PointCloud,
        *,
        weights: str,
        columns: int = 2048,
        within_m: float = WITHIN_M,
    ) -> None:
        from lidar_segmentation.mininet import open_mininet

        opened = open_mininet(Path(weights), columns)
        remission = reference.fields.get(REMISSION)
        true, joined = _true_classes(reference, opened)

        def predict(points: Floats, rows: Rows) -> Classes:
            light = None if remission is None else remission[rows]
            return np.asarray(joined(opened.predict(points, light)))

        scan = JudgedScan(reference.xyz, true, opened.classes, predict, within_m)
        super().__init__(MININET, scan, f"3D-MiniNet {opened.digest}")


def network_shift(points: Floats, cell_m: Sequence[float]) -> Floats:
    """Return a random vector (x, y, z), m, to be added to a scan before a network sees it.

    It is drawn uniformly from a cell around zero. It depends only on the cell and on the points to
    the millimetre, so that it is the same on every machine.

    Parameters
    ----------
    points
        Points (n, 3) of the scan, m.
    cell_m
        Size (3,) of a cell of the network, m.
    """
    digest = hashlib.sha256(np.rint(1000 * points).astype("<i8").tobytes()).hexdigest()
    half = np.asarray(cell_m) / 2
    return generator(0, "shift of a scan", digest).uniform(-half, half)


def _true_classes(reference: PointCloud, network: Any) -> tuple[Classes, Any]:
    """Return the true class of each point, and how predicted classes are compared with it."""
    if reference.frame != "metric":
        raise InputError("segmentation: the cloud is not in metres (`size: metric`)")
    labels = class_labels(reference)
    known = network.class_map(labels.label_set)
    by_name = known.of(np.array(labels.names))
    true = by_name[np.maximum(labels.numbers, 0)]
    return np.where(labels.numbers < 0, np.uint8(IGNORED), true), known.joined
