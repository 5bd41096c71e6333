"""The two-stage model: draws of the pose error and expected success, against plain loops."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

import synthetic
from graspcast.forecasting.models.forest import Forest
from graspcast.forecasting.models.two_stage import ErrorModel, SuccessGivenError, expected_success
from graspcast.pose.ray_frame import error_along, obj_R_ray, relative
from poses import nudged, random_poses

N, TREES, DRAWS = 90, 9, 30


@pytest.fixture(scope="module")
def stages() -> tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray]:
    """Both stages, and what the first has learned from: features, and where the truth lay."""
    rng = np.random.default_rng(0)
    true = random_poses(N, 0)
    size = rng.uniform(0.2, 2, (N, 1, 1))
    est = true.copy()
    est[:, :3] += size * (nudged(true, 1, metres=0.02, radians=0.2) - true)[:, :3]
    est[:, :3, :3] = Rotation.from_matrix(est[:, :3, :3]).as_matrix()
    features = np.column_stack([size[:, 0, 0], rng.normal(size=(N, 3)), rng.integers(0, 3, N)])
    truth = relative(est, true)
    errors = ErrorModel.fit(features, truth, trees=TREES, seed=0)
    trials = nudged(np.tile(np.eye(4), (400, 1, 1)), 5, metres=0.03, radians=0.3)
    numbers = np.arange(400) % 2
    # The second object succeeds with errors with which the first fails.
    success = synthetic.holds(trials) ^ (numbers == 1)
    success_given_error = SuccessGivenError.fit(
        trials, numbers, success, codes=np.eye(2), trees=TREES, seed=0
    )
    return errors, success_given_error, features, truth


def asked(n: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    poses = random_poses(n, 8)
    features = np.column_stack([rng.uniform(0.2, 2, n), rng.normal(size=(n, 4))])
    distance = np.linalg.norm(poses[:, :3, 3], axis=1)
    return features, obj_R_ray(poses), distance, rng.integers(0, 2, n)


def leaf_value(forest: Forest, tree: int, row: np.ndarray) -> float:
    """A plain walk, without the compiled one."""
    node = int(forest.roots[tree])
    while forest.feature[node] >= 0:
        left = row[forest.feature[node]] <= forest.threshold[node]
        node = node + 1 if left else int(forest.right[node])
    return float(forest.value[node])


@pytest.mark.parametrize("judges", [1, 4, TREES])
def test_the_average_is_that_of_a_plain_loop(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray], judges: int
) -> None:
    errors, success_given_error, _, _ = stages
    features, axes, distance, numbers = asked()
    found = expected_success(
        errors, success_given_error, features, axes, distance, numbers, draws=DRAWS, trees=judges
    )
    drawn = errors.draws(features, DRAWS)
    for i in range(len(features)):
        total, count = 0.0, 0
        for d in range(DRAWS):
            error = error_along(axes[i], np.array(distance[i]), drawn[i, d])
            shift, turn = error[:3, 3], Rotation.from_matrix(error[:3, :3]).as_rotvec()
            lengths = [np.linalg.norm(shift), np.linalg.norm(turn)]
            row = np.float32([*shift, *turn, *lengths, numbers[i] == 0, numbers[i] == 1])
            # Every tree judges every so-manieth draw.
            stride = TREES // judges
            for tree in range(d % stride, TREES, stride):
                total += leaf_value(success_given_error.forest, tree, row)
                count += 1
        # One judgement may fall on a threshold's other side by rounding.
        assert found[i] == pytest.approx(total / count, abs=1.01 / count)


def test_with_all_trees_it_is_the_mean_over_draws_of_the_second_stage(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray],
) -> None:
    errors, success_given_error, _, _ = stages
    features, axes, distance, numbers = asked(60)
    found = expected_success(
        errors, success_given_error, features, axes, distance, numbers, draws=DRAWS, trees=10**6
    )
    drawn = errors.draws(features, DRAWS)
    guided = error_along(axes[:, None], distance[:, None], drawn)
    each = success_given_error.probability(guided.reshape(-1, 4, 4), np.repeat(numbers, DRAWS))
    expected = each.reshape(-1, DRAWS).mean(axis=1)
    assert np.mean(np.abs(found - expected) < 1e-6) > 0.95
    assert_allclose(found, expected, atol=0.05)
    assert found.std() > 0.05  # there is something to compare


def test_draws_are_truths_of_instances_in_the_same_leaf(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray],
) -> None:
    errors, _, trained, truth = stages
    features = asked(40)[0]
    drawn = errors.draws(features, DRAWS)
    assert drawn.shape == (40, DRAWS, 6)
    number = {row.tobytes(): i for i, row in enumerate(truth)}
    whose = np.array([[number[each.tobytes()] for each in row] for row in drawn])
    theirs, mine = errors.forest.leaves(trained), errors.forest.leaves(features)
    for d in range(DRAWS):
        tree = d % TREES
        assert_array_equal(theirs[whose[:, d], tree], mine[:, tree])


def test_leaves_hold_every_training_instance_once_a_tree(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray],
) -> None:
    errors = stages[0]
    assert len(errors.members) == N * TREES
    ends = [*errors.first[errors.offset].tolist(), len(errors.members)]
    for start, stop in pairwise(ends):
        assert sorted(errors.members[start:stop].tolist()) == list(range(N))
    assert (np.diff(errors.first) >= 2).all()


def test_larger_disagreement_draws_larger_errors(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray],
) -> None:
    errors = stages[0]
    small, large = np.zeros((1, 5)), np.zeros((1, 5))
    small[0, 0], large[0, 0] = 0.3, 1.9
    sizes = [np.abs(errors.draws(rows, 90)[..., 3:]).mean() for rows in (small, large)]
    assert sizes[1] > 1.5 * sizes[0]


def test_a_row_alone_and_among_others_bit_by_bit(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray],
) -> None:
    errors, success_given_error, _, _ = stages
    rows = asked(30)
    together = expected_success(errors, success_given_error, *rows, draws=DRAWS)
    order = np.random.default_rng(0).permutation(30)
    mixed = expected_success(
        errors, success_given_error, *(part[order] for part in rows), draws=DRAWS
    )
    assert_array_equal(mixed, together[order])
    for i in (0, 13, 29):
        alone = expected_success(
            errors, success_given_error, *(p[i : i + 1] for p in rows), draws=DRAWS
        )
        assert alone[0] == together[i]
    assert_array_equal(errors.draws(rows[0], 5)[3], errors.draws(rows[0][3:4], 5)[0])


def test_the_second_stage_distinguishes_objects(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray],
) -> None:
    success_given_error = stages[1]
    trials = nudged(np.tile(np.eye(4), (200, 1, 1)), 50, metres=0.03, radians=0.3)
    held = synthetic.holds(trials)
    for number, expected in ((0, held), (1, ~held)):
        found = success_given_error.probability(trials, np.full(200, number)) > 0.5
        assert np.mean(found == expected) > 0.85


def test_arrays_there_and_back(
    stages: tuple[ErrorModel, SuccessGivenError, np.ndarray, np.ndarray],
) -> None:
    errors = stages[0]
    again = ErrorModel.from_arrays(errors.to_arrays("e"), "e")
    features = asked(10)[0]
    assert_array_equal(again.draws(features, DRAWS), errors.draws(features, DRAWS))


@pytest.mark.parametrize("name", ["first", "offset", "members", "truth"])
@pytest.mark.parametrize("value", [-1, 10**6, np.nan])
def test_error_models_that_would_read_elsewhere_are_refused(name: str, value: float) -> None:
    features, truth = np.random.default_rng(0).normal(size=(2, 40, 6))
    arrays = ErrorModel.fit(features, truth, trees=3, seed=0).to_arrays("e")
    assert len(ErrorModel.from_arrays(arrays, "e").truth) == 40
    broken = arrays[f"e/{name}"].copy()
    if np.isnan(value) and name != "truth":
        broken = broken[:-1]
    elif name == "truth":
        broken[3, 2] = np.inf if value != value else np.nan
    else:
        broken[-1 if name == "first" else 1] = value
    with pytest.raises(ValueError, match="error model"):
        ErrorModel.from_arrays(arrays | {f"e/{name}": broken}, "e")
