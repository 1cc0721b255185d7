"""Tiny networks of random weights for every learned codec, and damage to their streams."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pcc_networks.catalogue import PCGCV1, PCGCV2
from pcc_networks.inter_lpcm.networks import ElevationNetwork, RadiusNetwork
from pcc_networks.inter_lpcm.weights import FILES, HEADS, layer_shapes
from pcc_networks.octree_net import weights as octree_weights
from pcc_networks.octree_net.inference import powers_of_two
from pcc_networks.octree_net.model import UNITS, FixedPointLayer, OctreeNet, OctreeNetShape
from pcc_networks.pcgcv1.model import PCGCv1, Pcgcv1Shape
from pcc_networks.pcgcv2.model import PCGCv2, Pcgcv2Shape
from pcc_networks.polopcac.weights import shapes as polopcac_shapes
from pcc_networks.reno.weights import shapes as reno_shapes
from pcc_networks.weights_file import save_multi_rate
from pointkit.errors import InputError

TINY1 = Pcgcv1Shape(
    cube_size=16, channels=(4, 8, 16), latent_channels=4, hyper_channels=(16, 8), blocks=1, rates=2
)
TINY2 = Pcgcv2Shape(channels=(4, 8, 8, 8), latent_channels=2, blocks=1, rates=2)
LMBDAS = (1.0, 4.0)
RATES: dict[str, dict[str, Any]] = {
    "pcgcv1_plus": {"r1": {"lmbda": 1, "scale": 0.5, "rho": 1.2}, "r2": {"lmbda": 4}},
    "pcgcv2_plus": {"r1": {"lmbda": 1}, "r2": {"lmbda": 4}},
    "sparse_octree_net": {"r1": {"scale": 0.5}, "r2": {"scale": 1}},
}
"""Rates of the codecs whose weights the workflow trains."""
SCALES = {"r1": {"scale": 0.5}, "r2": {"scale": 1}}
METRIC_RATES = {"r1": {"step_m": 2}, "r2": {"step_m": 1}}


def network1(shape: Pcgcv1Shape = TINY1, seed: int = 0) -> PCGCv1:
    torch.manual_seed(seed)
    model = PCGCv1(shape)
    with torch.no_grad():
        model.log_gains[:] = torch.linspace(2, 4, shape.rates)[:, None]
    return model.eval()


def network2(shape: Pcgcv2Shape = TINY2, seed: int = 0) -> PCGCv2:
    torch.manual_seed(seed)
    model = PCGCv2(shape)
    with torch.no_grad():
        model.log_gains[:] = torch.linspace(1, 3, shape.rates)[:, None]
    return model.eval()


@contextmanager
def torch_threads(threads: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    yield
    torch.set_num_threads(before)


def octree_network(shape: OctreeNetShape | None = None, seed: int = 0) -> OctreeNet:
    torch.manual_seed(seed)
    model = OctreeNet(shape or OctreeNetShape(channels=8))
    with torch.no_grad():
        for layer in model.modules():
            if isinstance(layer, FixedPointLayer):
                layer.kernel.mul_(3)
                layer.bias.normal_(std=0.3)
    return model.eval().requires_grad_(False)


def frequencies(logits: np.ndarray) -> np.ndarray:
    """Integer frequencies (n, 16) of symbols from base-2 logits (n, 16) in fixed point."""
    units = logits * np.float32(UNITS)
    distances = (units.max(axis=1, keepdims=True) - units).astype(np.int32)
    table = powers_of_two()
    return np.asarray(table[np.minimum(distances, len(table) - 1)])


def reno_state(channels: int = 8, seed: int = 0) -> dict[str, torch.Tensor]:
    """Random parameters of RENO, by the authors' names, about as large as theirs."""
    rng = np.random.default_rng(seed)
    state = {}
    for name, shape in reno_shapes(channels).items():
        spread = 0.3 / np.sqrt(channels) if name.endswith("kernel") else 0.7
        state[name] = torch.from_numpy((spread * rng.normal(size=shape)).astype(np.float32))
    return state


def lizip_file(sizes: Sequence[int] = (9, 20, 40, 3), seed: int = 0) -> bytes:
    """Random weights of LiZIP in its authors' format, with a layer between any two sizes."""
    rng = np.random.default_rng(seed)
    parts = [b"LIZM", struct.pack("<I", len(sizes) - 1)]
    for inputs, outputs in pairwise(sizes):
        matrix = rng.normal(size=(outputs, inputs)) / np.sqrt(inputs)
        bias = 0.1 * rng.normal(size=outputs)
        parts += [struct.pack("<II", inputs, outputs)]
        parts += [matrix.astype("<f4").tobytes(), bias.astype("<f4").tobytes()]
    return b"".join(parts)


def polopcac_state(channels: int = 8, layers: int = 2, seed: int = 0) -> dict[str, torch.Tensor]:
    """Random parameters of PoLoPCAC, by the authors' names, about as large as theirs."""
    rng = np.random.default_rng(seed)
    state = {}
    for name, shape in polopcac_shapes(channels, layers).items():
        spread = 0.3 if name.endswith("bias") else 0.9 / np.sqrt(shape[1])
        state[name] = torch.from_numpy((spread * rng.normal(size=shape)).astype(np.float32))
    return state


def weights_name(codec: str) -> str:
    """The name of a codec's file of weights."""
    names = {"reno": "KITTIDetection.pt", "lizip": "mlp_c3_h20.bin", "polopcac": "ckpt.pt"}
    return names.get(codec, "tiny.safetensors")


def save_tiny(codec: str, path: Path, seed: int = 0) -> None:
    """A set of random weights for a codec."""
    states = {"reno": reno_state, "polopcac": polopcac_state}
    if codec in states:
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.save(states[codec](seed=seed), path)
        return
    if codec == "lizip":
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(lizip_file(seed=seed))
        return
    if codec.startswith("pcgcv1"):
        save_multi_rate(path, PCGCV1, network1(seed=seed), LMBDAS, {"data": "none"})
    elif codec.startswith("pcgcv2"):
        save_multi_rate(path, PCGCV2, network2(seed=seed), LMBDAS, {"data": "none"})
    else:
        octree_weights.save_weights(path, octree_network(seed=seed), {"data": "none"})


def changes(codec: str, weights: Path | str, **more: Any) -> dict[str, Any]:
    """A codec's entry with weights, at the rates that tiny sets have."""
    options = {"weights": str(weights), **more}
    if codec in ("reno", "lizip"):
        return {"metric_rates": METRIC_RATES, "options": options}
    if codec == "polopcac":
        return {"rates": SCALES, "options": options}
    rates = RATES[codec if codec in RATES else f"{codec}_plus"]  # as published: the same
    return {"rates": rates, "options": options}


def shell(radii: tuple[int, int, int] = (20, 14, 9), points: int = 6000) -> np.ndarray:
    """The voxels of an ellipsoid about the origin."""
    directions = np.random.default_rng(0).normal(size=(points, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.unique(np.rint(directions * radii), axis=0)


def sealed(stream: bytes, at: int) -> bytes:
    """A stream with a check sum that fits at byte `at`, as an attacker would send it."""
    return stream[:at] + struct.pack("<I", zlib.crc32(stream[at + 4 :])) + stream[at + 4 :]


def endure_damage(
    decode: Callable[[bytes], np.ndarray], stream: bytes, check: int, seed: int
) -> None:
    """Damaged streams end in one clean error; those with a fitting check sum may decode."""
    rng = np.random.default_rng(seed)
    for trial in range(60):
        damaged = bytearray(stream if trial % 2 else stream[: rng.integers(len(stream))])
        for _ in range(rng.integers(1, 4)):
            if damaged:
                damaged[rng.integers(len(damaged))] = rng.integers(256)
        with pytest.raises(InputError):
            decode(bytes(damaged) + b"!")
        with suppress(InputError):
            assert np.isfinite(decode(sealed(bytes(damaged), check))).all()


def lpcm_states(seed: int = 0) -> dict[str, dict[str, torch.Tensor]]:
    """Random parameters of Inter-LPCM's networks, by what they predict and the authors' names."""
    torch.manual_seed(seed)
    states = {
        "radius": RadiusNetwork().state_dict(),
        "elevation": ElevationNetwork().state_dict(),
    }
    for name, outputs in HEADS.items():
        layers = {key: torch.nn.Linear(*shape) for key, shape in layer_shapes(outputs).items()}
        states[name] = {
            f"{key}.{part}": value
            for key, layer in layers.items()
            for part, value in layer.state_dict().items()
        }
    return {name: dict(state) for name, state in states.items()}


def save_lpcm(path: Path, states: dict[str, dict[str, torch.Tensor]] | None = None) -> None:
    """An archive of the repository of Inter-LPCM's authors, with random weights by default."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, state in (states or lpcm_states()).items():
            data = BytesIO()
            torch.save(state, data)
            archive.writestr(f"Inter-LPCM-main/{FILES[name]}", data.getvalue())


def lpcm_repository(folder: Path) -> Path:
    """A copy of the repository of Inter-LPCM's authors: random weights, two small turns, poses."""
    save_lpcm(folder / "lpcm.zip")
    with zipfile.ZipFile(folder / "lpcm.zip") as archive:
        archive.extractall(folder)
    path, rng = folder / "Inter-LPCM-main", np.random.default_rng(0)
    for place in ("test", "test_matrix"):
        (path / place).mkdir()
    for name in ("000001.bin", "000002.bin"):
        points = rng.normal(0, 10, (12, 4)).astype("<f4")
        (path / "test" / name).write_bytes(points.tobytes())
        (path / "test_matrix" / name).write_bytes(np.eye(4, dtype="<f4").tobytes())
    return path


def lpcm_turn(lines: int = 10, points: int = 12, seed: int = 0) -> np.ndarray:
    """Points (lines * points, 3) on a wall and a floor, laser after laser, with noise."""
    rng = np.random.default_rng(seed)
    azimuth = np.sort(rng.random((lines, points)), axis=1) * 2 * np.pi
    elevation = np.radians(np.linspace(2, -20, lines))[:, None] + rng.normal(0, 1e-4, azimuth.shape)
    radius = np.minimum(10 + 2 * np.sin(azimuth), 1.7 / np.maximum(np.tan(-elevation), 1e-3))
    radius = radius + rng.normal(0, 0.02, radius.shape)
    return np.stack(
        [radius * np.cos(azimuth), radius * np.sin(azimuth), radius * np.tan(elevation)], axis=-1
    ).reshape(-1, 3)
