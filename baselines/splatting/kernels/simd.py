"""Which instructions of the processor the kernels use.

    avx512   16 float32 numbers at a time, and the instructions of AVX-512 for 2^x and 1 / x
    avx2     8 at a time
    neon     8 at a time, on ARM
    plain    one at a time, on any processor

The best that the processor has is taken; $HYDROVIEWS_SIMD forces one. All of them run the same kernels: `vectors.py`
says what changes. Results differ by rounding.
"""

import os
import platform
from typing import Any, NamedTuple

import numba
from llvmlite import binding

from hydroviews.errors import InputError

VARIABLE = "HYDROVIEWS_SIMD"
HASWELL = "haswell"  # the first processor with AVX2 and fused multiply-add, and without AVX-512
CONFIG: Any = numba.config  # its settings are made at run time


class Lanes(NamedTuple):
    """How many numbers are calculated at a time."""

    float32: int
    float64: int


LANES = {"avx512": Lanes(16, 8), "avx2": Lanes(8, 4), "neon": Lanes(8, 4), "plain": Lanes(1, 1)}
NEEDED = {
    "avx512": ("avx512f", "avx512bw", "avx512dq", "avx512vl", "fma"),
    "avx2": ("avx2", "fma"),
    "neon": ("neon",),
    "plain": (),
}


def available() -> list[str]:
    """What this processor can run, the fastest first."""
    features = dict(binding.get_host_cpu_features())
    features["neon"] = features.get("neon", platform.machine().lower() in ("aarch64", "arm64"))
    return [name for name, needed in NEEDED.items() if all(features.get(feature) for feature in needed)]


def chosen() -> str:
    """The name of the instructions in use.

    Raises:
        InputError: $HYDROVIEWS_SIMD names none, or one that this processor lacks.
    """
    names = available()
    wanted = os.environ.get(VARIABLE) or names[0]
    if wanted not in names:
        raise InputError(
            f"{VARIABLE}: this processor cannot run them",
            found=wanted,
            expected=" or ".join(names),
            fix=f"unset {VARIABLE}, and the fastest are taken",
        )
    return wanted


SIMD = chosen()

# Otherwise LLVM uses AVX-512 registers wherever it sees fit, and AVX2 could be tested on older processors alone.
if SIMD == "avx2" and "avx512" in available():
    CONFIG.CPU_NAME, CONFIG.CPU_FEATURES = HASWELL, ""


def machine() -> str:
    """What compiled code is for: it runs nowhere else, or calculates in other ways there."""
    name = CONFIG.CPU_NAME or binding.get_host_cpu_name()
    features = binding.get_host_cpu_features().flatten() if CONFIG.CPU_FEATURES is None else CONFIG.CPU_FEATURES
    return f"{SIMD} {name} {features}"
