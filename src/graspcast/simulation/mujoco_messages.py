"""Compilation of MuJoCo models, with its errors and warnings in our words."""

from __future__ import annotations

import logging
import warnings
from typing import Any

from graspcast.errors import InputError

__all__ = ["compile_spec", "quiet_mujoco"]

_log = logging.getLogger(__name__)


def _ignore(message: str) -> None:
    """Ignore MuJoCo's warnings of instability, which is an outcome of a trial."""


def quiet_mujoco() -> None:
    """Keep MuJoCo from writing warnings to a log file in the working directory."""
    from graspcast.simulation.engine import mujoco

    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_ignore)


def compile_spec(spec: Any, what: str, remarks: list[str] | None = None) -> Any:
    """Compile an ``MjSpec``.

    Parameters
    ----------
    spec
        The specification.
    what
        What it describes, as the start of an error's message.
    remarks
        MuJoCo's warnings are appended to it; they are logged at level INFO in any case.

    Raises
    ------
    InputError
        If MuJoCo does not compile it.
    """
    from graspcast.simulation.engine import avoid_wrong_factors

    quiet_mujoco()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            return avoid_wrong_factors(spec.compile())
        except (ValueError, TypeError, RuntimeError) as error:
            raise InputError(f"{what} does not compile: {one_line(error)}") from error
        finally:
            for warning in caught:
                _log.info("%s: %s", what, one_line(warning.message))
                if remarks is not None:
                    remarks.append(one_line(warning.message))


def one_line(message: object) -> str:
    """Return a message of MuJoCo, which may have several lines, as one."""
    return "; ".join(line.strip() for line in str(message).splitlines() if line.strip())
