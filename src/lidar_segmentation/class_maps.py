"""Which class of our networks a label is: of virtual scenes, and of labelled data sets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.confusion import IGNORED
from pointkit.errors import InputError, among
from pointkit.models import Model, parsed
from pointkit.yaml_files import read_yaml

Label = str | int
_Labels = tuple[str, ...] | Mapping[int, str]


class _LabelSet(Model):
    network: str
    labels: Mapping[str, _Labels]
    joined: Mapping[str, tuple[str, ...]] = {}
    ignored: _Labels = ()


class _ClassMaps(Model):
    networks: Mapping[str, tuple[str, ...]]
    label_sets: Mapping[str, _LabelSet]


@dataclass(frozen=True)
class ClassMap:
    """Which class of a network each label of a label set is.

    Parameters
    ----------
    name
        Name of the label set.
    network
        Name of the shipped network with these classes.
    classes
        Names of the network's classes.
    numbers
        Number of the class of each label, which is known by its name and, in labelled data sets, by
        its number; `IGNORED` for labels that are not judged.
    joins
        For each class of the network, the number of the class as which it counts, (classes,). It is
        the class itself, or another one if the labels do not tell the two apart.
    """

    name: str
    network: str
    classes: tuple[str, ...]
    numbers: Mapping[Label, int]
    joins: NDArray[np.uint8]

    @property
    def judged(self) -> tuple[int, ...]:
        """Numbers of the network's classes that at least one label is, in ascending order."""
        return tuple(sorted(set(self.numbers.values()) - {IGNORED}))

    def of(self, labels: Iterable[Label] | NDArray[Any]) -> NDArray[np.uint8]:
        """Return the class of each label.

        Parameters
        ----------
        labels
            Labels (n,), either names or numbers.

        Returns
        -------
        ndarray
            Numbers (n,) of classes; `IGNORED` for labels that are not judged.

        Raises
        ------
        InputError
            The label set lacks a label.
        """
        array = labels if isinstance(labels, np.ndarray) else np.array(list(labels))
        if array.ndim != 1:
            raise InputError(f"labels {self.name}: an array (n,) is needed, not {array.shape}")
        kinds, places = np.unique(array, return_inverse=True)
        return np.array([self._number(kind) for kind in kinds.tolist()], np.uint8)[places]

    def _number(self, label: Label) -> int:
        if label not in self.numbers:
            known = ", ".join(map(str, self.numbers))
            raise InputError(f"labels {self.name}: no label {label!r} (known: {known})")
        return self.numbers[label]

    def joined(self, classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return predicted classes (n,) as they are compared with the labels' classes (`joins`)."""
        return self.joins[classes]


@cache
def _class_maps() -> _ClassMaps:
    path = Path(__file__).with_suffix(".yaml")
    return parsed(_ClassMaps, read_yaml(path), path.name)


def class_map_names() -> tuple[str, ...]:
    """Return the names of the label sets that `class_map` knows."""
    return tuple(_class_maps().label_sets)


@cache
def class_map(name: str) -> ClassMap:
    """Return the class map of a label set.

    Parameters
    ----------
    name
        ``streets`` or ``rooms``, whose labels are the semantic classes of virtual scenes;
        ``semantickitti`` (the labels in its files), ``semantickitti_benchmark`` (its 20 classes),
        ``nuscenes`` (the 32 classes of nuScenes-lidarseg), or ``pclsegmentation`` (the 11 classes
        of the range images of ika-rwth-aachen/PCLSegmentation).

    Raises
    ------
    InputError
        There is no such label set.
    """
    maps = _class_maps()
    if name not in maps.label_sets:
        raise InputError(f"unknown label set '{name}'{among(name, maps.label_sets)}")
    entry = maps.label_sets[name]
    classes = maps.networks[entry.network]
    numbers = dict.fromkeys(_names_and_numbers(entry.ignored), IGNORED)
    for kind, labels in entry.labels.items():
        numbers |= dict.fromkeys(_names_and_numbers(labels), classes.index(kind))
    return ClassMap(name, entry.network, classes, numbers, _joins(classes, entry.joined))


def _names_and_numbers(labels: _Labels) -> Iterator[Label]:
    if isinstance(labels, Mapping):
        yield from labels.keys()
        yield from labels.values()
    else:
        yield from labels


def _joins(classes: Sequence[str], joined: Mapping[str, tuple[str, ...]]) -> NDArray[np.uint8]:
    targets = {each: target for target, names in joined.items() for each in names}
    return np.array([classes.index(targets.get(name, name)) for name in classes], np.uint8)
