"""`load` compiles every loop, so that no timed call does."""

import subprocess
import sys

_CODE = """
import sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, encode

def compiled():
    ours = ("gpcc.", "pointkit.", "primitive_codec.")
    modules = [m for name, m in sys.modules.items() if name.startswith(ours)]
    loops = {id(f): f for m in modules for f in vars(m).values() if isinstance(f, Dispatcher)}
    return {f.__qualname__: len(f.signatures) for f in loops.values() if f.signatures}

codec = open_codec("primitives")
codec.load()
before = compiled()
rng = np.random.default_rng(1)
turn = rng.random(4000) * 2 * np.pi
can = np.column_stack([300 + 150 * np.cos(turn), 300 + 150 * np.sin(turn), 400 * rng.random(4000)])
wall = rng.random((4000, 3)) * [1000, 1000, 0]
points = np.concatenate([can, wall]) + rng.normal(0, 2, (8000, 3))
for rate in codec.rates:
    decode(codec, encode(codec, points, rate))
after = compiled()
print(len(before), sorted(name for name in after if after[name] != before.get(name)))
"""


def test_no_timed_call_compiles() -> None:
    """In a process of its own: other tests have compiled the loops of this one."""
    run = subprocess.run([sys.executable, "-c", _CODE], capture_output=True, text=True, check=True)
    loops, _, late = run.stdout.strip().partition(" ")
    assert int(loops) > 30
    assert late == "[]"
