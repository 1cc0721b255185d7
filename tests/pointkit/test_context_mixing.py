from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pointkit.coding.binary_coder import (
    LOGIT_UNIT,
    BitCoder,
    bit_reader,
    bit_writer,
    read_to_its_end,
    written,
)
from pointkit.coding.context_mixing import Mixer, MixerOptions, code_bit, new_mixer
from pointkit.compiling import compiled_in_place

Ints = NDArray[np.int64]
OPTIONS = MixerOptions(
    experts=1, contexts=2, counters=32, rows=8, weights=(0.4, 0.3, 0.3), learning_rate=14,
    final_learning_rate=3, memory=100,
)  # fmt: skip


@compiled_in_place
def _code(mixer: Mixer, bits: Ints, logits: Ints, contexts: Ints) -> None:
    """Code bits (n,) with one expert's logits (n,), if there is one, and contexts (n,)."""
    for i in range(len(bits)):
        for k in range(len(mixer.sizes.experts)):
            mixer.inputs[k] = logits[i]
        for k in range(len(mixer.contexts)):
            mixer.contexts[k] = 16 * k + contexts[i] >> k
        for k in range(len(mixer.rows)):
            mixer.rows[k] = 2 * k + contexts[i] & 1
        bits[i] = code_bit(mixer, bits[i], 0, 0)


def _encoded(bits: Ints, logits: Ints, contexts: Ints, options: MixerOptions) -> bytes:
    coder = bit_writer(2 * len(bits) + 16)
    _code(new_mixer(coder, options), bits.copy(), logits, contexts)
    return written(coder)


def _decoded(coder: BitCoder, logits: Ints, contexts: Ints, options: MixerOptions) -> Ints:
    bits = np.zeros_like(logits)
    _code(new_mixer(coder, options), bits, logits, contexts)
    return bits


def _drawn(probabilities: NDArray[np.float64], seed: int = 0) -> Ints:
    random = np.random.default_rng(seed).random(len(probabilities))
    return (random < probabilities).astype(np.int64)


def _entropy(probabilities: NDArray[np.float64]) -> float:
    p = probabilities
    return float(-(p * np.log2(p) + (1 - p) * np.log2(1 - p)).sum())


COUNT = 20_000
CONTEXTS = np.random.default_rng(1).integers(0, 16, COUNT)
BY_CONTEXT = np.linspace(0.02, 0.9, 16)[CONTEXTS]
NO_LOGITS = np.zeros(COUNT, np.int64)


@pytest.mark.parametrize(("experts", "contexts"), [(0, 1), (0, 2), (1, 0), (1, 2), (2, 1)])
@pytest.mark.parametrize(("sets", "tables"), [(1, 1), (3, 1), (3, 2)])
def test_bits_come_back(experts: int, contexts: int, sets: int, tables: int) -> None:
    options = replace(
        OPTIONS, experts=experts, contexts=contexts, sets=sets, tables=tables,
        weights=(0.3,) * (experts + contexts),
    )  # fmt: skip
    logits = np.random.default_rng(2).integers(-8 * LOGIT_UNIT, 8 * LOGIT_UNIT, COUNT)
    bits = _drawn(BY_CONTEXT)
    coder = bit_reader(_encoded(bits, logits, CONTEXTS, options))
    np.testing.assert_array_equal(_decoded(coder, logits, CONTEXTS, options), bits)
    assert read_to_its_end(coder)


@pytest.mark.parametrize("tables", [1, 2])
def test_contexts_learn_their_probabilities(tables: int) -> None:
    options = replace(OPTIONS, sets=2, tables=tables, memory=160)
    size = 8 * len(_encoded(_drawn(BY_CONTEXT), NO_LOGITS, CONTEXTS, options))
    assert _entropy(BY_CONTEXT) < size < 1.04 * _entropy(BY_CONTEXT)


def test_an_expert_that_knows_the_probabilities_is_believed() -> None:
    probabilities = np.random.default_rng(3).uniform(0.02, 0.98, COUNT)
    logits = np.rint(LOGIT_UNIT * np.log(probabilities / (1 - probabilities))).astype(np.int64)
    size = 8 * len(_encoded(_drawn(probabilities), logits, CONTEXTS, OPTIONS))
    assert size < 1.03 * _entropy(probabilities)


def test_an_expert_that_is_wrong_is_turned_round() -> None:
    probabilities = np.random.default_rng(3).uniform(0.02, 0.98, COUNT)
    logits = np.rint(-LOGIT_UNIT * np.log(probabilities / (1 - probabilities))).astype(np.int64)
    size = 8 * len(_encoded(_drawn(probabilities), logits, CONTEXTS, OPTIONS))
    assert size < 1.06 * _entropy(probabilities)
