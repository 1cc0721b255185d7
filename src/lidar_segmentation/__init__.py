"""Semantic segmentation of LiDAR scans: the class of each point, by a small neural network.

`open_network` opens shipped weights or a file of weights, and `SegmentationNetwork.predict` returns
the class of each point of a scan, which needs no order. `class_map` tells which of the network's
classes a label of a virtual scene or of a labelled data set is. Lengths are in metres, z is up, and
the sensor is at the origin. Invalid input raises `pointkit.errors.InputError`. The names here are
imported on first use.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from lidar_segmentation.class_maps import ClassMap as ClassMap
    from lidar_segmentation.class_maps import class_map as class_map
    from lidar_segmentation.class_maps import class_map_names as class_map_names
    from lidar_segmentation.mininet import MiniNet as MiniNet
    from lidar_segmentation.predicting import SegmentationNetwork as SegmentationNetwork
    from lidar_segmentation.predicting import open_network as open_network
    from lidar_segmentation.scores import IGNORED as IGNORED
    from lidar_segmentation.scores import confusion as confusion
    from lidar_segmentation.scores import ious as ious
    from lidar_segmentation.scores import mean_iou as mean_iou
    from lidar_segmentation.training import LabelledScan as LabelledScan
    from lidar_segmentation.training import SegmentationTraining as SegmentationTraining
    from lidar_segmentation.weights_file import shipped as shipped

__getattr__, __dir__, __all__ = lazy(
    __name__,
    class_maps=("ClassMap", "class_map", "class_map_names"),
    mininet=("MiniNet",),
    predicting=("SegmentationNetwork", "open_network"),
    scores=("IGNORED", "confusion", "ious", "mean_iou"),
    training=("LabelledScan", "SegmentationTraining"),
    weights_file=("shipped",),
)
