"""What a node of a Ray cluster runs: a check of its versions, and batches of trials.

Ray sends this module's code to the nodes, so that one without graspcast, or with another version,
can say so. It therefore imports nothing but the standard library before it has checked.
"""

from __future__ import annotations

from typing import Any

__all__ = ["look", "run"]

_kept: dict[str, Any] = {}
"""The setup of the batch before, as it was sent and as it is."""


def look(expected: dict[str, str]) -> dict[str, str]:
    """Return what differs on this node, by package: its version, or why it cannot be imported.

    Parameters
    ----------
    expected
        Versions by package.
    """
    import importlib

    different = {}
    for package, version in expected.items():
        try:
            found = str(importlib.import_module(package).__version__)
        except ImportError as error:
            absent = isinstance(error, ModuleNotFoundError) and error.name == package
            found = "" if absent else f"cannot be imported ({error})"
        except Exception as error:
            found = f"cannot be imported ({error})"
        if found != version:
            different[package] = found
    return different


def run(expected: dict[str, str], setup: bytes, batch: bytes) -> tuple[str, Any, dict[str, str]]:
    """Run a batch; return this node's address, the outcomes, or None and what differs here.

    Parameters
    ----------
    expected
        As for :func:`look`.
    setup, batch
        The pickled trial setup and batch.
    """
    import pickle

    import ray

    node = str(ray.util.get_node_ip_address())  # type: ignore[no-untyped-call]
    if different := look(expected):
        return node, None, different
    from graspcast.simulation.campaign.jobs import run_batch

    if _kept.get("sent") != setup:
        _kept.update(sent=setup, setup=pickle.loads(setup))
    return node, run_batch(_kept["setup"], pickle.loads(batch)), {}
