"""Pose errors: what guides trials of an object without images of it, and where it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.matching import match, nearest_truth
from graspcast.io.arguments import a, checked, mapping, number, whole
from graspcast.pose.covariances import check_deviations
from graspcast.pose.ray_frame import relative
from graspcast.pose.transforms import compose, invert
from graspcast.views.covariance_table import CovarianceTable

__all__ = ["TAILS", "PoseErrors", "sources_of"]

TAILS = 4.0
"""Degrees of freedom of Student's t distribution, of which errors without estimates are drawn."""

_DRAWS = 20_000


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Errors of poses, each seen along a viewing ray, to be applied to objects of any kind.

    Nothing is scaled by the size of an object. A shift was made at a distance, and is applied at
    the same distance; a turn stays what it was, so that it moves the rim of a larger object
    farther.

    Attributes
    ----------
    objects
        ``dataset-number`` of the object on which each error was made, (n,); empty text for an error
        of no object.
    distance_m
        Distance of the estimate from the camera, metres, (n,).
    truth
        The true pose relative to the estimate in the estimate's ray frame:
        :func:`~graspcast.pose.ray_frame.relative`, (n, 6).
    sources
        What made the errors, in words, by name; for manifests and dataset cards.
    """

    objects: ndarray
    distance_m: Float[ndarray, " n"]
    truth: Float[ndarray, "n 6"]
    sources: Mapping[str, str]

    def __len__(self) -> int:
        return len(self.objects)

    def __repr__(self) -> str:
        return f"PoseErrors({len(self)} by {', '.join(self.sources)})"

    @classmethod
    @checked(datasets=mapping(a(BopDataset), "dataset"))
    def of_estimates(
        cls,
        results: Mapping[str, Mapping[str, Results]],
        datasets: Mapping[str, BopDataset],
    ) -> PoseErrors:
        """Take the errors of estimates with a ground truth, one estimator's or several.

        Parameters
        ----------
        results
            Dataset's name to estimator's name to results.
        datasets
            Dataset's name to its BOP directory, with ground truth.

        Raises
        ------
        MismatchError
            If no estimate of a file has a ground truth.
        """
        names, distances, truths = [], [], []
        for dataset, tables in results.items():
            if dataset not in datasets:
                raise MismatchError(
                    f"the estimates of {dataset} have no ground truth, so their errors are not "
                    "known; give the dataset's BOP directory",
                    parameters=("bop",),
                )
            truth = datasets[dataset].ground_truth
            for table in tables.values():
                matched = match(table, truth)
                rows = np.flatnonzero(matched >= 0)
                poses = table.cam_T_obj[rows]
                distance = np.linalg.norm(poses[:, :3, 3], axis=1)
                # A distance of zero has no viewing ray; it is a placeholder for 'nothing found'.
                rows, poses, distance = (part[distance > 0] for part in (rows, poses, distance))
                names.append([f"{dataset}-{number}" for number in table.obj_id[rows].tolist()])
                distances.append(distance)
                near = nearest_truth(
                    compose(invert(poses), truth.cam_T_obj[matched[rows]]),
                    np.full(len(rows), dataset),
                    table.obj_id[rows],
                    {dataset: datasets[dataset].models},
                )
                truths.append(relative(poses, compose(poses, near)))
        if not names:
            raise InputError("there are no estimates", parameters=("estimates",))
        return cls(
            np.concatenate(names),
            np.concatenate(distances),
            np.concatenate(truths),
            sources_of(results),
        )

    @classmethod
    @checked(
        across_m=number(),
        along_m=number(),
        rotation_rad=number(),
        tails=number(),
        seed=whole(0),
    )
    def of_deviations(
        cls,
        across_m: float,
        along_m: float,
        rotation_rad: float,
        *,
        tails: float = TAILS,
        seed: int = 0,
    ) -> PoseErrors:
        """Draw errors with standard deviations across and along the viewing ray.

        Parameters
        ----------
        across_m, along_m
            Standard deviations of the position across (per axis) and along the viewing ray, metres.
        rotation_rad
            Standard deviation of the rotation, radians per axis.
        tails
            Degrees of freedom of a multivariate Student's t distribution, above 2: the fewer, the
            more gross errors at the same standard deviations; infinity for a normal distribution.
        seed
            Random seed.

        Raises
        ------
        InputError
            If a number is out of range.
        """
        check_deviations(across_m, along_m, rotation_rad)
        deviation = np.array([across_m, across_m, along_m, *(3 * [rotation_rad])])
        told = (
            f"standard deviations of {1e3 * across_m:.3g} mm across and {1e3 * along_m:.3g} mm "
            f"along the viewing ray, and {np.rad2deg(rotation_rad):.3g} degrees"
        )
        truth = _drawn(tails, seed) * deviation
        return cls._of_no_object(truth, f"{_distribution(tails)}, {told}")

    @classmethod
    def of_covariances(
        cls, table: CovarianceTable, *, tails: float = TAILS, seed: int = 0
    ) -> PoseErrors:
        """Draw errors from the covariances of fused poses, a random one for each error.

        On another object the axes of these objects have no meaning, so that each error is seen from
        a random side: its size and the relation of shift and turn are kept.

        Parameters
        ----------
        table
            The covariances.
        tails, seed
            As for :meth:`of_deviations`.
        """
        rows = np.random.default_rng([seed, 1]).integers(len(table), size=_DRAWS)
        roots = np.linalg.cholesky(table.covariance)[rows]
        truth = np.einsum("nij,nj->ni", roots, _drawn(tails, seed))
        told = f"{len(table)} covariances of {table.source}"
        return cls._of_no_object(truth, f"{_distribution(tails)}, {told}")

    @classmethod
    def _of_no_object(cls, truth: Float[ndarray, "n 6"], told: str) -> PoseErrors:
        # At a distance of 1 m, so that shifts over the distance are metres.
        return cls(np.full(len(truth), ""), np.ones(len(truth)), truth, {"drawn errors": told})


def sources_of(results: Mapping[str, Mapping[str, Results]]) -> dict[str, str]:
    """Return the files of estimates, by estimator and dataset in words."""
    return {
        f"{estimator} on {dataset}": table.source
        for dataset, tables in results.items()
        for estimator, table in tables.items()
    }


def _drawn(tails: float, seed: int) -> Float[ndarray, "n 6"]:
    """Draw six numbers of standard deviation 1 each, with one factor of Student's t in common."""
    if not tails > 2:
        raise InputError(
            f"{tails:g} degrees of freedom of Student's t distribution have no standard deviation; "
            "give more than 2",
            parameters=("tails",),
        )
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal((_DRAWS, 6))
    if np.isinf(tails):
        return normal
    spread = np.sqrt((tails - 2) / rng.chisquare(tails, _DRAWS))
    return np.asarray(normal * spread[:, None])


def _distribution(tails: float) -> str:
    return "normal" if np.isinf(tails) else f"Student's t with {tails:g} degrees of freedom"
