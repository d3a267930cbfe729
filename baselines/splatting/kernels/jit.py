"""How the kernels are compiled: to machine code on first use, kept on disk for every later process.

Numba re-compiles a cached kernel when the file that defines it changes, but not when a function it calls changes in
another file. So the cache lives in a folder named after all files in this folder and below it, their path and content,
and after the processor and its instructions in use. A kernel defined elsewhere calls what is defined in its own file or
in this folder, and nothing else: a test goes through all kernels.
"""

import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numba
import platformdirs

from baselines.splatting.kernels.simd import SIMD, machine

HERE = Path(__file__).parent
SOURCES = tuple(sorted(HERE.rglob("*.py")))  # of the kernels in this folder and below it
CONFIG: Any = numba.config  # its settings are made at run time

# Not "reassoc" (it breaks the magic-number 2^x), not "nnan" or "ninf" (culling relies on NaN comparing false).
FAST = {"contract", "nsz", "arcp", "afn"}
EXACT = {"contract"}
INSIDE: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # no way in but from kernels


def digest(sources: Iterable[Path]) -> str:
    """Twelve hexadecimal digits of files, where they are and what is in them, and of what machine runs them.

    Numba finds machine code by its source's path: a copied folder of it is of no use to a copy of the sources.
    """
    content = b"".join(os.fsencode(path) + path.read_bytes() for path in sorted(sources))
    return hashlib.sha256(content + machine().encode()).hexdigest()[:12]


def _cache_folder() -> str:
    if CONFIG.CACHE_DIR:
        parent = Path(CONFIG.CACHE_DIR)
    elif os.access(HERE, os.W_OK):
        parent = HERE / "__pycache__"
    else:
        parent = platformdirs.user_cache_path("hydroviews", appauthor=False)
    return str(parent / f"kernels-{SIMD}-{digest(SOURCES)}")


FOLDER = _cache_folder()


def _compile(function: Callable, **options: Any) -> Callable:
    before = CONFIG.CACHE_DIR
    CONFIG.CACHE_DIR = FOLDER  # read when the decorator runs, so other packages' caches stay where they are
    try:
        return numba.njit(cache=True, error_model="numpy", **options)(function)
    finally:
        CONFIG.CACHE_DIR = before


def kernel(function: Callable) -> Callable:
    """A float32 kernel whose `prange` loops run on all threads.

    Chunks are fixed or whole tiles, so results do not depend on the number of threads.
    """
    return _compile(function, parallel=True, fastmath=FAST)


def exact_kernel(function: Callable) -> Callable:
    """The same for kernels that calculate in float64: no approximate functions or reciprocals."""
    return _compile(function, parallel=True, fastmath=EXACT)


def serial_kernel(function: Callable) -> Callable:
    """A kernel on one thread."""
    return _compile(function, fastmath=EXACT)


def inlined(function: Callable) -> Callable:
    """A function that becomes part of the kernels calling it. Python cannot call it, which saves compiling."""
    return numba.njit(forceinline=True, error_model="numpy", fastmath=EXACT, **INSIDE)(function)
