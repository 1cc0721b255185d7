"""The functions `load_weights`, `encode` and `decode` of each network's package."""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from pcc_networks import octree_net, pcgcv1, pcgcv2, reno
from pointkit.errors import InputError
from puckbench.codecs.registry import open_codec
from tests.support.learned_codecs import changes, save_tiny, shell, weights_name

NETWORKS: dict[str, tuple[ModuleType, dict[str, Any], float]] = {
    "pcgcv1_plus": (pcgcv1, {"rate": 1}, 1.0),
    "pcgcv2_plus": (pcgcv2, {"rate": 1}, 1.0),
    "sparse_octree_net": (octree_net, {"scale": 1.0}, 1.0),
    "reno": (reno, {"posq": 1000.0}, 1000.0),
}
"""Codec, its library, the arguments that are its rate r2, and the library's units per step."""
pytestmark = [pytest.mark.usefixtures("one_thread"), pytest.mark.parametrize("codec", NETWORKS)]


def _weights(codec: str, folder: Path, seed: int = 0) -> Any:
    path = folder / str(seed) / weights_name(codec)
    path.parent.mkdir(parents=True)
    save_tiny(codec, path, seed)
    return NETWORKS[codec][0].load_weights(path)


def test_the_library_and_the_codec_make_the_same_stream(codec: str, tmp_path: Path) -> None:
    library, rate, unit = NETWORKS[codec]
    weights = _weights(codec, tmp_path)
    stream = library.encode(shell() * unit, weights, **rate)
    adapter = open_codec(codec, changes(codec, tmp_path / "0"))
    assert adapter.encode(shell(), "r2") == stream
    assert np.allclose(library.decode(stream, weights) / unit, adapter.decode(stream))


def test_other_weights_are_refused(codec: str, tmp_path: Path) -> None:
    library, rate, unit = NETWORKS[codec]
    stream = library.encode(shell() * unit, _weights(codec, tmp_path), **rate)
    with pytest.raises(InputError, match="made with other weights"):
        library.decode(stream, _weights(codec, tmp_path, seed=1))


@pytest.mark.parametrize("fault", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(codec: str, tmp_path: Path, fault: float) -> None:
    library, rate, _ = NETWORKS[codec]
    points = shell()
    points[3, 1] = fault
    with pytest.raises(InputError, match=r"encode: 1 of \d+ points are not finite"):
        library.encode(points, _weights(codec, tmp_path), **rate)
    with pytest.raises(InputError, match="empty"):
        library.encode(points[:0], _weights(codec, tmp_path, seed=2), **rate)


def test_a_rate_that_the_weights_do_not_have_is_refused(codec: str, tmp_path: Path) -> None:
    library, rate, _ = NETWORKS[codec]
    if "rate" in rate:
        with pytest.raises(InputError, match="rate 2: the weights have 2 rates, from 0 on"):
            library.encode(shell(), _weights(codec, tmp_path), rate=2)
