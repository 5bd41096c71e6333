"""What a model file carries of its objects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from episode_world import World, new_world, poses
from graspcast import Forecaster
from graspcast.bop.models import ContinuousSymmetry, ModelInfo
from graspcast.errors import FormatError, GraspcastError
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.forecasting.known_objects import (
    MOST_POINTS,
    KnownModels,
    KnownObjects,
    spread_points,
)
from graspcast.io.arrays import read_arrays, write_arrays
from graspcast.pose.metrics import add
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.simulation.grasps.table import GraspTable, ReferenceGrasp
from graspcast.simulation.objects.types import Grasp

HOLD = transform(rotation_from_vector(np.array([0.1, 0.2, 0.3])), np.array([0.0, 0.01, 0.02]))


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


def test_a_loaded_file_forecasts_without_models_as_with_them(world: World, tmp_path: Path) -> None:
    world.forecaster.save(tmp_path / "model.npz")
    loaded = Forecaster.load(tmp_path / "model.npz")
    assert loaded.known is not None
    for i in range(3):
        own = loaded.predict(poses(i), "d-2", models=loaded.known.models)
        given = loaded.predict(poses(i), "d-2", models=world.models)
        assert own.probability == given.probability


def test_grasps_are_carried_by_name(world: World, tmp_path: Path) -> None:
    names = (REFERENCE_GRASP, "side")
    table = GraspTable(
        ReferenceGrasp(Grasp(obj_T_grasp=HOLD, object="d-1", gripper="parallel", name=name), "test")
        for name in names
    )
    world.forecaster.with_objects(world.models, table).save(tmp_path / "model.npz")
    known = Forecaster.load(tmp_path / "model.npz").known
    assert known is not None
    assert list(known.grasps) == ["d-1"] and list(known.grasps["d-1"]) == list(names)
    np.testing.assert_array_equal(known.grasps["d-1"]["side"], HOLD)


def test_symmetries_survive(world: World) -> None:
    turn = transform(rotation_from_vector(np.array([0.0, 0, np.pi])), np.zeros(3))
    about = ContinuousSymmetry(np.array([0.0, 0, 1]), np.array([0.01, 0, 0]))
    corner = np.array([-0.1, -0.1, -0.1])
    infos = {
        1: ModelInfo(1, 0.3, corner, -2 * corner, turn[None], (about, about)),
        4: ModelInfo(4, 0.3, corner, -2 * corner, np.empty((0, 4, 4))),
    }
    points = {1: np.eye(3) * 0.1, 4: np.empty((0, 3))}
    known = KnownObjects({"d": KnownModels(infos, points)}, {})
    again = KnownObjects.from_arrays(known.to_arrays())
    for number, info in infos.items():
        assert again.models["d"][number].symmetries.tobytes() == info.symmetries.tobytes()
    np.testing.assert_array_equal(again.models["d"].mesh(1).vertices, points[1])
    with pytest.raises(GraspcastError):
        again.models["d"].mesh(4)  # it had no points


def test_a_model_without_anything_known_is_kept(world: World) -> None:
    empty = KnownObjects.from_arrays(KnownObjects({}, {}).to_arrays())
    assert empty.models == {} and empty.grasps == {}


def test_a_thousand_points_give_nearly_the_same_add() -> None:
    rng = np.random.default_rng(0)
    uneven = rng.normal(size=(8000, 3)) * [0.05, 0.02, 0.1] * rng.random((8000, 1)) ** 2
    few = spread_points(uneven)
    assert few.shape == (MOST_POINTS, 3)
    turns = rotation_from_vector(rng.normal(size=(50, 3)) * 0.2)
    moved = transform(turns, rng.normal(size=(50, 3)) * 0.01)
    exact, found = (add(np.eye(4)[None], moved, np.asfortranarray(p)) for p in (uneven, few))
    np.testing.assert_allclose(found, exact, rtol=0.01)
    assert spread_points(few) is few


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("diameter_m", np.array([0.1])),
        ("diameter_m", np.array([0.1, np.nan])),
        ("names", np.array(["d-1", "d-1"])),
        ("names", np.array(["d-1", "nothing"])),
        ("points_count", np.array([1, 2])),
        ("discrete_count", np.array([-1, 1])),
        ("obj_T_grasp", np.zeros((1, 4, 4))),
    ],
)
def test_a_file_with_other_objects_is_refused(
    world: World, tmp_path: Path, name: str, value: np.ndarray
) -> None:
    world.forecaster.save(tmp_path / "model.npz")
    arrays = dict(read_arrays(tmp_path / "model.npz", ""))
    arrays[f"objects/{name}"] = value
    write_arrays(tmp_path / "model.npz", arrays)
    with pytest.raises(FormatError, match="not a complete model file"):
        Forecaster.load(tmp_path / "model.npz")


def test_what_is_known_is_told_shortly() -> None:
    corner = np.array([-0.1, -0.1, -0.1])
    info = ModelInfo(1, 0.3, corner, -2 * corner, np.empty((0, 4, 4)))
    assert repr(KnownModels({1: info}, {})) == "KnownModels(1 object)"


def test_grasps_that_are_no_poses_or_come_twice_are_refused() -> None:
    arrays = KnownObjects({}, {"d-1": {"side": HOLD, "top": HOLD}}).to_arrays()
    assert KnownObjects.from_arrays(arrays).grasps["d-1"].keys() == {"side", "top"}
    poses = arrays["obj_T_grasp"]
    with pytest.raises(ValueError, match="no rigid transform"):
        KnownObjects.from_arrays(arrays | {"obj_T_grasp": poses * 2})
    names = {k: v for k, v in arrays.items() if v.dtype.kind == "U" and "top" in v.tolist()}
    ((key, given),) = names.items()
    with pytest.raises(ValueError, match="two grasps of d-1 are called side"):
        KnownObjects.from_arrays(arrays | {key: np.where(given == "top", "side", given)})
