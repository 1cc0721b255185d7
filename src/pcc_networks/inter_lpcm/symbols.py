"""Distributions of the symbols of azimuths and radii, and their range coder.

A network predicts mean and deviation of a normal distribution from the 49 preceding symbols. Its
weights and features are rounded to fixed point, such that all sums are exact in double precision,
in any order: encoder and decoder agree on every machine, however many symbols they take at once.
Mean and deviation are rounded to 0.01, as by the authors, whose "skewed" distribution of azimuths
is a normal one with a larger deviation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcc_networks.entropy_bottleneck import range_decoder
from pcc_networks.inter_lpcm.weights import HISTORY, Doubles, Layer

Ints = NDArray[np.int64]
Integers = NDArray[np.integer[Any]]
MAX_SYMBOL = 2**15 - 1
"""Largest magnitude of a symbol."""
_WEIGHT_UNIT, _FEATURE_UNIT = 2.0**14, 2.0**10
_MOST_WEIGHT, _MOST_FEATURE = 2.0**17, 2.0**27
"""Largest magnitudes in fixed point: sums of 256 products stay below 2^53."""
_LEAST_DEVIATION = 0.01
_FREQUENCIES = 2**16
_ROWS = 4096
"""Number of symbols whose features are computed at once."""


class Distributions(NamedTuple):
    """Normal distributions of symbols: means (n,) and deviations (n,)."""

    mean: Doubles
    deviation: Doubles


class SymbolNetwork:
    """Network of one kind of symbols, in fixed point.

    Parameters
    ----------
    layers
        Its layers: first, residual blocks of two layers each, last.
    """

    def __init__(self, layers: Sequence[Layer]) -> None:
        self._matrices = [_fixed(layer.matrix, _WEIGHT_UNIT) for layer in layers]
        self._biases = [_fixed(layer.bias, _WEIGHT_UNIT) * _FEATURE_UNIT for layer in layers]

    def distributions(self, contexts: Integers) -> Distributions:
        """Return the distributions of symbols from the symbols (n, 49) before each of them."""
        parts = [self._outputs(contexts[k : k + _ROWS]) for k in range(0, len(contexts), _ROWS)]
        outputs = np.concatenate(parts) if parts else np.zeros((0, len(self._biases[-1])))
        deviation = np.logaddexp(0, outputs[:, 1]) + _LEAST_DEVIATION
        deviation = np.maximum(_hundredths(deviation), _LEAST_DEVIATION)
        if outputs.shape[1] > 2:
            skew = _hundredths(5 * np.tanh(outputs[:, 2]))
            deviation = deviation * np.sqrt(1 + np.pi / 8 * np.square(skew))
        return Distributions(_hundredths(outputs[:, 0]), deviation)

    def _outputs(self, contexts: Integers) -> Doubles:
        x = self._layer(0, contexts.astype(np.float64) * _FEATURE_UNIT)
        x = np.maximum(x, 0)
        for k in range(1, len(self._matrices) - 1, 2):
            inner = np.maximum(self._layer(k, x), 0)
            x = np.clip(self._layer(k + 1, inner) + x, 0, _MOST_FEATURE)
        return self._layer(len(self._matrices) - 1, x) / _FEATURE_UNIT

    def _layer(self, k: int, features: Doubles) -> Doubles:
        bounded = np.clip(features, -_MOST_FEATURE, _MOST_FEATURE)
        return np.rint((bounded @ self._matrices[k] + self._biases[k]) / _WEIGHT_UNIT)


def contexts_of(symbols: Ints, before: int) -> Ints:
    """Return the 49 symbols before each symbol of a sequence, (n, 49).

    Parameters
    ----------
    symbols
        The sequence, (n,).
    before
        Symbol that stands for those before the first.
    """
    padded = np.concatenate([np.full(HISTORY, before), symbols])
    windows: Ints = np.lib.stride_tricks.sliding_window_view(padded, HISTORY)[: len(symbols)]
    return windows


def code_length(symbols: Ints, distributions: Distributions) -> float:
    """Return the bits that the authors' range coder takes for symbols (n,).

    It has probabilities of 16 bits, and gives each value between the smallest and the largest
    symbol at least 2^-16. Its few bytes at the end of each 200 symbols are not counted.
    """
    from scipy.special import ndtr

    mean, deviation = distributions
    upper, lower = ((symbols + side - mean) / deviation for side in (0.5, -0.5))
    # differences in the lower tail, where they are exact
    flip = lower > 0
    probability = ndtr(np.where(flip, -lower, upper)) - ndtr(np.where(flip, -upper, lower))
    floors = (np.ptp(symbols) + 1) / _FREQUENCIES
    return float(-np.log2(probability * (1 - floors) + 1 / _FREQUENCIES).sum())


class SymbolWriter:
    """Encodes symbols with normal distributions.

    Parameters
    ----------
    least, most
        Smallest and largest symbol that occur.
    """

    def __init__(self, least: int, most: int) -> None:
        import constriction

        self._coder = constriction.stream.queue.RangeEncoder()
        self._model = _normal(least, most)

    def write(self, symbols: Ints, distributions: Distributions) -> None:
        """Append symbols (n,)."""
        self._coder.encode(symbols.astype(np.int32), self._model, *distributions)

    def written(self) -> bytes:
        """Return the bytes of all symbols."""
        return bytes(self._coder.get_compressed().astype("<u4").tobytes())


class SymbolReader:
    """Decodes symbols that `SymbolWriter` encoded; see `symbol_reader`."""

    def __init__(self, coder: Any, least: int, most: int) -> None:
        self._coder, self._model = coder, _normal(least, most)

    def read(self, distributions: Distributions) -> Ints:
        """Return the next symbols, one for each distribution."""
        symbols: Ints = self._coder.decode(self._model, *distributions).astype(np.int64)
        return symbols


@contextmanager
def symbol_reader(data: bytes, least: int, most: int, part: str) -> Iterator[SymbolReader]:
    """Open a reader of symbols between `least` and `most`.

    Raises InputError, which names the part of the stream, if the data turn out to be damaged.
    """
    with range_decoder(data, part) as coder:
        yield SymbolReader(coder, least, most)


def _normal(least: int, most: int) -> Any:
    import constriction

    # two symbols at least, as the coder asks
    return constriction.stream.model.QuantizedGaussian(least, max(most, least + 1))


def _fixed(values: Doubles, unit: float) -> Doubles:
    return np.clip(np.rint(values * unit), -_MOST_WEIGHT, _MOST_WEIGHT)


def _hundredths(values: Doubles) -> Doubles:
    return np.rint(values * 100) / 100
