"""TensorFlow checkpoints, read without TensorFlow."""

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.scene_sets.tensorflow_checkpoints import read_variables
from tests.support.tensorflow_checkpoint import checkpoint

VARIABLES = {
    "encoder/conv1/kernel": np.arange(24.0).reshape(2, 3, 4),
    "encoder/conv1/bias": np.array([1.5, -2.0]),
    "a": np.linspace(0, 1, 300),
}


def test_variables_are_read_without_those_of_the_optimiser() -> None:
    result = read_variables(*checkpoint(VARIABLES))
    assert list(result) == sorted(VARIABLES)
    for name, values in VARIABLES.items():
        np.testing.assert_array_equal(result[name], values.astype(np.float32))


@pytest.mark.parametrize("cut", [0, 10, 47, 100, 200])
def test_damaged_checkpoints_are_refused(cut: int) -> None:
    index, data = checkpoint(VARIABLES)
    with pytest.raises(InputError, match="not a TensorFlow checkpoint"):
        read_variables(index[:cut], data)
    with pytest.raises(InputError, match="not a TensorFlow checkpoint"):
        read_variables(index, data[:cut])
