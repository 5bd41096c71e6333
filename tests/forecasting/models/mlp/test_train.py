"""Training of many networks, against independent arithmetic."""

from __future__ import annotations

import copy
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import graspcast.io
from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.models.mlp.network import Mlp
from graspcast.forecasting.models.mlp.train import train
from graspcast.forecasting.models.mlp.types import (
    Checkpoint,
    MlpSettings,
    Problem,
    Trained,
    ValidationSet,
)
from mlp_reference import numeric_gradient, parameters64

SHORT = MlpSettings(epochs=12)


def samples(seed: int, n: int, d: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Inputs, and labels that a line through them separates, but for some noise."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, d)).astype(np.float32)
    return x, x @ rng.normal(size=d) + 0.3 * rng.normal(size=n) > 0


def problem(seed: int, n: int = 90, d: int = 12) -> Problem:
    x, y = samples(seed, n + 40, d)
    groups = np.arange(40) % 3 * 7 - 7
    return Problem(
        x[:n], y[:n], (ValidationSet(x[n:], y[n:], groups), ValidationSet(x[-9:], y[-9:])), seed
    )


# --- Gradient and optimiser -----------------------------------------------------------------------


def test_adam_on_a_cosine_is_that_of_the_paper_by_kingma_and_ba() -> None:
    # One batch holds all samples, so the order within it changes nothing but rounding.
    x, y = samples(3, 16, 5)
    options = MlpSettings(hidden=(4,), epochs=30, batch=16, rate=0.02, final_rate=1e-3)
    parameters = parameters64(Mlp.random(5, (4,), seed=9))
    mean = [np.zeros_like(array) for array in parameters]
    square = [np.zeros_like(array) for array in parameters]
    for t in range(1, 31):
        rate = 1e-3 + (0.02 - 1e-3) * (1 + np.cos(np.pi * (t - 1) / 30)) / 2
        for k, g in enumerate(numeric_gradient(parameters, x, y)):
            mean[k] = 0.9 * mean[k] + 0.1 * g
            square[k] = 0.999 * square[k] + 0.001 * g * g
            unbiased = mean[k] / (1 - 0.9**t), square[k] / (1 - 0.999**t)
            parameters[k] = parameters[k] - rate * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8)
    (trained,) = train([Problem(x, y, seed=9)], options)
    for ours, theirs in zip(parameters64(trained.last.mlp), parameters, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=2e-4)


def test_training_equals_torch() -> None:
    torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")
    x, y = samples(5, 16)
    options = MlpSettings(epochs=60)
    start = Mlp.random(12, options.hidden, seed=5)
    layers = []
    for weight, bias in zip(start.weights, start.biases, strict=True):
        layer = torch.nn.Linear(weight.shape[1], weight.shape[0])
        layer.weight.data, layer.bias.data = torch.tensor(weight), torch.tensor(bias)
        layers += [layer, torch.nn.ReLU()]
    net = torch.nn.Sequential(*layers[:-1], torch.nn.Sigmoid())
    optimiser = torch.optim.Adam(net.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, 60, eta_min=1e-5)
    inputs, labels = torch.tensor(x), torch.tensor(y, dtype=torch.float32)
    for _ in range(60):
        optimiser.zero_grad()
        torch.nn.functional.binary_cross_entropy(net(inputs)[:, 0], labels).backward()
        optimiser.step()
        schedule.step()
    (trained,) = train([Problem(x, y, seed=5)], options)
    theirs = net(inputs).detach().numpy()[:, 0]
    np.testing.assert_allclose(trained.last.mlp.predict(x), theirs, atol=2e-5)


# --- Validation ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def trained() -> Trained:
    return train([problem(2)], MlpSettings(epochs=200, rate=3e-3))[0]


def hits(checkpoint: Checkpoint, index: int) -> np.ndarray:
    hit: np.ndarray = (checkpoint.probabilities[index] > 0.5) == problem(2).validation[index].labels
    return hit


def test_a_selected_checkpoint_is_the_first_epoch_that_reaches_the_best(trained: Trained) -> None:
    groups = problem(2).validation[0].groups
    assert groups is not None
    for k, seen in enumerate(trained.validation):
        assert seen.best.epoch == np.argmax(seen.accuracy) + 1
        assert seen.lowest_loss.epoch == np.argmin(seen.loss) + 1
        assert hits(seen.best, k).mean() == pytest.approx(seen.accuracy.max(), abs=1e-12)
        for group, best in seen.best_by_group.items():
            curve = seen.accuracy_by_group[group]
            assert best.epoch == np.argmax(curve) + 1
            mine = groups == group if k == 0 else slice(None)
            assert hits(best, k)[mine].mean() == pytest.approx(curve.max(), abs=1e-12)
    seen = trained.validation[0]
    assert sorted(seen.best_by_group) == [-7, 0, 7]
    assert len({best.epoch for best in seen.best_by_group.values()}) > 1
    assert 1 < seen.best.epoch < 200


def test_a_checkpoint_is_where_a_shorter_training_on_the_same_schedule_stood(
    trained: Trained, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = trained.validation[0].best
    whole = MlpSettings(epochs=200, rate=3e-3).rates()
    monkeypatch.setattr(MlpSettings, "rates", lambda self: whole[: self.epochs])
    (shorter,) = train([problem(2)], MlpSettings(epochs=best.epoch, rate=3e-3))
    for ours, theirs in zip(best.mlp.weights, shorter.last.mlp.weights, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_the_curves_are_those_of_the_probabilities(trained: Trained) -> None:
    for k, (seen, held_out) in enumerate(
        zip(trained.validation, problem(2).validation, strict=True)
    ):
        p = trained.last.probabilities[k]
        np.testing.assert_allclose(p, trained.last.mlp.predict(held_out.inputs), atol=1e-5)
        assert hits(trained.last, k).mean() == pytest.approx(seen.accuracy[-1])
        entropy = -np.log(np.where(held_out.labels, p, 1 - p)).mean()
        assert entropy == pytest.approx(seen.loss[-1], rel=1e-5)
    seen = trained.validation[0]
    groups = problem(2).validation[0].groups
    sizes = {group: np.mean(groups == group) for group in seen.accuracy_by_group}
    pooled = sum(sizes[group] * curve for group, curve in seen.accuracy_by_group.items())
    np.testing.assert_allclose(pooled, seen.accuracy)


def test_validation_does_not_change_the_training(trained: Trained) -> None:
    alone = replace(problem(2), validation=())
    (without,) = train([alone], MlpSettings(epochs=200, rate=3e-3))
    assert without.validation == ()
    assert without.last.probabilities == ()
    np.testing.assert_array_equal(without.last.mlp.weights[0], trained.last.mlp.weights[0])


def test_a_network_learns_what_is_separable() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (600, 2))
    y = x[:, 0] * x[:, 1] > 0  # no line separates these
    problems = [Problem(x[:400], y[:400], (ValidationSet(x[400:], y[400:]),), s) for s in range(4)]
    found = [t.validation[0].accuracy[-1] for t in train(problems, MlpSettings(epochs=300))]
    assert max(found) > 0.95


# --- Repeatability --------------------------------------------------------------------------------


def assert_identical(a: Trained, b: Trained) -> None:
    for ours, theirs in zip(a.last.mlp.weights, b.last.mlp.weights, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    for seen, again in zip(a.validation, b.validation, strict=True):
        np.testing.assert_array_equal(seen.loss, again.loss)
        np.testing.assert_array_equal(seen.accuracy, again.accuracy)
        np.testing.assert_array_equal(seen.best.mlp.weights[0], again.best.mlp.weights[0])


def test_threads_order_and_company_change_no_bit() -> None:
    problems = [problem(s, n, d) for s, n, d in ((1, 90, 12), (2, 33, 29), (3, 300, 5), (4, 7, 1))]
    alone = [train([one], SHORT, threads=1)[0] for one in problems]
    together = train(problems, SHORT, threads=2)
    backwards = train(problems[::-1], SHORT, threads=3)[::-1]
    for a, b, c in zip(alone, together, backwards, strict=True):
        assert_identical(a, b)
        assert_identical(a, c)


def test_the_seed_decides() -> None:
    one, other = train([replace(problem(1), seed=s) for s in (1, 2)], SHORT)
    assert not np.array_equal(one.last.mlp.weights[0], other.last.mlp.weights[0])


def test_the_problem_is_left_as_it_was() -> None:
    given_problem = problem(1)
    before = copy.deepcopy(given_problem)
    train([given_problem], SHORT)
    np.testing.assert_array_equal(given_problem.inputs, before.inputs)
    np.testing.assert_array_equal(given_problem.labels, before.labels)


def test_progress_grows_to_one_in_the_calling_thread() -> None:
    shares: list[float] = []
    threads = set()

    def note(share: float, _: str) -> None:
        shares.append(share)
        threads.add(threading.get_ident())

    train([problem(s) for s in range(3)], SHORT, progress=note)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    assert threads == {threading.get_ident()}


def test_an_error_in_the_callback_stops_the_training() -> None:
    def interrupt(share: float, _: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train([problem(s, 2000) for s in range(50)], MlpSettings(), progress=interrupt)


def test_no_problems_are_no_work() -> None:
    assert train([]) == []


# --- Compilation ----------------------------------------------------------------------------------


def in_another_process(program: str, source: Path, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        env={**os.environ, "PYTHONPATH": str(source), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


SOURCE = Path(graspcast.io.__file__).parents[2]


def test_importing_does_not_import_the_compiler() -> None:
    program = "import sys, graspcast.forecasting.models.mlp.train; print('numba' in sys.modules)"
    assert in_another_process(program, SOURCE).strip() == "False"


@pytest.mark.slow
def test_training_works_where_nothing_can_be_cached(tmp_path: Path) -> None:
    shutil.copytree(SOURCE, tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    # A file where the directory would be: even root cannot write there.
    (tmp_path / "src/graspcast/forecasting/models/mlp/__pycache__").touch()
    program = (
        "import numpy as np\n"
        "from graspcast.forecasting.models.mlp.train import train\n"
        "from graspcast.forecasting.models.mlp.types import MlpSettings, Problem\n"
        "x = np.linspace(-1, 1, 30)[:, None]\n"
        "print(train([Problem(x, x[:, 0] > 0)], MlpSettings(epochs=2))[0].last.epoch)\n"
    )
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"), "/dev/null/none")
    nowhere["PYTHONDONTWRITEBYTECODE"] = "1"
    assert in_another_process(program, tmp_path / "src", **nowhere).strip() == "2"


def test_extreme_inputs_keep_everything_finite() -> None:
    x, y = samples(1, 40)
    (result,) = train([Problem(x * 1e4, y, (ValidationSet(x * 1e4, y),))], SHORT)
    assert np.isfinite(result.validation[0].loss).all()
    assert np.isfinite(result.last.probabilities[0]).all()


# --- Bad input ------------------------------------------------------------------------------------


def _with(**changes: object) -> Callable[[Problem], Problem]:
    return lambda one: replace(one, **changes)  # type: ignore[arg-type]


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (_with(labels=np.zeros(3, bool)), MismatchError, "problem 1: inputs are"),
        (_with(labels=np.full(90, 2)), InputError, "0 or 1"),
        (_with(inputs=np.full((90, 12), np.nan)), InputError, "input 0 of row 0 is nan"),
        (_with(inputs=np.zeros((0, 12)), labels=np.zeros(0, bool)), InputError, "no samples"),
        (_with(inputs=np.zeros((90, 11))), MismatchError, "validation set 0: 12 inputs, but 11"),
        (
            lambda one: replace(
                one,
                validation=(ValidationSet(np.zeros((2, 12)), np.zeros(2, bool), np.zeros(3, int)),),
            ),
            MismatchError,
            "3 groups for 2 samples",
        ),
    ],
)
def test_what_does_not_fit_is_named(
    change: Callable[[Problem], Problem], error: type[InputError], message: str
) -> None:
    with pytest.raises(error, match=message):
        train([problem(0), change(problem(0))], SHORT)
