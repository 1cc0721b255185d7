from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeVar

from pointkit.errors import InputError

if TYPE_CHECKING:
    import torch
    from torch import nn

M = TypeVar("M", bound="nn.Module")
DeviceName = Literal["cpu", "cuda"]


def why_not(name: DeviceName) -> str:
    """Return why networks cannot run on a device, or an empty string if they can."""
    if name == "cpu":
        return ""
    import torch

    if torch.cuda.is_available():
        return ""
    return f"device {name}: PyTorch finds no CUDA device here"


def placed(model: M, name: DeviceName) -> M:
    """Move a model to a device; raise InputError if the device does not exist.

    CUDA is set to full single precision, so that sums that are exact on a CPU stay exact.
    """
    import torch

    if reason := why_not(name):
        raise InputError(reason)
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.backends.cudnn.allow_tf32 = False
    return model.to(name)


def device_of(model: nn.Module) -> torch.device:
    return next(model.parameters()).device
