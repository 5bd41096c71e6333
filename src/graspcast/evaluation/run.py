"""All forecasts of a comparison, kept as they come, so that a long run can be gone on with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from graspcast._version import __version__
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.protocols import Method, forecast

__all__ = ["forecast_all"]


def forecast_all(
    benchmark: Benchmark,
    methods: Mapping[str, Method],
    protocols: Iterable[str],
    *,
    work: Path | None = None,
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
) -> list[Forecasts]:
    """The forecasts of every method under every protocol, for every principal and gripper.

    Parameters
    ----------
    benchmark
        The data.
    methods
        Name to method. Its ``repr`` has to state its settings.
    protocols
        Names of protocols.
    work
        Where each method's forecasts are kept, as
        ``<protocol>/<method>/<principal>-<gripper>.npz``. What is there is taken if it comes from
        the same data, seed, settings and version of graspcast; a change of a method's *code* is not
        noticed.
    seed
        Of how scenes are dealt out, and of the tasks.
    progress
        Called with the share of the work that is done, and what is being worked on.

    Raises
    ------
    FormatError
        For a file in ``work`` that is none of forecasts.
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
        words = f"{protocol.replace('_', ' ')}: {name}, {principal}, {gripper}"

        def step(share: float, i: int = i, words: str = words) -> None:
            if progress is not None:
                progress((i + share) / len(jobs), words)

        step(0.0)
        path = work / protocol / name / f"{principal}-{gripper}.npz" if work is not None else None
        where = (protocol, name, principal, gripper)
        own = protocol == "unseen_object_simulated" or getattr(methods[name], "simulates", False)
        configuration = " ".join(
            [
                digests.get(own, ""),
                *where,
                f"seed={seed}",
                repr(methods[name]),
                f"graspcast={__version__}",
            ]
        )
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
