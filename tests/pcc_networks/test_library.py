"""The functions `load_weights`, `encode` and `decode` of each network's package."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from pcc_networks import lizip, octree_net, pcgcv1, pcgcv2, reno
from pointkit.errors import InputError
from tests.support.learned_codecs import save_tiny, shell, weights_name

NETWORKS: dict[str, tuple[ModuleType, dict[str, Any]]] = {
    "pcgcv1": (pcgcv1, {"rate": 1}),
    "pcgcv2": (pcgcv2, {"rate": 1}),
    "sparse_octree_net": (octree_net, {"scale": 1.0}),
    "reno": (reno, {"posq": 1.0}),
    "lizip": (lizip, {"step_m": 1.0}),
}
"""A network's package, and the arguments of `encode` that keep the grid of the input."""
pytestmark = [pytest.mark.usefixtures("one_thread"), pytest.mark.parametrize("name", NETWORKS)]


def _weights(name: str, folder: Path, seed: int = 0) -> Any:
    path = folder / str(seed) / weights_name(name)
    path.parent.mkdir(parents=True)
    save_tiny(name, path, seed)
    return NETWORKS[name][0].load_weights(path)


def test_a_stream_decodes_in_a_fresh_process(name: str, tmp_path: Path) -> None:
    library, rate = NETWORKS[name]
    weights = _weights(name, tmp_path)
    (tmp_path / "a.bin").write_bytes(library.encode(shell(), weights, **rate))
    program = (
        f"import sys, numpy as np; from {library.__name__} import decode, load_weights;"
        "decoded = decode(open(sys.argv[2], 'rb').read(), load_weights(sys.argv[1]));"
        "np.save(sys.argv[3], decoded)"
    )
    file = tmp_path / "0" / weights_name(name)
    words = [sys.executable, "-c", program, file, tmp_path / "a.bin", tmp_path / "a.npy"]
    subprocess.run(words, check=True)
    decoded = library.decode((tmp_path / "a.bin").read_bytes(), weights)
    assert np.array_equal(np.load(tmp_path / "a.npy"), decoded)


def test_other_weights_are_refused(name: str, tmp_path: Path) -> None:
    library, rate = NETWORKS[name]
    stream = library.encode(shell(), _weights(name, tmp_path), **rate)
    with pytest.raises(InputError, match="made with other weights"):
        library.decode(stream, _weights(name, tmp_path, seed=1))


@pytest.mark.parametrize("fault", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(name: str, tmp_path: Path, fault: float) -> None:
    library, rate = NETWORKS[name]
    points = shell()
    points[3, 1] = fault
    with pytest.raises(InputError, match=r"encode: 1 of \d+ points are not finite"):
        library.encode(points, _weights(name, tmp_path), **rate)
    with pytest.raises(InputError, match="empty"):
        library.encode(points[:0], _weights(name, tmp_path, seed=2), **rate)


def test_a_rate_that_the_weights_do_not_have_is_refused(name: str, tmp_path: Path) -> None:
    library, rate = NETWORKS[name]
    if "rate" in rate:
        with pytest.raises(InputError, match="rate 2: the weights have 2 rates, from 0 on"):
            library.encode(shell(), _weights(name, tmp_path), rate=2)
