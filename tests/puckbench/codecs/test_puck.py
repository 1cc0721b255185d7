"""Rates of the codec puck."""

from __future__ import annotations

import numpy as np
import pytest

from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode_cloud, encode_returns
from tests.support.returns import recorded


@pytest.mark.parametrize("name", ["puck", "puck_smoothed"])
def test_lossy_rates_are_optimised_and_the_exact_one_is_as_it_was(name: str) -> None:
    returns = recorded()
    codec, plain = open_codec(name), open_codec(name, {"options": {"lmbda": 0}})
    for rate in codec.rates:
        sizes = [len(encode_returns(variant, returns, rate)) for variant in (codec, plain)]
        steps = codec.step_in_quanta(returns, rate)
        if steps == 1:
            assert encode_returns(codec, returns, rate) == encode_returns(plain, returns, rate)
        elif steps % 2 == 0 or steps > 20:
            assert sizes[0] < sizes[1]
        else:  # no tie to break and noise as large as the step: hardly a choice
            assert sizes[0] <= 1.001 * sizes[1]


def test_ranges_are_rounded_to_no_more_than_the_length_of_a_rate() -> None:
    returns, codec = recorded(), open_codec("puck", {"options": {"lmbda": 0}})
    for rate, same, most in (("3mm", "2mm", 0), ("0.5mm", "2mm", 0), ("1.3cm", "12mm", 3)):
        stream = encode_returns(codec, returns, rate)
        assert stream == encode_returns(codec, returns, same)
        decoded = decode_cloud(codec, stream).returns
        assert decoded is not None
        pairs = zip(returns.turns, decoded.turns, strict=True)
        assert max(int(np.abs(a.ranges.astype(int) - b.ranges).max()) for a, b in pairs) == most
