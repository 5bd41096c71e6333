"""Pictures of cases: the guiding pose on its image, and the trial run again in simulation."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.errors import GraspcastError, InputError, MismatchError
from graspcast.pose.transforms import compose, invert
from graspcast.rendering.coloured_models import ColouredModels
from graspcast.rendering.overlay import draw_overlay
from graspcast.rendering.trials.film import describe, strip_states
from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.report.content import Picture
from graspcast.report.trials import Trials
from graspcast.simulation.campaign.jobs import TrialSetup
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.catalogue import Catalogue, read_catalogue
from graspcast.simulation.objects.load import load_object, with_physics
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.recording import record_trial
from graspcast.simulation.trial.settings import TrialSettings

__all__ = ["Painter"]

_OVERLAY, _WIDTH, _HEIGHT = 340, 260, 312
_QUALITY = 78


@dataclass(eq=False)
class Painter:
    """Draws the pictures of cases.

    Attributes
    ----------
    datasets
        Images and models by dataset.
    trials
        Of the run.
    grippers
        Custom grippers by name.
    catalogue
        Of the objects; the built-in one if None.
    notes
        What could not be drawn, and why, and how often.
    """

    datasets: Mapping[str, BopDataset]
    trials: Sequence[Trials]
    grippers: Mapping[str, Gripper] = field(default_factory=dict)
    catalogue: Catalogue | None = None
    notes: dict[str, int] = field(default_factory=dict)
    _setups: dict[tuple[int, str, str, str], TrialSetup] = field(default_factory=dict)
    _models: dict[str, ColouredModels] = field(default_factory=dict)
    _renderers: dict[tuple[str, str], SceneRenderer] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.catalogue is None:
            self.catalogue = read_catalogue()

    def label(self, name: str) -> str:
        """Return an object's name with what it is called in the catalogue."""
        assert self.catalogue is not None
        label = self.catalogue[name].label if name in self.catalogue else ""
        return f"{name} ({label})" if label and label != name else name

    def overlay(
        self,
        row: Mapping[str, Any],
        cam_T_obj: Float[ndarray, "4 4"],
        obj_T_est: Float[ndarray, "4 4"] | None,
    ) -> tuple[Picture, ...]:
        """Draw the pose that guides a grasp on its image; nothing where that cannot be done.

        Parameters
        ----------
        row
            Of the decisions' table.
        cam_T_obj
            The pose that guides.
        obj_T_est
            Its error; None where that is not known, so that the true pose is not drawn.
        """
        dataset = self.datasets.get(row["dataset"])
        if dataset is None:
            return ()
        image = int(row["scene_id"]), int(row["im_id"])
        true = None if obj_T_est is None else compose(cam_T_obj, invert(obj_T_est))
        try:
            pixels = draw_overlay(
                dataset.image(*image),
                dataset.camera_of(*image).K,
                *self._meshes(row["dataset"])[int(row["obj_id"])],
                cam_T_obj,
                true,
                size=_OVERLAY,
            )
        except GraspcastError as error:
            self._note(f"no picture of the pose: {error}")
            return ()
        solid = "" if true is None else ", the true pose solid"
        alt = f"{self.label(row['object'])} in image {image[0]}/{image[1]}: the pose green{solid}"
        return (_picture("pose that guides (green)", alt, pixels),)

    def strip(
        self, row: Mapping[str, Any], number: int, obj_T_est: Float[ndarray, "4 4"] | None
    ) -> tuple[tuple[Picture, ...], str]:
        """Run a trial again, and draw its moments.

        Returns
        -------
            The pictures, and the outcome in words; nothing where the trial cannot be run again
            as it was.
        """
        if number < 0 or obj_T_est is None or not self.trials[number].manifest:
            return (), ""
        try:
            setup = self._setup(row, number)
            recording = record_trial(
                setup.runner(), obj_T_est, setup.grasp, early_stop=setup.early_stop
            )
            if recording.outcome.reason != row["outcome"]:
                raise MismatchError(
                    f"run again, a trial of {row['object']} ends as {recording.outcome.reason}, "
                    f"not {row['outcome']}"
                )
            renderer = self._renderer(setup)
        except GraspcastError as error:
            self._note(f"no pictures of the trial: {error}")
            return (), ""
        views = dict(zip(map(id, recording.states), renderer.views(recording), strict=True))
        words = describe(recording.outcome)
        name = self.label(row["object"])
        pictures = tuple(
            _picture(
                moment,
                f"{moment}: the {setup.gripper.name} gripper and {name} in simulation, {words}",
                renderer.image(state, views[id(state)], recording.overlay(state)),
            )
            for moment, state in strip_states(recording)
        )
        return pictures, words

    def close(self) -> None:
        """Free the renderers."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def _meshes(self, dataset: str) -> ColouredModels:
        if dataset not in self._models:
            self._models[dataset] = ColouredModels(self.datasets[dataset])
        return self._models[dataset]

    def _note(self, text: str) -> None:
        self.notes[text] = self.notes.get(text, 0) + 1

    def _setup(self, row: Mapping[str, Any], number: int) -> TrialSetup:
        key = (number, row["object"], row["gripper"], row["grasp"])
        if key not in self._setups:
            self._setups[key] = self._load(self.trials[number], *key[1:])
        return self._setups[key]

    def _load(self, trials: Trials, name: str, gripper: str, grasp: str) -> TrialSetup:
        described = _described(trials, name, gripper, grasp)
        bop_dirs: dict[str, Path] = {of: dataset.root for of, dataset in self.datasets.items()}
        target = load_object(name, bop_dirs=bop_dirs, catalogue=self.catalogue)
        hand = self.grippers.get(gripper) or load_gripper(gripper)
        try:
            setup = TrialSetup(
                with_physics(
                    target,
                    mass_kg=float(described["mass_kg"]),
                    friction=float(described["friction"]),
                ),
                hand,
                Grasp(np.array(described["obj_T_grasp"], dtype=np.float64), name, gripper, grasp),
                _settings(described["settings"], str(described.get("protocol", "paper")), hand),
                bool(described["early_stop"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{trials.path}: its manifest does not describe the trials of {name} ({error})"
            ) from error
        stated = trials.manifest["configuration"]
        named = f"{name} by {gripper}"
        digest = stated.get(named) or stated.get(f"{named}, grasp {grasp}")
        if digest != setup.digest:
            raise MismatchError(
                f"{trials.path}: its trials of {named} were run with another mesh, gripper, grasp "
                "or settings than are here"
            )
        return setup

    def _renderer(self, setup: TrialSetup) -> SceneRenderer:
        key = (setup.grasp_object.name, setup.gripper.name)
        if key not in self._renderers:
            self._renderers[key] = SceneRenderer(
                setup.runner().grasp_object, setup.gripper, width=_WIDTH, height=_HEIGHT
            )
        return self._renderers[key]


def _described(trials: Trials, name: str, gripper: str, grasp: str) -> Mapping[str, Any]:
    for entry in trials.manifest.get("setups", ()):
        if (entry.get("object"), entry.get("gripper")) == (name, gripper) and entry.get(
            "grasp", grasp
        ) == grasp:
            return dict(entry)
    raise InputError(f"{trials.path}: its manifest has no trials of {name} by {gripper}, {grasp}")


def _settings(stated: Mapping[str, Any], protocol: str, gripper: Gripper) -> TrialSettings:
    """Return the settings that a manifest states."""
    base = TrialSettings.robot(gripper) if protocol == "robot" else TrialSettings.paper()
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in stated.items()}
    return replace(base, **values)


def _picture(name: str, alt: str, pixels: UInt8[ndarray, "h w 3"]) -> Picture:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="WEBP", quality=_QUALITY, method=4)
    return Picture(name, alt, buffer.getvalue(), pixels.shape[1], pixels.shape[0])
