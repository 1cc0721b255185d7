"""The authors' checkpoints: their names for our parameters."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

from torch import Tensor

from puckbench.codecs.learned.pcgcv2.model import SCALES, PCGCv2, Shape
from puckbench.core.errors import InputError

_BLOCK = {
    "conv0_0": "near_in",
    "conv0_1": "near_out",
    "conv1_0": "point_in",
    "conv1_1": "middle",
    "conv1_2": "point_out",
}
_PARTS = ("encoder", "decoder", "entropy_bottleneck")


def load_original(path: Path) -> PCGCv2:
    """The network of a checkpoint of the authors' repository; InputError when it is not one.

    28 to 67 % of the authors' weights have decayed to denormal numbers (below 1.2e-38), with which
    some processors compute a hundred times slower. They are read as the zeros that they act as.
    """
    checkpoint = _read(path)
    model = PCGCv2(Shape())
    try:
        model.load_state_dict(_translated(checkpoint))
    except (KeyError, RuntimeError) as error:
        raise InputError(f"{path}: not a checkpoint of PCGCv2 ({_first_line(error)})") from error
    return model.eval()


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[-1].strip()


def _read(path: Path) -> dict[str, Any]:
    import pickle

    import torch

    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise InputError(f"{path}: not a checkpoint of PCGCv2") from error
    if not isinstance(checkpoint, dict) or not set(_PARTS) <= set(checkpoint):
        raise InputError(f"{path}: not a checkpoint of PCGCv2")
    return checkpoint


def _translated(checkpoint: dict[str, dict[str, Tensor]]) -> dict[str, Tensor]:
    import torch

    state = {}
    for part in ("encoder", "decoder"):
        for name, value in checkpoint[part].items():
            kernel = value.ndim == 2 and name.endswith("kernel")
            flat = value[0] if name.endswith("bias") else value[None] if kernel else value
            own = f"{part}.{_NAMES[part, name.rpartition('.')[0]]}.{name.split('.')[-1]}"
            state[own] = flat.masked_fill(flat.abs() < torch.finfo(flat.dtype).tiny, 0)
    for kind, group in (("matrices", "_matrices"), ("biases", "_biases"), ("factors", "_factors")):
        for layer in range(4):
            found = checkpoint["entropy_bottleneck"][f"{group}.{layer}"]
            state[f"bottlenecks.0.{kind}.{layer}"] = found
    state["log_gains"] = torch.zeros(1, Shape().latent)
    return state


def _names() -> dict[tuple[str, str], str]:
    """Module by module: (part, the authors' name) to ours."""
    names = {("encoder", "conv0"): "first"}
    for scale in range(SCALES):
        own = f"scales.{scale}"
        names["encoder", f"down{scale}"] = f"{own}.down"
        names["encoder", f"conv{scale + 1}"] = f"{own}.conv"
        names["decoder", f"up{scale}"] = f"{own}.up"
        names["decoder", f"conv{scale}"] = f"{own}.conv"
        names["decoder", f"conv{scale}_cls"] = f"{own}.logits"
        for part, block in product(("encoder", "decoder"), range(Shape().blocks)):
            for theirs, ours in _BLOCK.items():
                names[part, f"block{scale}.{block}.{theirs}"] = f"{own}.blocks.{block}.{ours}"
    return names


_NAMES = _names()
