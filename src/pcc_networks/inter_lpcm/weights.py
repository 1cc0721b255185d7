from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.files import read_bytes

if TYPE_CHECKING:
    from pcc_networks.inter_lpcm.networks import ElevationNetwork, RadiusNetwork

HISTORY = 49
"""Number of preceding values from which the networks predict the next one."""
HIDDEN, BLOCKS = 256, 3
"""Number of features of a hidden layer, and number of residual blocks, both of the networks that
predict how likely each symbol is."""
FILES = {
    "radius": "r_model/37.pt",
    "elevation": "theta_model/epoch_28.pt",
    "azimuth symbols": "entropy_model/phi.pt",
    "radius symbols": "entropy_model/r.pt",
}
"""Files of the authors' repository, by what their networks predict.

Their program has no use for ``entropy_model/theta.pt``, which fits other symbols."""
HEADS = {"azimuth symbols": 3, "radius symbols": 2}
"""Numbers of parameters of the distributions: mean, deviation and, of azimuths, a skew."""
_MAX_FILE_BYTES = 2**24
_FAULT = "not weights of Inter-LPCM"
Doubles = NDArray[np.float64]


class Layer(NamedTuple):
    """A linear layer: its matrix (inputs, outputs) and its bias (outputs,)."""

    matrix: Doubles
    bias: Doubles


@dataclass(frozen=True)
class LpcmWeights:
    """Trained weights of Inter-LPCM's four networks."""

    digest: bytes  # 8 bytes by which streams name the weights
    radius: RadiusNetwork
    elevation: ElevationNetwork
    azimuth_symbols: tuple[Layer, ...]
    radius_symbols: tuple[Layer, ...]


def load_weights(path: str | Path) -> LpcmWeights:
    """Read the weights in the authors' repository, without running code from its files.

    Parameters
    ----------
    path
        An archive (``.zip``) of the repository, or a folder. It has the four files of `FILES`.

    Raises
    ------
    InputError
        A file is missing, damaged, or of another network.
    """
    from pcc_networks.inter_lpcm.networks import ElevationNetwork, RadiusNetwork, network_with
    from pcc_networks.weights_file import checkpoint_of, digest_of, telling

    path = Path(path)
    contents = _folder(path) if path.is_dir() else _archive(path)
    faults = {name: f"{path}, {file}: {_FAULT}" for name, file in FILES.items()}
    states = {name: checkpoint_of(data, faults[name]) for name, data in contents.items()}
    layers: dict[str, tuple[Layer, ...]] = {}
    for name, outputs in HEADS.items():
        with telling(faults[name]):
            layers[name] = tuple(_layers(states[name], outputs))
    return LpcmWeights(
        digest_of(b"".join(contents.values())),
        network_with(RadiusNetwork, states["radius"], faults["radius"]),
        network_with(ElevationNetwork, states["elevation"], faults["elevation"]),
        layers["azimuth symbols"],
        layers["radius symbols"],
    )


def _folder(path: Path) -> dict[str, bytes]:
    return {name: read_bytes(path / file) for name, file in FILES.items()}


def _archive(path: Path) -> dict[str, bytes]:
    contents = {}
    try:
        with ZipFile(BytesIO(read_bytes(path))) as archive:
            for name, file in FILES.items():
                members = [each for each in archive.infolist() if _is(each.filename, file)]
                if len(members) != 1 or members[0].file_size > _MAX_FILE_BYTES:
                    raise InputError(f"{path}: {_FAULT} (no {file})")
                contents[name] = archive.read(members[0])
    except (BadZipFile, NotImplementedError, RuntimeError, zlib.error, EOFError) as error:
        raise InputError(f"{path}: {_FAULT} (no archive)") from error
    return contents


def _is(member: str, file: str) -> bool:
    """Return whether a member of an archive is the file, perhaps in the archive's one folder."""
    return member == file or member.partition("/")[2] == file


def layer_shapes(outputs: int) -> dict[str, tuple[int, int]]:
    """Return inputs and outputs of each layer of a network of symbols, by the authors' name."""
    blocks = {
        f"res_blocks.{block}.fc{half}": (HIDDEN, HIDDEN)
        for block in range(BLOCKS)
        for half in (1, 2)
    }
    return {"input_fc": (HISTORY, HIDDEN), **blocks, "output_fc": (HIDDEN, outputs)}


def _layers(state: Mapping[str, Any], outputs: int) -> Iterator[Layer]:
    from pcc_networks.weights_file import checkpoint_arrays

    names = layer_shapes(outputs)
    shapes: dict[str, tuple[int, ...]] = {}
    for name, (inputs, width) in names.items():
        shapes |= {f"{name}.weight": (width, inputs), f"{name}.bias": (width,)}
    arrays = checkpoint_arrays(state, shapes, np.float64)
    for name in names:
        yield Layer(np.ascontiguousarray(arrays[f"{name}.weight"].T), arrays[f"{name}.bias"])
