"""What a worker of a campaign gets and does: chunks of trials of one object by one gripper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.io.hashing import sha256
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.table import GraspTable
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.catalogue import Catalogue
from graspcast.simulation.objects.load import BopDirectories, load_object
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.trial import Outcome, TrialRunner, TrialSettings

__all__ = ["Batch", "TrialSetup", "load_setups", "run_batch"]


@dataclass(frozen=True, eq=False)
class TrialSetup:
    """An object, a gripper, the reference grasp, and how it is tried.

    Attributes
    ----------
    settings
        How.
    early_stop
        Whether a trial ends as soon as its outcome is certain.
    """

    grasp_object: GraspObject
    gripper: Gripper
    grasp: Grasp
    settings: TrialSettings
    early_stop: bool = True

    @cached_property
    def digest(self) -> str:
        """SHA-256, as hex, over everything that an outcome depends on besides the estimate.

        Raises
        ------
        MismatchError
            If the object does not stay in its reference pose.
        """
        grasp = np.asarray(self.grasp.obj_T_grasp, dtype="<f8")
        return sha256(self.runner().digest, grasp, "early" if self.early_stop else "full")

    def runner(self) -> TrialRunner:
        """A new runner of its trials."""
        return TrialRunner(self.grasp_object, self.gripper, self.settings)


@dataclass(frozen=True, eq=False)
class Batch:
    """Trials of one pair: their row numbers among the requests, and the estimates."""

    pair: tuple[str, str]
    rows: Int[ndarray, " n"]
    obj_T_est: Float[ndarray, "n 4 4"]


def load_setups(
    requests: TrialRequests,
    grasps: GraspTable,
    *,
    settings: TrialSettings | None = None,
    bop_dirs: BopDirectories | None = None,
    catalogue: Catalogue | None = None,
    grippers: Mapping[str, Gripper] | None = None,
) -> dict[tuple[str, str], TrialSetup]:
    """Load every object and gripper that the requests name, with their reference grasps.

    Parameters
    ----------
    requests
        The trials.
    grasps
        The reference grasps.
    settings
        How to try.
    bop_dirs, catalogue
        Where the objects are, as for :func:`load_object`.
    grippers
        Grippers of one's own by name; the others are built-in ones.

    Returns
    -------
        (object, gripper) to what to try.

    Raises
    ------
    UnknownNameError
        For an unknown object or gripper, or a pair without a grasp.
    InputError
        For an object that cannot be loaded.
    """
    references = {pair: grasps(*pair) for pair in requests.pairs()}
    objects = {
        name: load_object(name, bop_dirs=bop_dirs, catalogue=catalogue)
        for name in dict.fromkeys(name for name, _ in references)
    }
    own = grippers or {}
    hands = {g: own[g] if g in own else load_gripper(g) for g in {g for _, g in references}}
    return {
        (name, gripper): TrialSetup(
            grasp_object=reference.applied_to(objects[name]),
            gripper=hands[gripper],
            grasp=reference.grasp,
            settings=settings or TrialSettings(),
        )
        for (name, gripper), reference in references.items()
    }


_runners: dict[str, TrialRunner] = {}


def run_batch(pair: TrialSetup, chunk: Batch) -> list[Outcome]:
    """Run the trials of a chunk; the compiled model of a pair stays in the process.

    Raises
    ------
    InputError
        Naming the pair, whatever went wrong.
    """
    try:
        if pair.digest not in _runners:
            _runners[pair.digest] = pair.runner()
        runner = _runners[pair.digest]
        return [runner.run(e, pair.grasp, early_stop=pair.early_stop) for e in chunk.obj_T_est]
    except Exception as error:
        # A plain error travels between processes; its cause does not, so it is told.
        what = f"{pair.grasp_object.name} by {pair.gripper.name}"
        raise InputError(f"a trial of {what} failed: {type(error).__name__}: {error}") from error
