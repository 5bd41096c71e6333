"""Model files: whole, or refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import FormatError
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.train import train_forecaster
from graspcast.io.arrays import read_arrays, write_arrays
from poses import write_models


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"d": Models(folder)}


@pytest.fixture(scope="module")
def threshold(models: dict[str, Models]) -> Forecaster:
    return train_forecaster(synthetic.tried(360), method="threshold", models=models)


@pytest.fixture(scope="module")
def whole(threshold: Forecaster, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return written(threshold, tmp_path_factory.mktemp("model"))


def written(forecaster: Forecaster, folder: Path) -> bytes:
    forecaster.save(folder / "model.npz")
    return (folder / "model.npz").read_bytes()


def refused(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(FormatError) as caught:
        Forecaster.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value)


def test_no_part_of_a_file_is_taken_for_a_model(whole: bytes, tmp_path: Path) -> None:
    lengths = {*range(0, len(whole), max(1, len(whole) // 150)), *range(40), len(whole) - 1}
    for length in lengths:
        assert "train it again" in refused(tmp_path / "model.npz", whole[:length])


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.binary(max_size=200), st.binary(max_size=60).map(b"PK\3\4".__add__)))
def test_bytes_of_any_kind_are_refused(content: bytes, tmp_path: Path) -> None:
    refused(tmp_path / "model.npz", content)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 10**6), value=st.integers(1, 255))
def test_a_changed_byte_is_refused_or_changes_nothing(
    whole: bytes,
    threshold: Forecaster,
    models: dict[str, Models],
    tmp_path: Path,
    place: int,
    value: int,
) -> None:
    content = bytearray(whole)
    content[place % len(whole)] ^= value
    path = tmp_path / "model.npz"
    path.write_bytes(content)
    unseen = synthetic.estimates(4, seed=9)
    try:
        again = Forecaster.load(path)
    except FormatError:
        return
    expected = threshold.probability(unseen, models)
    assert_array_equal(again.probability(unseen, models), expected)


def test_other_files_are_refused(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    with pytest.raises(FormatError, match="cannot be read"):
        Forecaster.load(tmp_path / "none.npz")
    with pytest.raises(FormatError, match="is a directory"):
        Forecaster.load(tmp_path)
    path.write_bytes(whole)
    arrays = read_arrays(path, "")
    content = json.loads(str(arrays["card"]))
    for changed in (
        [],
        {},
        {"format": content["format"]},
        {"format": content["format"], "card": {}},
        {**content, "card": {**content["card"], "method": "forest"}},
        {**content, "card": {**content["card"], "odd": 1}},
        {**content, "card": {**content["card"], "principal": 1}},
        {**content, "card": {**content["card"], "samples": -1}},
        {**content, "card": {**content["card"], "success_rate": "high"}},
        {**content, "card": {**content["card"], "objects": "d-1"}},
        {**content, "card": {**content["card"], "objects": ["d-1", "d-1"]}},
    ):
        write_arrays(path, arrays | {"card": np.array(json.dumps(changed))})
        assert "not a complete model file" in refused(path, path.read_bytes())
    write_arrays(path, arrays | {"card": np.array(json.dumps({**content, "format": 99}))})
    assert "is a model of format 99, not 5" in refused(path, path.read_bytes())
    np.savez(path, **arrays)
    assert "has no digest" in refused(path, path.read_bytes())
    write_arrays(path, {"x": np.zeros(3)})
    assert "not a complete model file" in refused(path, path.read_bytes())
    np.save(tmp_path / "x.npy", np.zeros(3))
    assert "train it again" in refused(path, (tmp_path / "x.npy").read_bytes())


def test_no_part_of_a_file_with_forests_is_taken_for_a_model(
    models: dict[str, Models], tmp_path: Path
) -> None:
    forecaster = train_forecaster(
        synthetic.training_data(80), forests=ForestSettings(trees=3, folds=0), models=models
    )
    content = written(forecaster, tmp_path)
    path = tmp_path / "part.npz"
    for length in [*range(0, len(content), len(content) // 40), len(content) - 1]:
        assert "train it again" in refused(path, content[:length])
    path.write_bytes(content)
    arrays = read_arrays(path, "")
    needed = [
        *(f"0/predictor/{part}/feature" for part in ("direct", "errors/f", "success_given_error")),
        "0/predictor/errors/members",
        "0/predictor/calibration",
        "0/novelty/scores",
        "0/typical",
    ]
    for name in needed:
        write_arrays(path, {k: v for k, v in arrays.items() if k != name})
        assert "not a complete model file" in refused(path, path.read_bytes())


FORESTS = {
    "typical features": ("0/typical", lambda a: np.where(np.arange(a.size) == 0, np.nan, a)),
    "the novelty detector has arrays of shapes": ("0/novelty/centre", lambda a: a[:6]),
    "different lengths": ("0/predictor/calibration", lambda a: a[:1]),
    "codes of the grasps are not finite": ("0/predictor/codes", lambda a: np.full((2, 2), np.nan)),
    "the model draws 0 pose errors": ("0/predictor/draws", lambda a: np.zeros_like(a)),
}


@pytest.fixture(scope="module")
def forests(
    models: dict[str, Models], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, np.ndarray]:
    settings = ForestSettings(trees=3, folds=0)
    forecaster = train_forecaster(synthetic.training_data(80), forests=settings, models=models)
    folder = tmp_path_factory.mktemp("forests")
    written(forecaster, folder)
    return read_arrays(folder / "model.npz", "")


@pytest.mark.parametrize("says", FORESTS)
def test_parts_that_do_not_fit_are_refused_though_the_digest_is_right(
    forests: dict[str, np.ndarray], tmp_path: Path, says: str
) -> None:
    (name, change), path = FORESTS[says], tmp_path / "model.npz"
    assert name in forests or name == "0/predictor/codes"
    write_arrays(path, forests | {name: change(forests.get(name, np.empty(0)))})
    said = refused(path, path.read_bytes())
    assert "is not a complete model file" in said and says in said


def test_cards_that_contradict_each_other_are_refused(
    forests: dict[str, np.ndarray], whole: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "model.npz"
    content = json.loads(str(forests["card"]))
    card = content["card"]
    for changed, says in (
        ({**content, "others": [card]}, "two parts are for one guide"),
        ({**content, "card": {**card, "grasps": {"d-9": ["top"]}}}, "grasps"),
        (
            {**content, "card": {**card, "features": "visibility"}},
            "disagree on forecasts from one view",
        ),
    ):
        write_arrays(path, forests | {"card": np.array(json.dumps(changed))})
        assert says in refused(path, path.read_bytes())
    path.write_bytes(whole)
    arrays = read_arrays(path, "")
    name = "0/predictor/threshold"
    write_arrays(path, arrays | {name: arrays[name].astype(np.int64)})
    assert "not lists of numbers of one length" in refused(path, path.read_bytes())
