"""Classes of a cloud's points: what the numbers in `PointCloud.labels` mean.

The description of a labelled cloud has the names of its classes, ``classes``, which the labels
index, and the name of the set of labels from which they come, ``label_set``. Labels below 0 have no
class. Codecs do not code labels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud

OF_SCENE = "scene"
"""Set of labels: the semantic classes of a generated or captured scene."""
SEMANTIC_KITTI, SEMANTIC_KITTI_20 = "semantickitti", "semantickitti_benchmark"
"""Sets of labels: those in the files of SemanticKITTI, and the 20 of its benchmark."""
PCL_SEGMENTATION = "pclsegmentation"
"""Set of labels: the 11 of PCLSegmentation's range images of nuScenes and of a VLP-32C."""
REMISSION = "remission"
"""Field of a labelled cloud with the share of light that came back from each point, 0 to 1."""
_CLASSES, _SET = "classes", "label_set"


class ClassLabels(NamedTuple):
    """The classes of a cloud's points.

    Parameters
    ----------
    numbers
        Class of each point, (n,) int32, an index into `names`; below 0 for points without a class.
    names
        Names of the classes.
    label_set
        Name of the set of labels from which the classes come.
    """

    numbers: NDArray[np.int32]
    names: tuple[str, ...]
    label_set: str


def described_classes(names: Sequence[str], label_set: str) -> dict[str, Any]:
    """Return the entries of a labelled cloud's description, which `class_labels` reads."""
    return {_CLASSES: list(names), _SET: label_set}


def class_labels(cloud: PointCloud) -> ClassLabels:
    """Return the classes of a cloud's points.

    Raises
    ------
    InputError
        The points have no labels, or a label that the description does not name.
    """
    names = cloud.about.get(_CLASSES)
    if cloud.labels is None or not isinstance(names, list):
        raise InputError("the cloud's points have no labels of classes")
    if cloud.labels.max(initial=-1) >= len(names):
        raise InputError(f"label {cloud.labels.max()}: the cloud has {len(names)} classes")
    return ClassLabels(cloud.labels, tuple(map(str, names)), str(cloud.about.get(_SET, OF_SCENE)))


class SceneClasses(NamedTuple):
    """The semantic classes of a scene's objects.

    Parameters
    ----------
    names
        Names of the classes, sorted.
    of_object
        Class of each object, (objects,) int32, an index into `names`.
    """

    names: tuple[str, ...]
    of_object: NDArray[np.int32]

    def of(self, object_id: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the class of each point.

        Parameters
        ----------
        object_id
            Object of each point, (n,); -1 for points without one, which also get class -1.

        Raises
        ------
        InputError
            There is no object with a number.
        """
        if object_id.max(initial=-1) >= len(self.of_object):
            raise InputError(
                f"object {object_id.max()}: the scene's description lists {len(self.of_object)}"
            )
        return np.where(object_id < 0, np.int32(-1), self.of_object[np.maximum(object_id, 0)])


def scene_classes(description: Mapping[str, Any]) -> SceneClasses | None:
    """Return the semantic classes in the description of a labelled mesh; None without labels."""
    objects = description.get("objects")
    if not isinstance(objects, list) or not objects:
        return None
    classes = [str(item.get("semantic", "")) for item in objects if isinstance(item, Mapping)]
    names = tuple(sorted(set(classes)))
    places = {name: place for place, name in enumerate(names)}
    return SceneClasses(names, np.array([places[name] for name in classes], np.int32))
