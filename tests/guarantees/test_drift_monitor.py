"""The drift monitor: false alarms, delays, its e-value, and its file."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import graspcast
from graspcast.errors import FormatError, InputError
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.io.artefacts import write_artefact

ENV = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}


def e_value(monitor: DriftMonitor, outcomes: list[bool]) -> float:
    """The definition, term by term: a bet that starts at s has the likelihood ratio from s on."""
    n, r = len(outcomes), monitor.rate
    total = 1.0 / (n + 1)  # not yet bet
    for q in monitor.alternatives:
        for s in range(1, n + 1):
            ratio = math.prod(q / r if y else (1 - q) / (1 - r) for y in outcomes[s - 1 :])
            total += ratio / (s * (s + 1)) / len(monitor.alternatives)
    return total


@given(st.lists(st.booleans(), max_size=40), st.floats(0.05, 0.99))
def test_the_e_value_is_its_definition(outcomes: list[bool], rate: float) -> None:
    monitor = DriftMonitor(rate)
    for success in outcomes:
        monitor.observe(success)
    assert monitor.log_e_value == pytest.approx(math.log(e_value(monitor, outcomes)), abs=1e-9)


@pytest.mark.parametrize("rate", [0.6, 0.9])
@pytest.mark.parametrize("truth", ["at the rate", "above it"])
def test_the_expected_e_value_is_at_most_one_while_the_rate_holds(rate: float, truth: str) -> None:
    # The expected e-value over all outcomes of eight trials, exactly: 1 at the rate, less above it.
    p = rate if truth == "at the rate" else (1 + rate) / 2
    expected = 0.0
    for outcomes in product([False, True], repeat=8):
        monitor = DriftMonitor(rate)
        for success in outcomes:
            monitor.observe(success)
        expected += math.prod(p if y else 1 - p for y in outcomes) * monitor.e_value
    assert expected == pytest.approx(1.0) if truth == "at the rate" else expected < 1.0


@pytest.mark.parametrize("most", [None, 5])
def test_the_expected_e_value_of_units_is_one(most: int | None) -> None:
    # Units of which half hold all five attempts, half their only one with 0.8: by attempts the
    # rate is (5 + 0.8) / 6, by units 0.9. Each kind of monitor is fair to its own rate.
    rate = 0.9 if most is None else 5.8 / 6
    kinds = [((5, 5), 0.5), ((1, 1), 0.4), ((1, 0), 0.1)]
    expected = 0.0
    for units in product(kinds, repeat=3):
        monitor = DriftMonitor(rate, max_attempts_per_unit=most)
        for i, ((attempts, held), _) in enumerate(units):
            for j in range(attempts):
                monitor.observe(j < held, unit=f"s{i}")
        monitor.close_unit()
        expected += math.prod(chance for _, chance in units) * monitor.e_value
    assert expected == pytest.approx(1.0)


# Seeded streams; the margin is three standard deviations of an alarm rate of exactly alpha.


def alarms(streams: np.ndarray, unit: int | None = None) -> float:
    count = 0
    for stream in streams:
        monitor = DriftMonitor(0.9, 0.1)
        for i, success in enumerate(stream.tolist()):
            monitor.observe(success, None if unit is None else str(i // unit))
        count += monitor.close_unit()
    return count / len(streams)


ALLOWED = 0.1 + 3 * math.sqrt(0.1 * 0.9 / 100)


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_stated() -> None:
    rng = np.random.default_rng(0)
    assert alarms(rng.random((100, 400)) < 0.9) <= ALLOWED
    # The rate may wander above the guaranteed one, and depend on what has happened.
    wandering = 0.9 + 0.1 * (np.sin(np.arange(400) / 20) > 0)
    assert alarms(rng.random((100, 400)) < wandering) <= ALLOWED


@pytest.mark.slow
def test_scenes_that_fail_as_a_whole_are_one_observation() -> None:
    rng = np.random.default_rng(0)
    scenes = np.repeat(rng.random((100, 40)) < 0.9, 10, axis=1)
    assert alarms(scenes, unit=10) <= ALLOWED
    assert alarms(scenes) > 2 * ALLOWED


@pytest.mark.slow
def test_a_lower_rate_is_detected() -> None:
    rng = np.random.default_rng(0)
    for before, after, within in ((0, 0.7, 150), (0, 0.5, 50), (400, 0.6, 150)):
        late = 0
        for _ in range(30):
            monitor = DriftMonitor(0.9)
            for success in (rng.random(before) < 0.95).tolist():
                monitor.observe(success)
            for success in (rng.random(within) < after).tolist():
                monitor.observe(success)
            late += not monitor.alarm
        assert late <= 3, (before, after)


def test_an_alarm_stays_until_the_restart() -> None:
    monitor = DriftMonitor(0.9)
    while not monitor.observe(False):
        assert monitor.trials < 20
    at = monitor.alarm_at
    for _ in range(500):
        assert monitor.observe(True)
    assert monitor.alarm_at == at
    assert monitor.e_value < 1 / monitor.alpha <= monitor.max_e_value
    monitor.restart()
    assert monitor == DriftMonitor(0.9, restarts=1)


@settings(max_examples=50)
@given(st.lists(st.tuples(st.booleans(), st.sampled_from("ab")), max_size=40), st.integers(0, 40))
def test_resuming_from_a_file_changes_nothing(
    tmp_path_factory: pytest.TempPathFactory, outcomes: list[tuple[bool, str]], cut: int
) -> None:
    path = tmp_path_factory.mktemp("state") / "m.json"
    straight = DriftMonitor(0.9, 0.01)
    for success, unit in outcomes:
        straight.observe(success, unit)
    interrupted = DriftMonitor(0.9, 0.01)
    for success, unit in outcomes[:cut]:
        interrupted.observe(success, unit)
    interrupted.save(path)
    resumed = DriftMonitor.load(path)
    assert resumed == interrupted
    for success, unit in outcomes[cut:]:
        resumed.observe(success, unit)
    assert resumed == straight


@pytest.mark.slow
def test_a_killed_process_leaves_a_complete_state(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    code = (
        "import sys; from graspcast import DriftMonitor; m = DriftMonitor(0.9)\n"
        "while True:\n"
        "    m.observe(True); m.save(sys.argv[1]); print(m.trials, flush=True)"
    )
    for _ in range(3):
        robot = subprocess.Popen(
            [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True, env=ENV
        )
        assert robot.stdout is not None
        for _ in range(20):
            seen = int(robot.stdout.readline())
        robot.send_signal(signal.SIGKILL)
        robot.wait()
        robot.stdout.close()
        assert DriftMonitor.load(path).trials >= seen


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, "rate should be above 0"),
        ({"rate": 0.9, "alpha": 1.0}, "alpha should be above 0 and below 1"),
        ({"rate": 0.9, "max_attempts_per_unit": 0}, "1 or more"),
    ],
)
def test_bad_settings_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        DriftMonitor(**options)  # type: ignore[arg-type]


def test_a_unit_with_too_many_attempts_is_refused() -> None:
    monitor = DriftMonitor(0.9, max_attempts_per_unit=2)
    monitor.observe(True, "a")
    monitor.observe(True, "a")
    monitor.observe(True, "b")
    before = monitor.as_dict()
    monitor.observe(True, "b")
    with pytest.raises(InputError, match="unit b has more than 2 attempts"):
        monitor.observe(True, "b")
    assert monitor.trials == before["trials"] + 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 1}, "format 1, not 2; start a new one"),
        ({"trials": -1}, "whole numbers"),
        ({"trials": 1.5}, "whole numbers"),
        ({"log_wealth": [0.0]}, "8 entries"),
        ({"log_wealth": "x"}, "not a complete monitor state"),
        ({"rate": 2.0}, "rate should be"),
        ({"rate": None}, "not a complete monitor state"),
    ],
)
def test_damaged_states_are_refused(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = tmp_path / "m.json"
    write_artefact(path, {**DriftMonitor(0.9).as_dict(), **change})
    with pytest.raises(FormatError, match=message):
        DriftMonitor.load(path)
    text = json.dumps(DriftMonitor(0.9).as_dict())
    path.write_text(text[: len(text) // 2])
    with pytest.raises(FormatError, match="not valid JSON"):
        DriftMonitor.load(path)


def test_every_entry_of_a_state_is_needed(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    whole = DriftMonitor(0.9).as_dict()
    for key in whole:
        write_artefact(path, {k: v for k, v in whole.items() if k != key})
        with pytest.raises(FormatError, match=f"no '{key}'"):
            DriftMonitor.load(path)


@pytest.mark.parametrize("rate", [0.5, 0.9])
def test_the_rates_that_are_bet_on_are_spaced_evenly_in_the_logarithm(rate: float) -> None:
    expected = rate * np.geomspace(0.95, 1 / 3, 8)
    assert DriftMonitor(rate).alternatives == pytest.approx(expected.tolist())


@pytest.mark.parametrize("most", [None, 1, 4])
def test_a_trial_without_a_unit_is_a_unit_of_its_own(most: int | None) -> None:
    without, with_units = (DriftMonitor(0.9, max_attempts_per_unit=most) for _ in range(2))
    for i, success in enumerate([True, False, False, True, False]):
        without.observe(success)
        with_units.observe(success, f"u{i}")
    with_units.close_unit()
    assert without.log_wealth == pytest.approx(with_units.log_wealth)
    assert without.observations == with_units.observations == 5


def test_a_trial_without_a_unit_closes_the_one_before() -> None:
    monitor = DriftMonitor(0.9)
    monitor.observe(True, "a")
    monitor.observe(False, "a")
    assert (monitor.unit, monitor.unit_trials, monitor.unit_successes) == ("a", 2, 1)
    assert monitor.observations == 0
    monitor.observe(True)
    assert (monitor.unit, monitor.unit_trials, monitor.observations) == (None, 0, 2)


def test_a_unit_weighs_as_much_as_its_share_of_the_most_attempts() -> None:
    """The likelihood ratio of a unit with two of four attempts counts half."""
    rate, most = 0.9, 4
    monitor = DriftMonitor(rate, max_attempts_per_unit=most)
    monitor.observe(True, "a")
    monitor.observe(False, "a")
    monitor.close_unit()
    total = 1 / 2  # not yet bet
    for q in monitor.alternatives:
        ratio = 0.5 * q / rate + 0.5 * (1 - q) / (1 - rate)
        total += 1 / 2 * (1 + 2 / most * (ratio - 1)) / 8
    assert monitor.e_value == pytest.approx(total)


def test_the_alarm_is_raised_at_the_trial_that_reaches_the_level_and_not_before() -> None:
    monitor = DriftMonitor(0.9, 0.02)
    values = []
    while not monitor.observe(False):
        values.append(monitor.e_value)
        assert monitor.alarm_at is None
    assert monitor.alarm_at == monitor.trials == len(values) + 1
    assert max(values) < 50 <= monitor.e_value == monitor.max_e_value
    # Exactly at the level, too.
    again = DriftMonitor(0.9, 1 / values[-1])
    for _ in values:
        again.observe(False)
    assert again.e_value * again.alpha == pytest.approx(1.0)


def test_huge_e_values_are_finite() -> None:
    monitor = DriftMonitor(0.9, log_wealth=(900.0,) * 8, log_max_e_value=900.0)
    assert monitor.e_value == monitor.max_e_value == math.exp(700.0)
    small = DriftMonitor(0.9, log_max_e_value=699.5)
    assert small.max_e_value == math.exp(699.5)


@pytest.mark.parametrize(
    ("change", "fits"),
    [
        ({"unit": "a", "unit_trials": 2, "unit_successes": 2}, True),
        ({"unit": "a", "unit_trials": 2, "unit_successes": 0}, True),
        ({"unit": "a", "unit_trials": 2, "max_attempts_per_unit": 2}, True),
        ({"unit": "a", "unit_trials": 3, "max_attempts_per_unit": 2}, False),
        ({"unit": "a", "unit_trials": 2, "unit_successes": 3}, False),
        ({"unit": "a", "unit_trials": 2, "unit_successes": -1}, False),
        ({"unit": "a", "unit_trials": 2, "unit_successes": True}, False),
        ({"unit": "a", "unit_trials": 0}, False),
        ({"unit": None, "unit_trials": 1}, False),
        ({"unit": 5, "unit_trials": 1}, False),
        ({"unit": "a", "unit_trials": 1, "max_attempts_per_unit": "2"}, False),
        ({"max_attempts_per_unit": 1.5}, False),
        ({"unit_trials": -1}, False),
        ({"restarts": -1}, False),
        ({"observations": -1}, False),
        ({"observations": 0.0}, False),
        ({"log_wealth": [float("nan")] * 8}, False),
        ({"log_wealth": [0.0] * 9}, False),
        ({"log_max_e_value": "much"}, False),
    ],
)
def test_the_entries_of_a_state_have_to_agree(change: dict[str, object], fits: bool) -> None:
    content = {**DriftMonitor(0.9).as_dict(), **change}
    if fits:
        monitor = DriftMonitor.from_dict(content, "m.json")
        assert monitor.as_dict() == content
    else:
        with pytest.raises(FormatError, match="is not a complete monitor state"):
            DriftMonitor.from_dict(content, "m.json")


@pytest.mark.parametrize("name", ["rate", "alpha"])
@pytest.mark.parametrize("value", [0.0, 1.0, -0.5, 1.5])
def test_rate_and_alpha_are_above_0_and_below_1(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"a monitor's {name} should be above 0 and below 1"):
        DriftMonitor(**{"rate": 0.9, name: value})
    assert DriftMonitor(0.9, max_attempts_per_unit=1).max_attempts_per_unit == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"unit": 3}, "unit should be text or null"),
        ({"unit": None, "unit_trials": 2}, "unit None cannot have 2 unit_trials"),
        ({"unit": "scene", "unit_trials": 0}, "unit 'scene' cannot have 0 unit_trials"),
    ],
)
def test_entries_on_the_open_unit_that_contradict_each_other(
    tmp_path: Path, change: dict[str, object], says: str
) -> None:
    path = tmp_path / "m.json"
    write_artefact(path, {**DriftMonitor(0.9).as_dict(), **change})
    with pytest.raises(FormatError, match=says):
        DriftMonitor.load(path)
