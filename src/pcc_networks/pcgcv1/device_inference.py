from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import max_pool3d

from pcc_networks.device import device_of
from pcc_networks.pcgcv1.inference import Floats32, Integers, quantised
from pcc_networks.pcgcv1.model import PCGCv1, coded_blocks
from pcc_networks.pcgcv1.occupied_blocks import Bools


class DeviceTransforms:
    def __init__(self, model: PCGCv1) -> None:
        self._model, self._device = model, device_of(model)

    def analyse(self, occupied: Floats32, rate: int) -> tuple[Integers, Integers]:
        model = self._model
        with torch.inference_mode():
            x = self._to_device(occupied)[None, None]
            blocks = coded_blocks(model.shape, x)
            y = model.g_a(x) * model.gain(rate) * blocks
            z = model.h_a(y) * max_pool3d(blocks, 2)
            return quantised(y.cpu()), quantised(z.cpu())

    def synthesise(self, y_hat: Integers, rate: int, blocks: Bools) -> Floats32:
        with torch.inference_mode():
            y = self._to_device(y_hat)[None].float() / self._model.gain(rate)
            logits: Floats32 = self._model.g_s(y).flatten().cpu().numpy()
        return logits

    def _to_device(self, values: Floats32 | Integers) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values)).to(self._device)
