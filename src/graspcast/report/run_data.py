"""Data of a run: its files, read; what cannot be read or joined is said, and left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any, TypeVar

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import FormatError, GraspcastError, InputError
from graspcast.estimates.directories import named_directories, open_directories
from graspcast.estimates.loading import Inputs, load_inputs
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.model_card import ModelCard
from graspcast.guarantees.certificate import Certificate
from graspcast.io.json import read_json
from graspcast.io.reading import MAX_TEXT_BYTES, read_text
from graspcast.report.decisions import Decisions, decide_on
from graspcast.report.looks import LookRows, read_looks
from graspcast.report.run_files import RunFiles
from graspcast.report.trials import Trials, read_trials

__all__ = ["RunData", "read_run"]

T = TypeVar("T")
_MOST_LETTERS = 20_000
_TOLERANCE = ("object", "gripper", "grasp", "at_true_pose", "reaches", "scale")


@dataclass(frozen=True, eq=False)
class RunData:
    """What the files of a run hold.

    Attributes
    ----------
    files
        The files.
    trials
        Of each campaign or table of outcomes.
    decisions
        Verdicts with outcomes; None without verdicts.
    results, datasets
        Estimates by dataset and estimator, and BOP directories by dataset.
    cards
        Of each model.
    certificates, tolerances
        Of each file.
    commands
        Lines of commands.
    problems
        What could not be read or joined, in words.
    """

    files: RunFiles
    trials: tuple[Trials, ...] = ()
    decisions: Decisions | None = None
    results: Mapping[str, Mapping[str, Results]] = field(default_factory=dict)
    datasets: Mapping[str, BopDataset] = field(default_factory=dict)
    cards: Mapping[Path, ModelCard] = field(default_factory=dict)
    certificates: Mapping[Path, Certificate] = field(default_factory=dict)
    tolerances: Mapping[Path, Mapping[str, Any]] = field(default_factory=dict)
    commands: str = ""
    problems: tuple[str, ...] = ()

    @property
    def has_outcomes(self) -> bool:
        """Whether any verdict has an outcome."""
        return self.decisions is not None and bool(
            self.decisions.table["success"].is_not_null().any()
        )


def read_run(files: RunFiles, *, sensor: str | None = None, given: Sequence[str] = ()) -> RunData:
    """Read the files of a run.

    Parameters
    ----------
    files
        The files.
    sensor
        The camera, where a BOP directory holds the images of several.
    given
        The kinds of files, as :class:`~graspcast.report.run_files.RunFiles` calls them, that were
        named one by one. What is wrong with these is an error; others are left out, with a problem.

    Raises
    ------
    InputError
        For a named file that is wrong, for verdicts that are wrong, and if there are neither
        verdicts nor trials.
    """
    problems: list[str] = []

    def each(kind: str, paths: Sequence[Path], read: Callable[[Path], T]) -> dict[Path, T]:
        return _read_each(paths, read, problems, strict=kind in given)

    commands = () if files.commands is None else (files.commands,)
    trials = tuple(each("outcomes", files.outcomes, read_trials).values())
    looks = read_looks(files.verdicts, files.stages)
    if not looks and not any(len(one.table) for one in trials):
        told = "; ".join(problems) or "there are neither verdicts nor outcomes"
        raise InputError(
            f"{files.name}: there is nothing to report: {told}",
            parameters=("verdicts", "stages", "outcomes"),
        )
    inputs = _inputs(files, sensor, problems, strict=bool({"estimates", "bop"} & set(given)))
    decisions = _decisions(looks, trials, files, strict="outcomes" in given)
    if decisions is not None:
        problems += decisions.problems
    return RunData(
        files=files,
        trials=trials,
        decisions=decisions,
        results=inputs.results,
        datasets=inputs.datasets,
        cards=each("models", files.models, lambda path: Forecaster.load(path).card),
        certificates=each("certificates", files.certificates, Certificate.load),
        tolerances=each("tolerances", files.tolerances, _tolerance),
        commands="".join(each("commands", commands, _commands).values()),
        problems=tuple(dict.fromkeys([*problems, *inputs.notes])),
    )


def _read_each(
    paths: Sequence[Path], read: Callable[[Path], T], problems: list[str], *, strict: bool
) -> dict[Path, T]:
    out = {}
    for path in paths:
        try:
            out[path] = read(path)
        except GraspcastError as error:
            if strict:
                raise
            problems.append(f"left out, {error}")
    return out


def _decisions(
    looks: Sequence[LookRows], trials: Sequence[Trials], files: RunFiles, *, strict: bool
) -> Decisions | None:
    if not looks:
        return None
    found = decide_on(looks, trials, {path.name: path for _, path in files.estimates})
    if strict and found.problems:
        raise InputError("; ".join(found.problems), parameters=("outcomes",))
    if trials and not found.table["success"].is_not_null().any() and not found.problems:
        mine = found.table
        told = (
            f"{', '.join(str(one.path) for one in trials)}: no outcome is of any of the verdicts, "
            f"which are of {', '.join(mine['estimator'].unique().sort())} on "
            f"{', '.join(mine['dataset'].unique().sort())}, "
            f"{', '.join(mine['gripper'].unique().sort())} gripper: are they of other images, "
            "estimators, grippers or grasps?"
        )
        if strict:
            raise InputError(told, parameters=("outcomes", "verdicts"))
        found = replace(found, problems=(told,))
    return found


def _inputs(files: RunFiles, sensor: str | None, problems: list[str], *, strict: bool) -> Inputs:
    """Return estimates and datasets; where the estimates are wrong, the datasets alone."""
    bop, truth = list(files.bop), list(files.ground_truth)
    try:
        if files.estimates:
            return load_inputs(
                list(files.estimates),
                bop=bop,
                ground_truth=truth,
                lenient=not strict,
                sensor=sensor,
                without_models=True,
            )
        return Inputs(open_directories(named_directories(bop, truth), (), sensor), {})
    except GraspcastError as error:
        if strict:
            raise
        problems.append(f"left out the estimates and images: {error}")
        return Inputs({}, {})


def _commands(path: Path) -> str:
    """Read recorded commands; of a long file the beginning."""
    text = read_text(path, MAX_TEXT_BYTES)
    return text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]}\n..."


def _check_bounds(bounds: Mapping[str, Any]) -> None:
    """Raise a ValueError unless a value and its interval are finite and not negative."""
    values = [float(bounds[end]) for end in ("value", "low", "high")]
    if not all(0 <= value < inf for value in values):
        raise ValueError(f"{values} are no sizes of errors")


def _tolerance(path: Path) -> dict[str, Any]:
    """Read what ``tolerance --json`` wrote."""
    content: dict[str, Any] = read_json(path, dict)
    if lacking := [key for key in _TOLERANCE if key not in content]:
        raise FormatError(path, f"is no tolerance: it has no {', '.join(lacking)}")
    try:
        for reach in content["reaches"]:
            _check_bounds(reach["success_90"])
            _check_bounds(reach["success_50"])
            str(reach["kind"]), str(reach["axis"]), int(reach["sign"])
        _check_bounds(content["scale"])
        int(content["at_true_pose"]["held"]), int(content["at_true_pose"]["of"])
        if {r["kind"] for r in content["reaches"]} != {"shift", "turn"}:
            raise ValueError("its reaches are not shifts and turns")
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(path, f"is no complete tolerance ({error!r}); measure again") from error
    return content
