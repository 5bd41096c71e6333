"""Limits of downloads: times, attempts, sizes, and what an archive may hold."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Limits"]

_MIB, _GIB = 2**20, 2**30


@dataclass(frozen=True)
class Limits:
    """Limits of downloads.

    Attributes
    ----------
    connect_s, stall_s
        Seconds until a connection must stand, and within which more of a file must arrive.
    stall_bytes
        How much must arrive within ``stall_s``.
    attempts, unreachable_attempts
        Attempts without progress after which a download fails, and those where no answer came.
    progress_bytes
        What an attempt must bring for the attempts to be counted anew.
    backoff_s, longest_wait_s
        Wait before the second attempt, doubled before each further one, and the longest wait.
    redirects
        Redirects that are followed.
    lock_s
        How long another process that fetches the same is waited for.
    smallest_limit, size_factor
        A download may have ``size_factor`` times the size that is known of it, and this at least.
    unpacked_bytes, members, ratio, ratio_from
        Most bytes, most members, and most bytes a byte of archive, of what is larger than this.
    spare_bytes
        Free space that is left on the disk.
    """

    connect_s: float = 15.0
    stall_s: float = 30.0
    stall_bytes: int = 1024
    attempts: int = 5
    unreachable_attempts: int = 3
    progress_bytes: int = _MIB
    backoff_s: float = 1.0
    longest_wait_s: float = 60.0
    redirects: int = 8
    lock_s: float = 6 * 3600.0
    smallest_limit: int = 64 * _MIB
    size_factor: int = 4
    unpacked_bytes: int = 16 * _GIB
    members: int = 200_000
    ratio: float = 200.0
    ratio_from: int = 64 * _MIB
    spare_bytes: int = 64 * _MIB
