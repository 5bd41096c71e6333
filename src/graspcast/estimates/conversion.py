"""Conversion of poses as estimators keep them to BOP results, repaired by transforms of objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.pose_rows import Stated
from graspcast.bop.results import Results, read_results
from graspcast.errors import InputError
from graspcast.estimates.parts import put_together
from graspcast.estimates.selection import known_objects, listed
from graspcast.io.arguments import PATH, a, checked, sequence

__all__ = ["applied", "convert_poses"]


@checked(paths=sequence(PATH), stated=a(Stated), dataset=a(BopDataset))
def convert_poses(
    paths: Sequence[str | PathLike[str]],
    *,
    stated: Stated | None = None,
    transforms: Mapping[int | None, Float[ndarray, "4 4"]] | None = None,
    dataset: BopDataset | None = None,
    lenient: bool = False,
) -> Results:
    """Read the poses of one estimator, whoever wrote them, as BOP results.

    Parameters
    ----------
    paths
        Files, or directories of files, of which no two have the same object in an image.
    stated
        What they do not say themselves: scene, image, objects, unit of length.
    transforms
        Object's number, None for all, to ``obj_T_new``: a pose becomes ``cam_T_obj · obj_T_new``.
    dataset
        The dataset that the poses are of; if given, its models are compared with them.
    lenient
        Skip bad rows and objects without a model, and count them.

    Raises
    ------
    InputError
        Naming file and place; nothing is half converted.
    """
    parts = [read_results(path, lenient=lenient, stated=stated) for path in paths]
    together = put_together("one estimator", parts)
    results = replace(
        applied(together, transforms or {}),
        remarks=tuple(f"{p.source}: {text}" for p in parts for text in p.remarks),
    )
    if not len(results):
        dropped = ", ".join(f"{n} left out ({why})" for why, n in results.dropped.items())
        raise InputError(f"{results.source}: holds no pose{f': {dropped}' if dropped else ''}")
    if dataset is not None:
        results = known_objects(results, dataset, lenient=lenient)
        dataset.models.check_a_mesh()
        dataset.models.check_distances(results.source, results.obj_id, results.cam_T_obj)
    return results


def applied(results: Results, transforms: Mapping[int | None, Float[ndarray, "4 4"]]) -> Results:
    """Apply transforms on the object's side: ``cam_T_obj · obj_T_new``.

    Parameters
    ----------
    results
        The poses.
    transforms
        Object's number to its transform; None for all objects that have none of their own.

    Raises
    ------
    InputError
        For a transform of an object without poses; or one for all, if there are several objects,
        whose frames have nothing to do with each other.
    """
    if not transforms:
        return results
    there = sorted(set(results.obj_id.tolist()))
    if unknown := sorted(n for n in transforms if n is not None and n not in there):
        raise InputError(
            f"there is a transform for object {listed(unknown)}, but {Path(results.source).name} "
            f"has poses of {listed(there)}",
            parameters=("apply",),
        )
    if None in transforms and len(there) > 1:
        raise InputError(
            f"{results.source}: has poses of objects {listed(there)}; say of which the transform "
            "is, NUMBER=TRANSFORM",
            parameters=("apply",),
        )
    poses = results.cam_T_obj.copy()
    for number in there:
        T = transforms.get(number, transforms.get(None))
        rows = results.obj_id == number
        if T is not None:
            poses[rows] = poses[rows] @ T
    if (behind := poses[:, 2, 3] <= 0).any():
        first = int(np.flatnonzero(behind)[0])
        raise InputError(
            f"the transform moves object {results.obj_id[first]} behind the camera, in image "
            f"{results.scene_id[first]}/{results.im_id[first]}; is its translation in millimetres?",
            parameters=("apply",),
        )
    return replace(results, cam_T_obj=poses)
