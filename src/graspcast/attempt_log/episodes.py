"""Episodes of attempt logs as scenes: numbers by which tables name them."""

from __future__ import annotations

from hashlib import sha256

__all__ = ["scene_of"]


def scene_of(episode: str) -> int:
    """Return the number of an episode's scene, the same in every log and model.

    It is a digest of the episode's id, above all numbers of published scenes, so that a model that
    was trained on an episode is known to have seen it.
    """
    return 1 << 52 | int(sha256(episode.encode()).hexdigest()[:13], 16)
