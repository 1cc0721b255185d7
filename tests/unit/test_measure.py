import time

import numpy as np

from puckbench.codecs.measure import measured


def test_time_is_the_median_of_the_repetitions() -> None:
    waits = iter([0.001, 0.2, 0.02])
    found = measured(lambda: time.sleep(next(waits)), repeats=3)
    assert 0.02 <= found.seconds < 0.19


def test_peak_memory_is_that_of_the_call_alone() -> None:
    ballast = np.ones(40 * 2**17)  # 40 MiB, there before the call
    found = measured(lambda: np.ones(100 * 2**17).sum())
    assert 95 <= found.peak_mib <= 110
    assert ballast.size


def test_the_result_comes_back() -> None:
    assert measured(lambda: "x").result == "x"
