"""How accurate fused poses are, by the number of views and the noise of the camera motion.

    python benchmarks/fusion.py --estimates epos=epos_ycbv-test.csv ... --bop ycbv \
        --ground-truth ycbv/ground_truth --camera-poses ycbv/camera_motion

With --motion-from truth the motion is taken from annotated poses of other objects (LM-O), with
--motion-from estimates from their estimates.

Translation and rotation errors against ground truth (median and 90th percentile), of the instances
of the principal that have all the views. Ground truth is used for the errors alone; with --learn it
is also used for the spreads, of the scenes of the other half.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results, read_results
from graspcast.estimates.alignment import align
from graspcast.estimates.matching import match, true_poses
from graspcast.io.markdown import table
from graspcast.pose.metrics import nearest_symmetric
from graspcast.pose.transforms import compose, invert, rotation_angle, rotation_from_vector
from graspcast.views.camera_motion import CameraMotion, CameraNoise
from graspcast.views.camera_tables import read_camera_motion
from graspcast.views.fused_estimates import FusedEstimates, fuse_estimates
from graspcast.views.motion import Motion
from graspcast.views.object_motion import ObjectMotion
from graspcast.views.spread import Spreads, learn_spreads

HEADER = ["poses", "n", "median mm", "90 % mm", "median deg", "90 % deg", "chi2 position / 3"]


class Measured:
    """Errors of poses against ground truth, the nearest symmetric one."""

    def __init__(self, dataset: BopDataset):
        self.dataset, self.truth = dataset, dataset.ground_truth

    def nearest(self, results: Results) -> ndarray:
        """Return the true pose of each row, NaN where there is none."""
        row = match(results, self.truth)
        out = np.where((row >= 0)[:, None, None], self.truth.cam_T_obj[row], np.nan)
        for obj_id in np.unique(results.obj_id).tolist():
            mine = np.flatnonzero((results.obj_id == obj_id) & (row >= 0))
            pose = results.cam_T_obj[mine]
            to = compose(invert(pose), out[mine])
            out[mine] = compose(pose, nearest_symmetric(to, self.dataset.models[obj_id].symmetries))
        return out

    def row(self, name: str, results: Results, fused: FusedEstimates | None = None) -> list[str]:
        true = self.nearest(results)
        known = np.isfinite(true[:, 0, 0])
        offset = (true[:, :3, 3] - results.cam_T_obj[:, :3, 3])[known]
        turn = true[known][:, :3, :3] @ np.swapaxes(results.cam_T_obj[known][:, :3, :3], 1, 2)
        mm, deg = np.linalg.norm(offset, axis=1) * 1e3, np.rad2deg(rotation_angle(turn))
        cells = [name, str(len(mm)), *(f"{np.percentile(mm, q):.1f}" for q in (50, 90))]
        cells += [f"{np.percentile(deg, q):.1f}" for q in (50, 90)]
        if fused is None:
            return [*cells, ""]
        inverse = np.linalg.inv(fused.poses.covariance[known][:, :3, :3])
        chi = np.einsum("ni,nij,nj->n", offset, inverse, offset)
        return [*cells, f"{np.median(chi) / 2.366:.2f}"]  # the median of chi2 with 3 degrees


def noisy(motion: CameraMotion, noise: CameraNoise, seed: int = 0) -> CameraMotion:
    """Displace every camera pose at random; half the variance, since two make a motion."""
    rng = np.random.default_rng(seed)
    out = {}
    for key, pose in motion.world_T_cam.items():
        by = np.eye(4)
        by[:3, :3] = rotation_from_vector(rng.normal(0, noise.rotation_rad / np.sqrt(2), 3))
        by[:3, 3] = rng.normal(0, noise.translation_m / np.sqrt(2), 3)
        out[key] = pose @ by
    return replace(motion, world_T_cam=out)


def selected(fused: FusedEstimates, rows: ndarray) -> FusedEstimates:
    names = ("cam_T_obj", "covariance", "used", "dropped", "parallax_rad", "cam_T_est")
    poses = replace(fused.poses, **{name: getattr(fused.poses, name)[rows] for name in names})
    return replace(fused, instances=fused.instances.select(rows), poses=poses)


def learned(results: dict[str, Results], dataset: BopDataset, principal: str) -> Spreads:
    """Learn spreads on the scenes with an odd number."""
    odd = {name: t.select(t.scene_id % 2 == 1) for name, t in results.items()}
    estimates = align(odd, dataset=dataset.name, anchor=principal)
    truth = true_poses(estimates, principal, {dataset.name: dataset})
    return learn_spreads(estimates, truth, models={dataset.name: dataset.models})


def motion_from(
    options: argparse.Namespace, dataset: BopDataset, results: dict[str, Results]
) -> Motion:
    """Camera poses, or the motion of other objects: annotated, or estimated."""
    if options.motion_from == "truth":
        return ObjectMotion.from_ground_truth(dataset.ground_truth, dataset.models)
    if options.motion_from == "estimates":
        models = {dataset.name: dataset.models}
        return ObjectMotion.from_estimates(results, dataset=dataset.name, models=models)
    if options.camera_poses is None:
        raise SystemExit("--camera-poses is needed")
    return read_camera_motion(options.camera_poses)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--estimates", action="append", required=True, metavar="NAME=FILE")
    parser.add_argument("--bop", type=Path, required=True)
    parser.add_argument("--ground-truth", type=Path)
    parser.add_argument("--camera-poses", type=Path, help="with --motion-from cameras")
    parser.add_argument("--motion-from", choices=("cameras", "truth", "estimates"))
    parser.add_argument("--principal")
    parser.add_argument("--views", type=int, nargs="+", default=[1, 2, 3, 5])
    parser.add_argument("--noise-mm", type=float, nargs="*", default=[1, 3, 5])
    parser.add_argument("--views-from", choices=("earlier", "all"), default="all")
    parser.add_argument("--learn", action="store_true")
    options = parser.parse_args(arguments)
    dataset = BopDataset(options.bop, ground_truth=options.ground_truth)
    results = {n: read_results(p) for n, _, p in (e.partition("=") for e in options.estimates)}
    known = list(dataset.models.info)  # without a model no symmetries are known
    results = {n: t.select(np.isin(t.obj_id, known)) for n, t in results.items()}
    motion = motion_from(options, dataset, results)
    principal = options.principal or next(iter(results))
    spreads = learned(results, dataset, principal) if options.learn else Spreads()
    if options.learn:
        print(spreads.by_estimator)
        results = {name: t.select(t.scene_id % 2 == 0) for name, t in results.items()}
    measured = Measured(dataset)

    def fused(
        given: dict[str, Results],
        views: int,
        mm: float | None = None,
        told: bool = True,
        spreads: Spreads = spreads,
    ) -> FusedEstimates:
        noise = CameraNoise((mm or 0) / 1e3, np.deg2rad(0.1 * (mm or 0)))
        return fuse_estimates(
            given,
            noisy(motion, noise) if mm is not None and isinstance(motion, CameraMotion) else motion,
            dataset=dataset.name,
            principal=next(iter(given)) if len(given) == 1 else principal,
            models={dataset.name: dataset.models},
            views_from=options.views_from,
            max_views=views,
            noise=noise if told else None,
            spreads=spreads,
        )

    if not isinstance(motion, CameraMotion):
        options.noise_mm = []
    rows = [measured.row(name, table) for name, table in results.items()]
    for views in options.views:
        start = process_time()
        out = fused(results, views)
        took = process_time() - start
        each = took / len(out.instances) * 1e3
        print(f"{views} views: {took:.1f} s of processor time, {each:.1f} ms an instance")
        print("; ".join(out.summary()))
        rows.append(measured.row(f"all, up to {views} views", out.results, out))
        if views > 1:
            full = selected(out, out.gathered.present.any(axis=2).sum(axis=1) == views)
            rows.append(measured.row(f"all, {views} views", full.results, full))
    if options.learn:
        out = fused(results, 3, spreads=Spreads())
        rows.append(measured.row("all, up to 3 views, default spreads", out.results, out))
    for name, given in results.items():
        alone = fused({name: given}, 3)
        rows.append(measured.row(f"{name}, up to 3 views", alone.results, alone))
    for mm in options.noise_mm:
        for told in (True, False):
            out = fused(results, 3, mm, told)
            says = f"up to 3 views, motion known to {mm:g} mm, {0.1 * mm:.1f} deg"
            rows.append(measured.row(says + ("" if told else ", not told"), out.results, out))
    print(table(HEADER, rows))


if __name__ == "__main__":
    main()
