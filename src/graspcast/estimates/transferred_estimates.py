"""Transferred estimates: what estimators found of other objects, as if it were another object.

An object of which there is no image yet has no estimates either. Those of other objects are
transferred to it, all estimators' of an instance together, so that they disagree as they did there:
position, distance and errors stay, and the object is seen from a random side. What they say of the
new object holds as far as the estimators err on it as on the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.results import Results, write_results
from graspcast.bop.units import millimetres
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import split_object_name
from graspcast.estimates.loading import Inputs
from graspcast.estimates.matching import nearest_truth
from graspcast.io.json import write_json
from graspcast.pose.transforms import compose, invert, rotation_from_quaternion, transform

__all__ = ["TransferredEstimates", "transfer_estimates"]


@dataclass(frozen=True, eq=False)
class TransferredEstimates:
    """Estimates of objects without images, made from those of other objects.

    Attributes
    ----------
    inputs
        The estimates, image by image in scene 0 of each object's dataset.
    truth
        By dataset and object, the true poses ``cam_T_obj`` in the images 0, 1, …, (n, 4, 4).
    """

    inputs: Inputs
    truth: dict[tuple[str, int], Float[ndarray, "n 4 4"]]

    def write(self, directory: str | PathLike[str]) -> list[Path]:
        """Write a results CSV for each estimator, and ground truth as ``DATASET/000000``.

        Returns
        -------
        The results files.

        Raises
        ------
        InputError
            If a file cannot be written.
        """
        directory = Path(directory)
        written = []
        for dataset, tables in self.inputs.results.items():
            for estimator, table in tables.items():
                written.append(directory / f"{estimator}_{dataset}-test.csv")
                write_results(written[-1], table)
            mine = {number: poses for (of, number), poses in self.truth.items() if of == dataset}
            write_json(directory / dataset / "000000" / "scene_gt.json", _ground_truth(mine))
        return written


def transfer_estimates(
    inputs: Inputs, principal: str, objects: Sequence[str], *, count: int, seed: int = 0
) -> TransferredEstimates:
    """Transfer the estimates of other objects to objects without images.

    Parameters
    ----------
    inputs
        Estimates of other objects; its datasets hold the models of all objects, and the ground
        truth of those with estimates.
    principal
        The estimator whose instances are transferred, with what the others say of them.
    objects
        The objects, ``dataset-number``.
    count
        Instances of each object, each of another instance where there are enough.
    seed
        Random seed of the instances and sides.

    Raises
    ------
    InputError
        If ``count`` is below 1, or there is no object.
    MismatchError
        If there is no estimate of another object.
    UnknownNameError
        If an object has no model.
    """
    if count < 1:
        raise InputError(f"count is {count}; give at least 1", parameters=("transferred_errors",))
    if not objects:
        raise InputError(
            "name the objects to which errors are transferred", parameters=("objects",)
        )
    estimates = inputs.estimates(principal)
    poses, truth = _without_symmetries(estimates, inputs.truth(estimates, principal), inputs)
    parts: dict[str, list[_Part]] = {}
    for name in dict.fromkeys(objects):
        dataset, number = split_object_name(name)
        if dataset not in inputs.datasets:
            raise MismatchError(
                f"there are no models of {dataset}: give the directory that add-object wrote, or "
                "the BOP dataset",
                parameters=("bop",),
            )
        inputs.datasets[dataset].models[number]  # raises for an unknown one
        known = np.isfinite(truth).all(axis=(1, 2)) & (estimates.objects != name)
        if not known.any():
            raise MismatchError(
                f"no estimates to transfer to {name}: there are none of other objects with a "
                "ground truth",
                parameters=("estimates",),
            )
        random = np.random.default_rng([seed, *f"{name} estimates".encode()])
        donors = np.flatnonzero(known)
        rows = random.choice(donors, count, replace=count > len(donors))
        turns = random.standard_normal((count, 4))
        turns /= np.linalg.norm(turns, axis=1, keepdims=True)
        side = transform(rotation_from_quaternion(turns), np.zeros((count, 3)))
        # Another frame of the object, the same for estimates and truth, leaves errors as they are.
        moved = compose(poses[:, rows], side[None]), compose(truth[rows], side)
        parts.setdefault(dataset, []).append(_Part(number, *moved, _scores(estimates)[:, rows]))
    results = {
        dataset: {
            estimator: _results(estimator, k, mine)
            for k, estimator in enumerate(estimates.estimators)
        }
        for dataset, mine in parts.items()
    }
    return TransferredEstimates(
        replace(inputs, results=results, image_fit=None),
        {(dataset, part.number): part.truth for dataset, mine in parts.items() for part in mine},
    )


@dataclass(frozen=True, eq=False)
class _Part:
    """The transferred estimates of one object."""

    number: int
    poses: Float[ndarray, "k n 4 4"]
    truth: Float[ndarray, "n 4 4"]
    score: Float[ndarray, "k n"]


def _scores(estimates: Estimates) -> Float[ndarray, "k n"]:
    score = estimates.seen.get("score")
    return np.ones(estimates.cam_T_obj.shape[:2]) if score is None else np.nan_to_num(score)


def _without_symmetries(
    estimates: Estimates, truth: Float[ndarray, "n 4 4"], inputs: Inputs
) -> tuple[Float[ndarray, "k n 4 4"], Float[ndarray, "n 4 4"]]:
    """Return poses and truth in the symmetric equivalent that is nearest to the first estimator's.

    A turn by a symmetry is no disagreement, but would be one of an object without it.
    """
    first = estimates.cam_T_obj[0]
    back = invert(first)

    def near(poses: Float[ndarray, "n 4 4"]) -> Float[ndarray, "n 4 4"]:
        relative = compose(back, poses)
        given = estimates.dataset, estimates.obj_id, inputs.models
        return compose(first, nearest_truth(relative, *given))

    return np.stack([first, *(near(poses) for poses in estimates.cam_T_obj[1:])]), near(truth)


def _results(estimator: str, k: int, parts: Sequence[_Part]) -> Results:
    """Return an estimator's table of a dataset; images are numbered from 0 for each object."""
    images: Int[ndarray, " n"] = np.concatenate([np.arange(len(part.truth)) for part in parts])
    n = len(images)
    return Results(
        scene_id=np.zeros(n, dtype=np.int64),
        im_id=images,
        obj_id=np.concatenate([np.full(len(part.truth), part.number) for part in parts]),
        score=np.concatenate([part.score[k] for part in parts]),
        cam_T_obj=np.concatenate([part.poses[k] for part in parts]),
        time_s=np.full(n, -1.0),
        line=np.zeros(n, dtype=np.int64),
        source=f"transferred estimates by {estimator}",
    )


def _ground_truth(truth: dict[int, Float[ndarray, "n 4 4"]]) -> dict[str, list[dict[str, object]]]:
    """Return BOP's ``scene_gt.json``: every object in its images."""
    images = range(max(len(poses) for poses in truth.values()))
    return {
        str(image): [
            {
                "cam_R_m2c": poses[image, :3, :3].ravel().tolist(),
                "cam_t_m2c": millimetres(poses[image, :3, 3]).tolist(),
                "obj_id": number,
            }
            for number, poses in truth.items()
            if image < len(poses)
        ]
        for image in images
    }
