"""The two networks of Inter-LPCM that predict radii and elevations, in PyTorch.

Parameters have the authors' names. A history is a tensor (m, 49, 4) of the points before the
predicted one in its line: azimuth in steps, elevation in degrees, radius in metres, and number of
the line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from pcc_networks.inter_lpcm.turn import STEPS_PER_TURN
from pointkit.errors import InputError

N = TypeVar("N", bound=nn.Module)
REFERENCE_LINES, REFERENCE_POINTS = 3, 20
"""Lines of the preceding turn, and points of each of them, from which a radius is predicted."""
_COORDINATES, _LAYERS = 4, 3
_RADIUS_FEATURES, _RADIUS_HIDDEN, _HEADS = 64, 128, 4
_ELEVATION_FEATURES = 128


class _SelfAttention(nn.Module):
    """Mean of the attended features (m, steps, c) of a sequence."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.query = nn.Linear(features, features)
        self.key = nn.Linear(features, features)
        self.value = nn.Linear(features, features)

    def forward(self, x: Tensor) -> Tensor:
        scores = self.query(x) @ self.key(x).transpose(1, 2) * x.shape[2] ** -0.5
        attended: Tensor = (torch.softmax(scores, dim=2) @ self.value(x)).mean(dim=1)
        return attended


class ElevationNetwork(nn.Module):
    """Network that predicts by how much the elevation changes from a point to the next."""

    def __init__(self) -> None:
        super().__init__()
        features = _ELEVATION_FEATURES
        self.lstm = nn.LSTM(_COORDINATES, features, _LAYERS, batch_first=True)
        self.attention = _SelfAttention(features)
        self.linear1 = nn.Linear(features, 32)
        self.linear2 = nn.Linear(32, 1)
        self.linear3 = nn.Linear(_COORDINATES, 8)
        self.linear4 = nn.Linear(8, 4)
        self.linear5 = nn.Linear(4, 1)

    def forward(self, history: Tensor, azimuth: Tensor) -> Tensor:
        """Return changes of the elevation, (m,) in degrees.

        Parameters
        ----------
        history
            (m, 49, 4), the points before.
        azimuth
            (m,), azimuth of the point, in steps.
        """
        scaled = torch.empty_like(history)
        scaled[:, :, 0] = history[:, :, 0] / STEPS_PER_TURN
        scaled[:, :, 1] = (history[:, :, 1] + 30) / 30
        scaled[:, :, 2] = history[:, :, 2] / 100
        scaled[:, :, 3] = history[:, :, 3] / 64
        trend = self.linear2(self.linear1(self.attention(self.lstm(scaled)[0])))[:, 0]
        known = torch.stack(
            [azimuth / STEPS_PER_TURN, scaled[:, -1, 1], trend / 100, scaled[:, -1, 3]], dim=1
        )
        change: Tensor = self.linear5(self.linear4(self.linear3(known)))[:, 0]
        return change


class _AttentionBlock(nn.Module):
    """Self-attention, added to its input and normalised."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.attn = nn.MultiheadAttention(features, _HEADS, batch_first=True)
        self.norm = nn.LayerNorm(features)

    def forward(self, x: Tensor) -> Tensor:
        mixed: Tensor = self.norm(x + self.attn(x, x, x)[0])
        return mixed


class _AttentionBlocks(nn.Module):
    def __init__(self, features: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(_AttentionBlock(features) for _ in range(_LAYERS))

    def forward(self, x: Tensor) -> Tensor:
        for layer in self.layers:
            x = layer(x)
        return x


class RadiusNetwork(nn.Module):
    """Network that predicts the radius of a point, in metres.

    It reads the points before it in its line, and points of three lines of the preceding turn.
    """

    def __init__(self) -> None:
        super().__init__()
        features = _RADIUS_FEATURES
        self.self_attn_A = _AttentionBlocks(features)
        self.lstmA = nn.LSTM(_COORDINATES, features, _LAYERS, batch_first=True)
        self.lstmC = nn.LSTM(_COORDINATES, features, _LAYERS, batch_first=True)
        self.lstmB = nn.ModuleList(
            nn.LSTM(_COORDINATES, features, _LAYERS, batch_first=True)
            for _ in range(REFERENCE_LINES)
        )
        self.linearA = nn.Linear(features, features)
        self.linearC = nn.Linear(features, features)
        self.fc_listB = nn.ModuleList(nn.Linear(features, features) for _ in range(REFERENCE_LINES))
        self.mlp = nn.Sequential(
            nn.Linear(features, _RADIUS_HIDDEN), nn.ReLU(), nn.Linear(_RADIUS_HIDDEN, 1)
        )

    def forward(self, history: Tensor, changes: Tensor, reference: Tensor) -> Tensor:
        """Return radii, (m,) in metres.

        Parameters
        ----------
        history
            (m, 49, 4), the points before, with 0 as the number of their line.
        changes
            (m, 48, 4), the same but the last; for the radius, its change to the next point.
        reference
            (m, 3, 20, 4), points of the preceding turn around the azimuth of the point.
        """
        parts = [self.linearA(self.lstmA(_scaled(history))[0][:, -1])]
        near = _scaled(reference).unbind(dim=1)
        for points, lstm, linear in zip(near, self.lstmB, self.fc_listB, strict=True):
            parts.append(linear(lstm(points)[0][:, -1]))
        parts.append(self.linearC(self.lstmC(_scaled(changes))[0][:, -1]))
        mixed = self.self_attn_A(torch.stack(parts, dim=1)).mean(dim=1)
        radius: Tensor = self.mlp(mixed)[:, 0]
        return radius


def _scaled(points: Tensor) -> Tensor:
    scaled = points.clone()
    scaled[..., 0] = points[..., 0] * (360 / STEPS_PER_TURN) / 4
    scaled[..., 1] = points[..., 1] + 30
    return scaled


def network_with(network: type[N], state: Mapping[str, Any], fault: str) -> N:
    """Return a network with the parameters of a checkpoint, ready to predict.

    Parameters
    ----------
    network
        Class of the network.
    state
        Parameters by the authors' name.
    fault
        Error message if the parameters belong to another network.

    Raises
    ------
    InputError
        The parameters belong to another network, or are not finite.
    """
    model = network()
    try:
        model.load_state_dict(dict(state))
    except (RuntimeError, TypeError, AttributeError) as error:
        raise InputError(fault) from error
    if not all(bool(torch.isfinite(each).all()) for each in model.parameters()):
        raise InputError(f"{fault} (not finite)")
    return model.eval().requires_grad_(False)
