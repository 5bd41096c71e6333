"""Pool of trial runners: trials of one object and gripper on several threads.

MuJoCo computes without Python's lock, so threads share all cores. A trial's outcome does not depend
on the runner, so neither do results on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import TypeVar

from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.simulation.campaign.executors import usable_cores
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.scene import Scene
from graspcast.simulation.trial.trial import Outcome, TrialRunner, TrialSettings

__all__ = ["Trial", "TrialPool"]

Trial = tuple[Float[ndarray, "4 4"], Float[ndarray, "4 4"]]
"""The estimate in the true object's frame, and the grasp."""

T = TypeVar("T")
R = TypeVar("R")


class TrialPool:
    """Runs trials of one object and gripper on several threads.

    Parameters
    ----------
    grasp_object, gripper, settings
        As for :class:`~graspcast.simulation.trial.trial.TrialRunner`.
    workers
        Number of threads; all usable cores if None.

    Attributes
    ----------
    trials
        Number of trials run so far.
    """

    def __init__(
        self,
        grasp_object: GraspObject,
        gripper: Gripper,
        settings: TrialSettings | None = None,
        workers: int | None = None,
    ):
        workers = usable_cores() if workers is None else workers
        if workers < 1:
            raise InputError(
                f"workers is {workers}; it must be at least 1", parameters=("workers",)
            )
        self.grasp_object, self.gripper = grasp_object, gripper
        self.trials = 0
        self._runners = [TrialRunner(grasp_object, gripper, settings) for _ in range(workers)]

    @property
    def scene(self) -> Scene:
        """Scene of one of the runners."""
        return self._runners[0].scene

    @property
    def settings(self) -> TrialSettings:
        """How the trials are run."""
        return self._runners[0].settings

    def run(self, trials: Sequence[Trial]) -> list[Outcome]:
        """Run trials, and return their outcomes in the same order."""
        names = (self.grasp_object.name, self.gripper.name)
        self.trials += len(trials)
        return self.map(lambda runner, trial: runner.run(trial[0], Grasp(trial[1], *names)), trials)

    def map(self, function: Callable[[TrialRunner, T], R], items: Sequence[T]) -> list[R]:
        """Call a function with each item and a runner of the thread's own, in any order."""
        if len(self._runners) == 1 or len(items) < 2:
            return [function(self._runners[0], item) for item in items]
        free: SimpleQueue[TrialRunner] = SimpleQueue()
        for runner in self._runners:
            free.put(runner)

        def call(item: T) -> R:
            runner = free.get()
            try:
                return function(runner, item)
            finally:
                free.put(runner)

        threads = ThreadPoolExecutor(len(self._runners))
        try:
            return list(threads.map(call, items))
        finally:
            threads.shutdown(cancel_futures=True)
