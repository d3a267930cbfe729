"""What the C library does with memory that was freed."""

import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of mallopt(3)
MOST = 2**31 - 1  # bytes at the end of the heap that are kept
# Bytes of a block that comes from the heap: older releases of glibc refuse the first and take the second at most.
LARGEST = (2**30, 2**25)


def keep_freed_memory() -> bool:
    """Keep large blocks that are freed, up to 2 GB, for the next one of their size.

    By default glibc hands them back to the system, and each step of a training, whose tensors have the sizes of the
    step before, is given new pages that have to be found and cleared.

    Returns:
        Whether the C library can be told so: glibc can, others are left as they are.
    """
    tell = getattr(ctypes.CDLL(None), "mallopt", None)
    return (
        tell is not None
        and any(tell(M_MMAP_THRESHOLD, size) for size in LARGEST)
        and bool(tell(M_TRIM_THRESHOLD, MOST))
    )
