"""Jobs of a campaign: trial setups, and batches of trials that a worker runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.io.arguments import a, checked
from graspcast.io.hashing import sha256
from graspcast.simulation.campaign.requests import SetupKey, TrialRequests
from graspcast.simulation.grasps.table import GraspTable
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.catalogue import Catalogue, read_catalogue
from graspcast.simulation.objects.load import BopDirectories, load_object, why_no_mesh
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.early_stopping import RULES
from graspcast.simulation.trial.trial import Outcome, TrialRunner, TrialSettings, trial_digest

__all__ = ["Batch", "TrialSetup", "available_trials", "load_setups", "run_batch"]

_runners: dict[str, TrialRunner] = {}


@dataclass(frozen=True, eq=False)
class TrialSetup:
    """Everything that the trials of one grasp of an object by a gripper have in common.

    Attributes
    ----------
    grasp_object
        The object.
    gripper
        The gripper.
    grasp
        The grasp.
    settings
        How the trials are run.
    early_stop
        Whether a trial stops as soon as its outcome can no longer change.
    """

    grasp_object: GraspObject
    gripper: Gripper
    grasp: Grasp
    settings: TrialSettings
    early_stop: bool = True

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything besides the estimate that an outcome depends on, as hex.

        Raises
        ------
        MismatchError
            If the object does not stay in its reference pose.
        """
        grasp = np.asarray(self.grasp.obj_T_grasp, dtype="<f8")
        rules = f"early {RULES}" if self.early_stop else "full"
        return sha256(self.runner().digest, grasp, rules)

    def runner(self) -> TrialRunner:
        """Return the runner for these trials, which this process compiles once for all grasps."""
        if self._runner_digest not in _runners:
            new = TrialRunner(self.grasp_object, self.gripper, self.settings)
            _runners[self._runner_digest] = new
        return _runners[self._runner_digest]

    @cached_property
    def _runner_digest(self) -> str:
        return trial_digest(self.grasp_object, self.gripper, self.settings)


@dataclass(frozen=True, eq=False)
class Batch:
    """Trials of one setup, for one worker.

    Attributes
    ----------
    setup
        Names of object, gripper and grasp: the key of the trial setup.
    rows
        Row numbers of the trials in the requests.
    obj_T_est
        Estimates in the true object's frame, metres.
    """

    setup: SetupKey
    rows: Int[ndarray, " n"]
    obj_T_est: Float[ndarray, "n 4 4"]


@checked(requests=a(TrialRequests), grasps=a(GraspTable))
def load_setups(
    requests: TrialRequests,
    grasps: GraspTable,
    *,
    settings: TrialSettings | Mapping[str, TrialSettings] | None = None,
    bop_dirs: BopDirectories | None = None,
    catalogue: Catalogue | None = None,
    grippers: Mapping[str, Gripper] | None = None,
) -> dict[SetupKey, TrialSetup]:
    """Load the trial setups of all requests: objects, grippers and grasps.

    Parameters
    ----------
    requests
        The trials.
    grasps
        The grasps.
    settings
        How the trials are run, for all grippers or by gripper's name; the robot's protocol with
        the limits of each gripper if None.
    bop_dirs, catalogue
        As for :func:`~graspcast.simulation.objects.load.load_object`.
    grippers
        Custom grippers by name; other names are those of built-in grippers.

    Returns
    -------
        Trial setups by (object, gripper, grasp).

    Raises
    ------
    UnknownNameError
        If an object or gripper is unknown, or there is no such grasp.
    InputError
        If an object cannot be loaded.
    """
    references = {key: grasps(*key) for key in requests.setups()}
    objects = {
        name: load_object(name, bop_dirs=bop_dirs, catalogue=catalogue)
        for name in dict.fromkeys(name for name, _, _ in references)
    }
    custom = grippers or {}
    hands = {g: custom[g] if g in custom else load_gripper(g) for _, g, _ in references}
    if settings is None:
        settings = {name: TrialSettings.robot(hand) for name, hand in hands.items()}
    return {
        (name, gripper, grasp): TrialSetup(
            grasp_object=reference.applied_to(objects[name]),
            gripper=hands[gripper],
            grasp=reference.grasp,
            settings=settings[gripper] if isinstance(settings, Mapping) else settings,
        )
        for (name, gripper, grasp), reference in references.items()
    }


def available_trials(
    requests: TrialRequests,
    notes: list[str],
    *,
    bop_dirs: BopDirectories | None = None,
    catalogue: Catalogue | None = None,
) -> TrialRequests:
    """Leave out the trials of objects that are in no catalogue or without a mesh.

    Parameters
    ----------
    requests
        The trials.
    notes
        A message on each such object, with the number of its trials, is appended to it.
    bop_dirs, catalogue
        As for :func:`~graspcast.simulation.objects.load.load_object`.

    Raises
    ------
    MismatchError
        If no trial is left; the message says why.
    """
    catalogue = read_catalogue() if catalogue is None else catalogue
    why: dict[str, str] = {}
    for name in dict.fromkeys(name for name, _, _ in requests.setups()):
        known = name in catalogue
        reason = why_no_mesh(catalogue[name], bop_dirs) if known else "it is not in the catalogue"
        if reason:
            why[name] = reason
    if not why:
        return requests
    names = requests.keys["object"]
    if len(why) == names.n_unique():
        reasons = "; ".join(f"{name}: {reason}" for name, reason in why.items())
        raise MismatchError(
            f"no object can be simulated: {reasons}", parameters=("catalogue", "bop")
        )
    for name, reason in why.items():
        notes.append(f"left out {int((names == name).sum())} trials of {name}: {reason}")
    return requests.select(np.flatnonzero(~names.is_in(list(why)).to_numpy()))


def run_batch(setup: TrialSetup, batch: Batch) -> list[Outcome]:
    """Run the trials of a batch; the process keeps the compiled model for the next batch.

    Raises
    ------
    InputError
        If a trial fails for any reason; the message names object and gripper.
    """
    try:
        runner = setup.runner()
        return [runner.run(e, setup.grasp, early_stop=setup.early_stop) for e in batch.obj_T_est]
    except Exception as error:
        # Pickling loses the cause of an error, so the message contains it.
        what = f"{' by '.join(batch.setup[:2])}, grasp {setup.grasp.name}"
        raise InputError(f"a trial of {what} failed: {type(error).__name__}: {error}") from error
