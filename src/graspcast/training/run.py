"""Training of built-in estimators from a directory of models to ONNX files; it can be resumed."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from graspcast.bop.dataset import BopDataset
from graspcast.errors import MismatchError
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.extras import require
from graspcast.io.files import atomic_write, check_target, temporary_directory, write_text
from graspcast.io.locks import exclusive_lock
from graspcast.io.progress import Progress
from graspcast.perception.network import Network
from graspcast.training.card import card
from graspcast.training.objects import Objects
from graspcast.training.pytorch import choose_device
from graspcast.training.samples import VIEWS, Samples, render_samples
from graspcast.training.settings import TrainingSettings
from graspcast.training.validation import measure_errors, validation_images

__all__ = ["Trained", "train_estimators"]

_BEGUN = "training.json"
_FREE = ("estimators", "steps", "device", "threads")
"""Settings that may be others when training goes on."""

Stages = Callable[[str], AbstractContextManager[Progress]]
"""Opens the progress callback of a stage of the work, by the stage's name."""


@dataclass(frozen=True)
class Trained:
    """Trained weights.

    Attributes
    ----------
    estimator
        The estimator.
    path
        Its ONNX file; the model card lies beside it, with the ending ``.md``.
    steps
        Number of steps that it was trained for.
    errors
        Validation errors, as of :func:`graspcast.training.validation.measure_errors`.
    """

    estimator: str
    path: Path
    steps: int
    errors: list[dict[str, Any]]


def train_estimators(
    objects: Objects,
    work: str | PathLike[str],
    out: str | PathLike[str],
    settings: TrainingSettings | None = None,
    *,
    stages: Stages,
) -> list[Trained]:
    """Render, train, validate and write estimators; what ``work`` has of it already is kept.

    The same call resumes work that was interrupted, even by a kill: of rendering it loses the file
    of samples in hand (80 images), of training at most a minute. Weights are written to ``out`` at
    the end alone, each file atomically.

    Parameters
    ----------
    objects
        The objects.
    work
        Directory of training samples, checkpoints and validation images.
    out
        Directory of the ONNX files and model cards.
    settings
        Which estimators, how many images and steps, seed and device.
    stages
        Opens a progress callback for each stage.

    Raises
    ------
    ExtraMissingError
        If PyTorch or another package is not installed.
    InputError
        If another process works in ``work``, OpenGL does not work, or a file cannot be written.
    MismatchError
        If ``work`` was begun with other objects or settings.
    """
    settings = settings or TrainingSettings()
    require("train")
    device = choose_device(settings.device)
    work, out = Path(work), Path(out)
    busy = f"{work}: another process trains here; wait for it, or choose another directory"
    for name in settings.estimators:
        check_target(out / f"{name}.onnx")
    with exclusive_lock(work / ".lock", busy):
        _begin(work, objects, settings)
        samples = work / "samples"
        with stages("rendering training images") as progress:
            render_samples(
                samples, objects, seed=settings.seed, images=settings.images, progress=progress
            )
        dataset = _validation(work, objects, settings, stages)
        _fit(work, objects, settings, device, stages)
        return [
            _finish(name, work, out, objects, settings, dataset, stages)
            for name in settings.estimators
        ]


def _begin(work: Path, objects: Objects, settings: TrainingSettings) -> None:
    """Compare objects and settings with those of the work that a directory holds, or note them."""
    fixed = {k: v for k, v in asdict(settings).items() if k not in _FREE}
    mine = {"dataset": objects.dataset, "objects": list(objects.ids), **fixed}
    mine |= {"models": objects.digest}
    path = work / _BEGUN
    if not path.exists():
        write_artefact(path, mine)
        return
    there = read_artefact(path, "choose another directory", parameters=("work",))
    others = [key for key in mine if mine[key] != there.get(key)]
    if others:
        said = (
            "other meshes or sizes of the models"
            if key == "models"
            else f"{key.replace('_', ' ')} {there.get(key)} (now {mine[key]})"
            for key in others
        )
        raise MismatchError(
            f"{work}: was begun with {', '.join(said)}; go on with that, or choose another "
            "directory",
            parameters=("work", *(key for key in others if key in fixed)),
        )


def _validation(
    work: Path, objects: Objects, settings: TrainingSettings, stages: Stages
) -> BopDataset:
    with stages("rendering validation images") as progress:
        return validation_images(
            work / "validation",
            objects,
            images=settings.validation_images,
            seed=settings.seed,
            progress=progress,
        )


def _fit(
    work: Path, objects: Objects, settings: TrainingSettings, device: str, stages: Stages
) -> None:
    # Late: PyTorch takes a second or two to import.
    from graspcast.training.checkpoint import Checkpoint
    from graspcast.training.fitting import fit

    checkpoints = [
        Checkpoint(name, objects, work, seed=settings.seed, device=device)
        for name in settings.estimators
    ]
    if all(one.step >= settings.steps for one in checkpoints):
        return
    with stages(f"training on the {'GPU' if device == 'cuda' else 'CPU'}") as progress:
        samples = Samples(work / "samples")
        fit(checkpoints, samples, objects, settings, device=device, progress=progress)


def _finish(
    name: str,
    work: Path,
    out: Path,
    objects: Objects,
    settings: TrainingSettings,
    dataset: BopDataset,
    stages: Stages,
) -> Trained:
    """Export and validate one network, and write weights and card."""
    from graspcast.training.checkpoint import Checkpoint
    from graspcast.training.onnx_file import add_metadata, export

    checkpoint = Checkpoint(name, objects, work, seed=settings.seed)
    images = replace(settings, images=VIEWS * math.ceil(settings.images / VIEWS))
    with stages(f"validating {name}") as progress, temporary_directory(work) as scratch:
        bare, whole = scratch / f"{name}.onnx", scratch / "whole.onnx"
        export(checkpoint, objects, images, bare)
        boxes = dataset.root / "test_detections_jittered.json"
        errors = measure_errors(name, bare, dataset, boxes, progress=progress)
        count = len(dataset.images)
        about = f"{count} rendered images that were not trained on, with jittered true boxes"
        add_metadata(bare, {"validation": {"images": about, "errors": errors}}, whole)
        path = out / f"{name}.onnx"
        with atomic_write(path) as temporary:
            temporary.write_bytes(whole.read_bytes())
        write_text(path.with_suffix(".md"), card(Network(name, path), name))
    return Trained(name, path, checkpoint.step, errors)
