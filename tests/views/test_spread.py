"""Spreads of estimators, learned from known poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr

from graspcast.bop.models import Models
from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.pose.ray_frame import displaced, relative
from graspcast.views.spread import DEFAULT_SPREAD, Spread, Spreads, learn_spreads
from poses import random_poses, write_models
from static_scenes import scattered

N = 2000


def estimates(poses: np.ndarray) -> Estimates:
    keys = [InstanceKey("d", 1, i, 1 + i % 2, 0) for i in range(poses.shape[1])]
    return Estimates(("a", "b")[: len(poses)], Instances.of(keys), poses)


def test_spreads_of_known_size_are_found() -> None:
    true = random_poses(N)
    poses = np.stack(
        [scattered(true, 1, (0.002, 0.010, 0.05)), scattered(true, 2, (0.004, 0.015, 0.1))]
    )
    poses[0, :200, :3, 3] *= 1.4  # gross errors do not enter
    found = learn_spreads(estimates(poses), true)
    a, b = found.of("a", "d-1"), found.of("b", "d-2")
    assert (a.across, a.along, a.rotation_rad) == pytest.approx((0.002, 0.010, 0.05), rel=0.2)
    assert (b.across, b.along, b.rotation_rad) == pytest.approx((0.004, 0.015, 0.1), rel=0.2)
    assert a.shared < 0.1


def test_the_shared_part_is_found() -> None:
    true = random_poses(N)
    rng = np.random.default_rng(0)
    size = np.array([0.003, 0.003, 0.012, 0.07, 0.07, 0.07])
    common, own = rng.normal(size=(1, N, 6)), rng.normal(size=(2, N, 6))
    poses = displaced(true, (np.sqrt(0.7) * common + np.sqrt(0.3) * own) * size)
    assert learn_spreads(estimates(poses), true).of("a", "d-1").shared == pytest.approx(
        0.7, abs=0.07
    )


def test_unknown_estimators_have_the_default_and_rare_objects_their_estimators() -> None:
    true = random_poses(N)
    given = estimates(scattered(true, 1)[None])
    found = learn_spreads(given, true, least=N)
    assert found.of("other", "d-1") == DEFAULT_SPREAD
    assert not found.by_object
    assert found.of("a", "d-1") == found.by_estimator["a"]
    table = Spreads().table(("a", "b"), np.array(["d-1", "d-2", "d-1"]))
    assert table.shape == (3, 2, 4) and (table == table[0, 0]).all()


def test_too_few_known_poses_and_wrong_spreads_are_refused() -> None:
    true = random_poses(40)
    true[20:] = np.nan
    with pytest.raises(InputError, match="at least 30 instances with known poses, but 20 of 40"):
        learn_spreads(estimates(random_poses(40)[None]), true)
    for sizes in ((0.0, 0.1, 0.1, 0.5), (0.1, 0.1, float("nan"), 0.5), (0.1, 0.1, 0.1, 2.0)):
        with pytest.raises(InputError, match="should be positive"):
            Spread(*sizes)


def medians(true: np.ndarray, poses: np.ndarray) -> tuple[float, float, float]:
    """Across, along and rotation, from the medians of normal errors."""
    errors = relative(true, poses)
    across = np.median(np.abs(errors[:, :2])) * 1.4826
    along = np.median(np.abs(errors[:, 2])) * 1.4826
    turn = np.median(np.linalg.norm(errors[:, 3:], axis=1)) / 1.5382
    return float(across), float(along), float(turn)


def test_spreads_are_medians_of_each_object() -> None:
    true = random_poses(100)
    sizes = np.where(np.arange(100) % 2 == 0, 1.0, 3.0)[:, None]  # object d-2 is worse
    rng = np.random.default_rng(0)
    errors = rng.normal(size=(2, 100, 6)) * sizes * [0.003, 0.003, 0.012, 0.05, 0.05, 0.05]
    poses = displaced(true, errors)
    found = learn_spreads(estimates(poses), true)
    assert set(found.by_object) == {("a", "d-1"), ("a", "d-2"), ("b", "d-1"), ("b", "d-2")}
    for k, name in enumerate("ab"):
        for rows, spread in (
            (slice(None), found.by_estimator[name]),
            (slice(0, None, 2), found.of(name, "d-1")),
            (slice(1, None, 2), found.of(name, "d-2")),
        ):
            wanted = medians(true[rows], poses[k, rows])
            assert (spread.across, spread.along, spread.rotation_rad) == pytest.approx(wanted)
    shared = spearmanr(*(relative(true, p)[:, 2] for p in poses)).statistic
    assert found.of("a", "d-1").shared == pytest.approx(max(shared, 0.0))


def test_estimates_that_are_nearly_true_have_a_least_spread() -> None:
    true = random_poses(60)
    found = learn_spreads(estimates(np.stack([true, true])), true)
    for name in "ab":
        spread = found.of(name, "d-1")
        assert (spread.across, spread.along, spread.rotation_rad) == (2e-4, 2e-4, 2e-3)
    assert 0.0 <= found.of("a", "d-1").shared <= 0.95
    alone = learn_spreads(estimates(true[None]), true)
    assert alone.of("a", "d-1").shared == DEFAULT_SPREAD.shared
    same = scattered(true, 1)
    assert learn_spreads(estimates(np.stack([same, same])), true).of("a", "d-1").shared == 0.95


def test_symmetric_turns_are_no_spread(tmp_path: Path) -> None:
    folder = write_models(
        tmp_path,
        obj_1={"symmetries_discrete": [[-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]]},
    )
    models = {"d": Models(folder)}
    true = random_poses(60)
    poses = scattered(true, 1)
    poses[::4] = poses[::4] @ np.diag([-1.0, -1.0, 1.0, 1.0])  # of object d-1 alone
    found = learn_spreads(estimates(poses[None]), true, models=models)
    without = learn_spreads(estimates(scattered(true, 1)[None]), true)
    spread, wanted = found.of("a", "d-1"), without.of("a", "d-1")
    assert spread.rotation_rad == pytest.approx(wanted.rotation_rad)
    assert spread.along == pytest.approx(wanted.along)
    blind = learn_spreads(estimates(poses[None]), true)
    assert blind.of("a", "d-1").rotation_rad > 3 * wanted.rotation_rad


@pytest.mark.parametrize(("known", "fits"), [(29, False), (30, True)])
def test_thirty_known_poses_are_enough(known: int, fits: bool) -> None:
    true = random_poses(40)
    true[known:, 0, 0] = np.nan
    given = estimates(random_poses(40)[None])
    if fits:
        assert learn_spreads(given, true).by_object == {}
    else:
        with pytest.raises(InputError, match=f"but {known} of 40 have one") as caught:
            learn_spreads(given, true)
        assert caught.value.parameters == ("ground_truth",)
    with pytest.raises(InputError, match="spreads take at least 30"):
        learn_spreads(given, true[:39])


@pytest.mark.ill_typed
def test_truth_that_is_no_list_of_poses_is_refused() -> None:
    given = estimates(random_poses(40)[None])
    for truth in (np.zeros(40), np.zeros((40, 16)), np.zeros((40, 4, 4, 1))):
        with pytest.raises(InputError, match="spreads take at least 30"):
            learn_spreads(given, truth)


@pytest.mark.parametrize("place", range(4))
def test_what_a_spread_may_be(place: int) -> None:
    for value, fits in ((0.0, place == 3), (1.0, True), (-0.1, False), (np.inf, False)):
        sizes = [0.003, 0.012, 0.07, 0.5]
        sizes[place] = value
        if fits:
            Spread(*sizes)
        else:
            with pytest.raises(InputError, match="should be positive, and the share from 0 to 1"):
                Spread(*sizes)


def test_tables_hold_each_objects_spread() -> None:
    one, other = Spread(0.1, 0.2, 0.3, 0.4), Spread(0.5, 0.6, 0.7, 0.8)
    spreads = Spreads({"b": other}, {("a", "d-2"): one})
    table = spreads.table(("a", "b"), np.array(["d-2", "d-1", "d-2"]))
    default = [DEFAULT_SPREAD.across, DEFAULT_SPREAD.along, DEFAULT_SPREAD.rotation_rad, 0.5]
    last = [0.5, 0.6, 0.7, 0.8]
    first = [0.1, 0.2, 0.3, 0.4]
    assert table.tolist() == [[first, last], [default, last], [first, last]]
    assert spreads.table(("a",), np.array([], dtype=str)).shape == (0, 1, 4)
