"""Settings of training the built-in estimators."""

from __future__ import annotations

from dataclasses import dataclass

from graspcast.errors import InputError, UnknownNameError
from graspcast.perception.estimator import BUILT_IN

__all__ = ["TrainingSettings"]


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of training the built-in estimators.

    Attributes
    ----------
    estimators
        The estimators to train, of ``dense``, ``direct`` and ``keypoints``; they share batches.
    images
        Number of rendered training images, each of several objects.
    steps
        Number of batches of 32 crops. More can be asked for later; the learning rate depends on the
        share that is done.
    validation_images
        Number of rendered images on which errors are measured at the end.
    seed
        Random seed of images, batches and weights.
    strength
        Strength of image augmentation: 0.3 for rendered images, 1 for photographs.
    device
        ``auto``, ``cpu`` or ``cuda``.
    threads
        Number of threads on the CPU; 0 for half of the cores.
    """

    estimators: tuple[str, ...] = BUILT_IN
    images: int = 6400
    steps: int = 20_000
    validation_images: int = 80
    seed: int = 1
    strength: float = 0.3
    device: str = "auto"
    threads: int = 0

    def __post_init__(self) -> None:
        for name in self.estimators:
            if name not in BUILT_IN:
                raise UnknownNameError("estimator", name, BUILT_IN, parameters=("estimator",))
        if not self.estimators or len(set(self.estimators)) < len(self.estimators):
            raise InputError(
                f"estimators are some of {', '.join(BUILT_IN)}, each once; not "
                f"{', '.join(self.estimators) or 'none'}",
                parameters=("estimator",),
            )
        for name in ("images", "steps", "validation_images"):
            if getattr(self, name) < 1:
                raise InputError(
                    f"{name.replace('_', ' ')}: at least one is needed, not {getattr(self, name)}",
                    parameters=(name,),
                )
        if self.seed < 0 or self.threads < 0:
            raise InputError("seed and threads are 0 or more", parameters=("seed", "threads"))
        if not 0 <= self.strength <= 2:
            raise InputError(
                f"the strength of augmentation is from 0 to 2, not {self.strength}",
                parameters=("strength",),
            )
