"""The C library's handling of freed memory."""

import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of mallopt(3)
KEPT = 2**31 - 1  # bytes at the end of the heap that are not returned to the system
# Bytes up to which a block is taken from the heap: older releases of glibc refuse the first and accept the second.
HEAP_BLOCKS = (2**30, 2**25)


def keep_freed_memory() -> bool:
    """Keep freed memory, up to 2 GB, for the process's next allocations.

    By default glibc returns large blocks to the system. Each step of a training, whose tensors have the sizes of the
    step before, would then wait for the system to find and clear new pages.

    Returns:
        Whether it was set: only glibc has `mallopt(3)`; other C libraries keep their defaults.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return (
        mallopt is not None
        and any(mallopt(M_MMAP_THRESHOLD, size) for size in HEAP_BLOCKS)
        and bool(mallopt(M_TRIM_THRESHOLD, KEPT))
    )
