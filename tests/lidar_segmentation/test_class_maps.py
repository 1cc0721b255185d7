"""Every label of a label set is a class of a network, or ignored."""

from __future__ import annotations

import numpy as np
import pytest

from lidar_segmentation import IGNORED, class_map, class_map_names
from pointkit.errors import InputError

SEMANTICKITTI = (
    *(0, 1, 10, 11, 13, 15, 16, 18, 20, 30, 31, 32, 40, 44, 48, 49, 50, 51, 52, 60, 70, 71, 72, 80),
    *(81, 99, 252, 253, 254, 255, 256, 257, 258, 259),
)
"""The labels of its files, as Behley et al. (2019) publish them."""
BENCHMARK = {
    0: 0, 1: 0, 10: 1, 11: 2, 13: 5, 15: 3, 16: 5, 18: 4, 20: 5, 30: 6, 31: 7, 32: 8, 40: 9, 44: 10,
    48: 11, 49: 12, 50: 13, 51: 14, 52: 0, 60: 9, 70: 15, 71: 16, 72: 17, 80: 18, 81: 19, 99: 0,
    252: 1, 253: 7, 254: 6, 255: 8, 256: 5, 257: 5, 258: 4, 259: 5,
}  # fmt: skip
"""SemanticKITTI's learning_map."""
NUMBERS = {
    "semantickitti": SEMANTICKITTI,
    "semantickitti_benchmark": range(20),
    "nuscenes": range(32),
    "pclsegmentation": range(11),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_every_published_number_is_a_class_or_ignored(name: str) -> None:
    found = class_map(name).of(np.array(NUMBERS[name]))
    assert set(found.tolist()) <= {*range(len(class_map(name).classes)), IGNORED}
    numbers = [label for label in class_map(name).numbers if isinstance(label, int)]
    assert sorted(numbers) == sorted(NUMBERS[name])


@pytest.mark.parametrize("name", NUMBERS)
def test_a_label_has_one_name_and_one_place(name: str) -> None:
    labels = list(class_map(name).numbers)
    names = [label for label in labels if isinstance(label, str)]
    assert len(names) == len(labels) / 2
    by_number = class_map(name).of([label for label in labels if isinstance(label, int)])
    assert by_number.tolist() == class_map(name).of(names).tolist()


def test_the_benchmark_joins_what_its_learning_map_joins() -> None:
    files, benchmark = class_map("semantickitti"), class_map("semantickitti_benchmark")
    for label, joined in BENCHMARK.items():
        (ours,), (theirs,) = files.of([label]), benchmark.of([joined])
        assert ours == theirs or (label, theirs) == (99, IGNORED)


def test_classes_that_labels_do_not_tell_apart_count_as_one() -> None:
    mapping = class_map("nuscenes")
    names = np.array(mapping.classes)
    joined = names[mapping.joined(np.arange(len(names), dtype=np.uint8))]
    assert dict(zip(names[names != joined], joined[names != joined], strict=True)) == {
        **dict.fromkeys(("fence", "pole", "sign", "object"), "building"),
        "trunk": "vegetation",
    }
    assert set(mapping.judged) == set(mapping.joins.tolist())


@pytest.mark.parametrize("name", class_map_names())
def test_only_judged_classes_are_left_after_joining(name: str) -> None:
    mapping = class_map(name)
    assert mapping.joins[list(mapping.judged)].tolist() == list(mapping.judged)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (np.array([40, 41]), "labels semantickitti: no label 41 (known: 0, "),
        (["tree"], "labels semantickitti: no label 'tree' (known: 0, "),
        (np.zeros((2, 2), int), "labels semantickitti: an array (n,) is needed, not (2, 2)"),
    ],
)
def test_unknown_labels_end_in_one_line(labels: object, message: str) -> None:
    with pytest.raises(InputError) as error:
        class_map("semantickitti").of(labels)  # type: ignore[arg-type]
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_an_unknown_label_set_ends_in_one_line() -> None:
    with pytest.raises(InputError, match=r"^unknown label set 'kitty' \(known: streets, rooms, "):
        class_map("kitty")


def test_no_labels_give_no_classes() -> None:
    assert class_map("semantickitti").of(np.array([], int)).shape == (0,)
