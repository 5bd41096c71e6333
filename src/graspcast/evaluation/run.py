"""The forecasts of all methods under all protocols; an interrupted run can be resumed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from graspcast._version import __version__
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.protocols import Method, forecast
from graspcast.io.progress import Progress, step_of

__all__ = ["forecast_all"]


def forecast_all(
    benchmark: Benchmark,
    methods: Mapping[str, Method],
    protocols: Iterable[str],
    *,
    work: Path | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[Forecasts]:
    """Compute forecasts of each method under each protocol, for each principal and gripper.

    Parameters
    ----------
    benchmark
        The data.
    methods
        Name to method. Its ``repr`` has to state its settings.
    protocols
        Names of protocols.
    work
        Directory in which forecasts are saved, as
        ``<protocol>/<method>/<principal>-<gripper>.npz``. Saved forecasts are reused if they come
        from the same data, seed, settings and version of graspcast; a change of a method's *code*
        is not detected.
    seed
        Of the folds of scenes, and of the tasks.
    progress
        Called with the share of the work that is done and a message.

    Raises
    ------
    FormatError
        For a file in ``work`` that is not one of forecasts.
    InputError
        As :func:`graspcast.evaluation.protocols.forecast` does.
    """
    digests = {own: benchmark.digest(own_trials=own) for own in (False, True)} if work else {}
    jobs = [
        (protocol, name, principal, gripper)
        for protocol in protocols
        for principal, gripper in benchmark.pairs(simulated=protocol == "unseen_object_simulated")
        for name in methods
    ]
    out = []
    for i, (protocol, name, principal, gripper) in enumerate(jobs):
        message = f"{protocol.replace('_', ' ')}: {name}, {principal}, {gripper}"
        step = step_of(progress, i, len(jobs), message)
        step(0.0, "")
        path = work / protocol / name / f"{principal}-{gripper}.npz" if work is not None else None
        own = protocol == "unseen_object_simulated" or getattr(methods[name], "simulates", False)
        where = (protocol, name, principal, gripper)
        settings = (f"seed={seed}", repr(methods[name]), f"graspcast={__version__}")
        configuration = " ".join([digests.get(own, ""), *where, *settings])
        found = Forecasts.load(path, configuration) if path is not None else None
        if found is None:
            found = forecast(
                methods[name], name, benchmark, *(protocol, principal, gripper),
                seed=seed, progress=step,
            )  # fmt: skip
            if path is not None:
                found.save(path, configuration)
        out.append(found)
    return out
