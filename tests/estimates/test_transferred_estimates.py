"""Estimates of other objects, as if they were of an object without images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.bop.dataset import BopDataset, read_ground_truth
from graspcast.bop.results import Results, read_results
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.loading import Inputs, load_inputs
from graspcast.estimates.transferred_estimates import transfer_estimates
from graspcast.pose.ray_frame import relative
from network_commands import N, write_made
from poses import write_models

HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_made(tmp_path_factory.mktemp("made"))


@pytest.fixture
def inputs(world: Path, tmp_path: Path) -> Inputs:
    mine = tmp_path / "mine"
    write_models(mine / "models", obj_3={})
    files = {name: world / f"{name}_made-test.csv" for name in "abc"}
    return load_inputs(files, bop=[world / "made", mine])


def errors(table: Results, truth: np.ndarray) -> np.ndarray:
    """Errors in the ray frame, sorted, as they do not depend on the object's own frame."""
    return np.sort(relative(table.cam_T_obj, truth), axis=0)


def test_errors_and_disagreements_stay_and_the_side_is_another(inputs: Inputs) -> None:
    found = transfer_estimates(inputs, "a", ["mine-3"], count=N)
    ((dataset, tables),) = found.inputs.results.items()
    assert dataset == "mine"
    assert set(tables["a"].obj_id) == {3} and tables["a"].im_id.tolist() == list(range(N))
    given = inputs.estimates("a")
    truth = inputs.truth(given, "a")
    for k, name in enumerate("abc"):
        original = relative(given.cam_T_obj[k], truth)
        assert_allclose(
            errors(tables[name], found.truth["mine", 3]), np.sort(original, axis=0), atol=1e-9
        )
    between = np.sort(relative(tables["a"].cam_T_obj, tables["b"].cam_T_obj), axis=0)
    assert_allclose(
        between, np.sort(relative(given.cam_T_obj[0], given.cam_T_obj[1]), axis=0), atol=1e-9
    )
    turned = tables["a"].cam_T_obj[:, :3, :3]
    assert not np.isclose(turned[:, None], given.cam_T_obj[0, None, :, :3, :3]).all((2, 3)).any()


def test_the_same_seed_gives_the_same_and_another_object_another(inputs: Inputs) -> None:
    def poses(seed: int) -> np.ndarray:
        found = transfer_estimates(inputs, "a", ["mine-3"], count=5, seed=seed)
        return found.inputs.results["mine"]["a"].cam_T_obj

    assert np.array_equal(poses(0), poses(0))
    assert not np.array_equal(poses(0), poses(1))


def test_a_turn_by_a_donors_symmetry_is_no_disagreement(world: Path, tmp_path: Path) -> None:
    half = {"symmetries_discrete": [HALF_TURN.ravel().tolist()]}
    models = write_models(tmp_path / "made" / "models", obj_1=half)
    (tmp_path / "made" / "test").symlink_to(world / "made" / "test")
    write_models(tmp_path / "mine" / "models", obj_3={})
    files = {name: world / f"{name}_made-test.csv" for name in "ab"}
    inputs = load_inputs(files, bop=[models.parent, tmp_path / "mine"])
    b = inputs.results["made"]["b"]
    b.cam_T_obj[::2] = b.cam_T_obj[::2] @ HALF_TURN
    tables = transfer_estimates(inputs, "a", ["mine-3"], count=N).inputs.results["mine"]
    turns = relative(tables["a"].cam_T_obj, tables["b"].cam_T_obj)[:, 3:]
    assert np.linalg.norm(turns, axis=1).max() < 1.0


def test_written_files_are_read_again(inputs: Inputs, tmp_path: Path) -> None:
    found = transfer_estimates(inputs, "a", ["mine-3"], count=7)
    files = found.write(tmp_path / "looks")
    assert [path.name for path in files] == [f"{name}_mine-test.csv" for name in "abc"]
    again = read_results(files[1])
    assert_allclose(again.cam_T_obj, found.inputs.results["mine"]["b"].cam_T_obj, atol=1e-9)
    truth = read_ground_truth(tmp_path / "looks" / "mine")
    assert_allclose(truth.cam_T_obj, found.truth["mine", 3], atol=1e-9)
    # As simulate reads them.
    bop = [BopDataset(tmp_path / "mine").root]
    load_inputs({"b": files[1]}, bop=bop, ground_truth=[tmp_path / "looks" / "mine"])


def test_what_cannot_be_transferred_is_said(inputs: Inputs) -> None:
    with pytest.raises(InputError, match="count is 0"):
        transfer_estimates(inputs, "a", ["mine-3"], count=0)
    with pytest.raises(InputError, match="name the objects"):
        transfer_estimates(inputs, "a", [], count=1)
    with pytest.raises(InputError, match="DATASET-NUMBER"):
        transfer_estimates(inputs, "a", ["mug"], count=1)
    with pytest.raises(UnknownNameError, match="known: 3"):
        transfer_estimates(inputs, "a", ["mine-4"], count=1)
    with pytest.raises(MismatchError, match="no models of yours"):
        transfer_estimates(inputs, "a", ["yours-1"], count=1)
    with pytest.raises(MismatchError, match="none of other objects"):
        transfer_estimates(inputs, "a", ["made-1"], count=1)
