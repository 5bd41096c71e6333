"""The paper's pools and protocols: who shares a network, and what each protocol may look at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.forecasting.models.mlp.train import train
from graspcast.forecasting.models.mlp.types import MlpSettings, Problem, ValidationSet
from graspcast.forecasting.splits import validation_mask
from graspcast.paper.configurations import CONFIGURATIONS, Cell, CellKey, run

SHORT = MlpSettings(epochs=20, hidden=(8, 4), rate=1e-2)
OBJECTS, GRIPPERS = ("d-1", "d-10", "d-2"), ("parallel", "underactuated")
Cells = dict[CellKey, Cell]


def cells(seed: int = 0, n: int = 30) -> Cells:
    """Six cells of different sizes: a sample holds where its cell's own direction points."""
    rng = np.random.default_rng(seed)
    out = {}
    for i, name in enumerate(OBJECTS):
        for j, gripper in enumerate(GRIPPERS):
            x = rng.normal(size=(n + 5 * i + j, 4))
            success = x @ rng.normal(size=4) > 0
            is_train = rng.permutation(len(x)) >= len(x) // 4
            out["a", name, gripper] = Cell(x, success, is_train)
    return out


def test_who_shares_a_network() -> None:
    key = ("epos", "lmo-1", "parallel")
    pools = {name: configuration.pool(key) for name, configuration in CONFIGURATIONS.items()}
    assert pools == {
        "MLP": ("epos", "lmo-1", "parallel"),
        "MLP-O": ("epos", "*", "parallel"),
        "MLP-G": ("epos", "lmo-1", "*"),
        "MLP-OG": ("epos", "*", "*"),
    }


def directly(keys: list[CellKey], given_cells: Cells, hot: dict[CellKey, list[int]]) -> Problem:
    """The pool's training problem, put together by hand."""
    train_x, train_y, test_x, test_y, group = [], [], [], [], []
    for key in keys:
        cell = given_cells[key]
        x = np.array([[*row, *hot[key]] for row in cell.features])
        train_x += x[cell.is_train].tolist()
        train_y += cell.success[cell.is_train].tolist()
        test_x += x[~cell.is_train].tolist()
        test_y += cell.success[~cell.is_train].tolist()
        group += [OBJECTS.index(key[1])] * int((~cell.is_train).sum())
    validation = ValidationSet(np.array(test_x), np.array(test_y), np.array(group))
    return Problem(np.array(train_x), np.array(train_y), validation=(validation,))


def hot_inputs(name: str, given_cells: Cells) -> dict[CellKey, list[int]]:
    out = {}
    for key in given_cells:
        pooled = CONFIGURATIONS[name]
        objects = [int(key[1] == o) for o in OBJECTS] if pooled.pools_objects else []
        grippers = [int(key[2] == g) for g in GRIPPERS] if pooled.pools_grippers else []
        out[key] = [*objects, *grippers]
    return out


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_each_cell_gets_its_own_test_samples_in_order(name: str) -> None:
    given_cells = cells()
    configuration = CONFIGURATIONS[name]
    found = run(configuration, given_cells, seed=7, settings=SHORT, protocols=("paper", "last"))
    assert list(found) == ["paper", "last"]
    hot = hot_inputs(name, given_cells)
    pools: dict[tuple[str, ...], list[CellKey]] = {}
    for key in given_cells:
        pools.setdefault(configuration.pool(key), []).append(key)
    for number, keys in enumerate(pools.values()):
        problem = replace(directly(keys, given_cells, hot), seed=7000 + number)
        (trained,) = train([problem], SHORT)
        start = 0
        for key in keys:
            stop = start + int((~given_cells[key].is_train).sum())
            mine = slice(start, stop)
            assert_array_equal(found["last"][key], trained.last.probabilities[0][mine])
            seen = trained.validation[0]
            group = OBJECTS.index(key[1])
            best = seen.best_by_group[group] if configuration.pools_objects else seen.best
            assert_array_equal(found["paper"][key], best.probabilities[0][mine])
            start = stop


def hits(found: dict[CellKey, np.ndarray], given_cells: Cells) -> dict[CellKey, int]:
    """Right answers of each cell."""
    return {
        key: int(((p > 0.5) == given_cells[key].success[~given_cells[key].is_train]).sum())
        for key, p in found.items()
    }


@pytest.mark.parametrize("name", CONFIGURATIONS)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_papers_protocol_never_scores_below_the_last_epoch(name: str, seed: int) -> None:
    given_cells = cells(seed)
    found = run(CONFIGURATIONS[name], given_cells, seed=seed, settings=SHORT)
    assert set(found) == {"paper", "last", "validated"}
    paper, last = (hits(found[p], given_cells) for p in ("paper", "last"))
    # Grippers that share a network also share its checkpoint: their sum is what was maximised.
    for object_name in OBJECTS:
        groups = [[("a", object_name, g)] for g in GRIPPERS]
        if CONFIGURATIONS[name].pools_grippers:
            groups = [[key for group in groups for key in group]]
        for group in groups:
            assert sum(paper[key] for key in group) >= sum(last[key] for key in group)


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_only_the_papers_protocol_looks_at_test_outcomes(name: str) -> None:
    given_cells = cells()
    flipped = {
        key: replace(cell, success=cell.success ^ ~cell.is_train)
        for key, cell in given_cells.items()
    }
    one, two = (
        run(CONFIGURATIONS[name], c, seed=3, settings=SHORT) for c in (given_cells, flipped)
    )
    for protocol in ("last", "validated"):
        for key, probability in one[protocol].items():
            assert_array_equal(two[protocol][key], probability)
    assert any((two["paper"][key] != p).any() for key, p in one["paper"].items())


def test_the_validation_part_is_not_trained_on_and_chooses_the_checkpoint() -> None:
    (key, cell), *_ = cells(n=60).items()
    found = run(
        CONFIGURATIONS["MLP"], {key: cell}, seed=2, settings=SHORT, protocols=("validated",)
    )
    assert list(found) == ["validated"]
    x, y = cell.features[cell.is_train], cell.success[cell.is_train]
    part = validation_mask(y.astype(int), 2000)
    test = ValidationSet(cell.features[~cell.is_train], np.zeros((~cell.is_train).sum(), bool))
    problem = Problem(x[~part], y[~part], (test, ValidationSet(x[part], y[part])), seed=2000)
    (trained,) = train([problem], SHORT)
    chosen = trained.validation[1]
    assert chosen.lowest_loss.epoch == 1 + int(np.argmin(chosen.loss))
    assert_array_equal(found["validated"][key], chosen.lowest_loss.probabilities[0])


def test_the_seed_decides() -> None:
    given_cells = cells()

    def once(seed: int) -> np.ndarray:
        found = run(CONFIGURATIONS["MLP-O"], given_cells, seed=seed, settings=SHORT)
        return np.concatenate([p for by_cell in found.values() for p in by_cell.values()])

    assert_array_equal(once(4), once(4))
    assert (once(4) != once(5)).any()


def test_pooling_transfers_what_cells_have_in_common() -> None:
    """Four training samples do not teach a rule that another cell has three hundred of."""
    rng = np.random.default_rng(0)
    direction = np.array([1.0, -1.0, 0.5, 0.0])
    given_cells: Cells = {}
    for name, n in (("d-1", 400), ("d-2", 104)):
        x = rng.normal(size=(n, 4))
        given_cells["a", name, "parallel"] = Cell(x, x @ direction > 0, np.arange(n) < n - 100)
    longer = replace(SHORT, epochs=60)
    accuracy = {}
    for configuration in ("MLP", "MLP-O"):
        found = run(
            CONFIGURATIONS[configuration], given_cells, seed=0, settings=longer, protocols=("last",)
        )
        accuracy[configuration] = hits(found["last"], given_cells)["a", "d-2", "parallel"] / 100
    assert accuracy["MLP-O"] > 0.85 > accuracy["MLP"]
