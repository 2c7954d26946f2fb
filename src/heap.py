"""What a process does with the memory that its tensors free."""

import ctypes

# The parameters of malloc.h by their numbers there, and what they are set to, in bytes.
TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = -1, -2, -3
KEPT = {MMAP_THRESHOLD: 2**30, TRIM_THRESHOLD: 2**31 - 1, TOP_PAD: 2**28}


def keep_freed_memory() -> None:
    """Makes glibc keep freed memory for the next tensor, up to 2 GiB.

    Otherwise it gives a large tensor back to the kernel, from which every step then takes the same
    hundreds of megabytes again, page by page. Does nothing without glibc.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for parameter, value in KEPT.items():
            mallopt(parameter, value)
