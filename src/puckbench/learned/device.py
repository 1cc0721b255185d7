"""Where a network runs: on the CPU, or on a CUDA device by the same arithmetic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeVar

from puckbench.core.errors import InputError

if TYPE_CHECKING:
    import torch
    from torch import nn

M = TypeVar("M", bound="nn.Module")
DeviceName = Literal["cpu", "cuda"]


def why_not(name: DeviceName) -> str:
    """Why networks cannot run on a device, in one line; empty where they can."""
    import torch

    if name == "cpu" or torch.cuda.is_available():
        return ""
    return f"device {name}: PyTorch finds no CUDA device here"


def placed(model: M, name: DeviceName) -> M:
    """The model on a device.

    Products are computed in full single precision there: sums that are exact on a CPU then are
    exact on the device too.

    Raises
    ------
    InputError
        There is no such device.
    """
    import torch

    if reason := why_not(name):
        raise InputError(reason)
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.backends.cudnn.allow_tf32 = False
    return model.to(name)


def device_of(model: nn.Module) -> torch.device:
    """The device that a model is on."""
    return next(model.parameters()).device
