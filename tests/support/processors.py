"""What a script prints where libraries (NumPy, PyTorch, the C library) use other instructions."""

from __future__ import annotations

import os
import subprocess
import sys

_PROCESSORS: tuple[dict[str, str], ...] = (
    {},
    {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX2 FMA3 AVX512F AVX512_SKX",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4",
        "ATEN_CPU_CAPABILITY": "default",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "MKL_CBWR": "COMPATIBLE",
    },
    {"OPENBLAS_CORETYPE": "Haswell"},
)
"""Environments that choose the instructions: this machine's, an old processor's, and those of
another processor for NumPy's linear algebra alone."""


def printed_on_processors(script: str) -> set[str]:
    """The different outputs of a script, run once for each of the processors of x86-64."""
    return {
        subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore", **changes},
            check=True, capture_output=True, text=True,
        ).stdout
        for changes in _PROCESSORS
    }  # fmt: skip
