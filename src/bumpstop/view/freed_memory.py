"""Where memory goes that is not used any more."""

from __future__ import annotations

import ctypes

# Parameters of glibc's mallopt.
_MMAP_THRESHOLD, _ARENA_MAX = -3, -8
_LARGE_BYTES = 1 << 20


def return_freed_memory() -> None:
    """Have this process give back what it frees, where its C library is glibc; others stay as they are.

    glibc keeps an area for every thread, and after the first large block that is freed also blocks of up to 32 MB in
    these areas, whatever small thing lies behind them. Threads that compute scenarios of all sizes then hold many times
    what they use. One area, and large blocks outside it, cost a system call for each.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(_ARENA_MAX, 1)
    mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)


def trim_freed_memory() -> None:
    """Give back now what is free between smaller blocks that are in use; glibc by itself gives back the end alone."""
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return
    trim(0)
