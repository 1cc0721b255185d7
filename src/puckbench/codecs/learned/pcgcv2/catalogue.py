"""How PCGCv2's weights are called: ``c8_a025_32000.pth`` among the authors' has alpha 0.25."""

from __future__ import annotations

from puckbench.codecs.learned.catalogue import Network


def _alpha(digits: str) -> float:
    return float(f"0.{digits[1:]}" if digits.startswith("0") else digits)


NETWORK = Network("pcgcv2", r"c8_a(\d+)_\d+\.pth", _alpha)
