"""Limits on the address space (``ulimit -v``), which polars, MuJoCo and numba do not survive."""

from __future__ import annotations

import os

from graspcast.errors import InputError

__all__ = ["check_address_space"]

# Measured on Linux as the peak of `errors` and `simulate`: 1.75 GB with 2 threads in each pool,
# 2.09 GB with 32.
_LEAST, _PER_CORE = 1_800_000_000, 10_000_000


def check_address_space() -> None:
    """Refuse a limit in which libraries abort the process or crash it when they are loaded.

    Raises
    ------
    InputError
        If the limit is too low. The message names the least that is needed.
    """
    try:
        import resource
    except ImportError:  # pragma: no cover - on Windows
        return
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    least = _LEAST + _PER_CORE * (os.cpu_count() or 1)
    if allowed != resource.RLIM_INFINITY and allowed < least:
        raise InputError(
            f"the address space of this process is limited to {allowed / 1e9:.2f} GB; at least "
            f"{least / 1e9:.2f} GB are needed (in a shell: ulimit -v {-(-least // 1024)}, or more)"
        )
