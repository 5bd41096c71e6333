"""The policy that a certificate is of: who guides, which views serve, and how many looks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from graspcast.errors import MismatchError

__all__ = ["LookPolicy", "check_policy"]


@dataclass(frozen=True)
class LookPolicy:
    """What decides, beside the model and the threshold, which grasps are attempted.

    Attributes
    ----------
    guide
        An estimator's name, ``fused`` or ``best``.
    views
        Whether other images serve.
    max_looks
        Looks in all. 1: one verdict with the views that there are.
    max_views
        At most so many images in one verdict.
    views_from
        ``earlier`` images of the scene, or ``all``.
    min_parallax_deg
        Least angle between two views.
    translation_sd_m, rotation_sd_rad
        Noise of the camera motion, per axis.
    min_gain
        A further look is taken only if success is expected to be more probable by this much.
    """

    guide: str
    views: bool
    max_looks: int
    max_views: int
    views_from: str
    min_parallax_deg: float
    translation_sd_m: float
    rotation_sd_rad: float
    min_gain: float

    def __str__(self) -> str:
        if self.max_looks > 1:
            looks = f"up to {self.max_looks} looks"
        else:
            several = self.views and self.max_views > 1
            looks = f"up to {self.max_views} views" if several else "one view"
        return f"guide {self.guide}, {looks}"

    def differences(self, other: LookPolicy) -> dict[str, str]:
        """Say in which entries another policy differs: entry to words, this one's value first."""
        out = {}
        for name in (f.name for f in fields(self)):
            mine, theirs = getattr(self, name), getattr(other, name)
            same = mine == theirs
            if isinstance(mine, float):
                same = math.isclose(mine, theirs, rel_tol=1e-6, abs_tol=1e-9)
            if not same:
                out[name] = f"{name} is {_words(mine)}, not {_words(theirs)}"
        if "max_looks" in out and self.max_looks > 1 and other.max_looks > 1:
            out.pop("max_views", None)  # With several looks it follows from them.
        return out

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> LookPolicy:
        """Return the policy that :meth:`as_dict` described.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it describes none.
        """
        numbers = ("min_parallax_deg", "translation_sd_m", "rotation_sd_rad", "min_gain")
        given: dict[str, Any] = {f.name: content[f.name] for f in fields(cls)}
        given |= {name: float(given[name]) for name in numbers}
        for name in ("max_looks", "max_views"):
            if type(given[name]) is not int or given[name] < 1:
                raise ValueError(f"{name} is {given[name]!r}, not 1 or more")
        texts = given["guide"], given["views_from"]
        if not all(isinstance(text, str) for text in texts) or type(given["views"]) is not bool:
            raise ValueError("the policy does not hold what it should")
        return cls(**given)


def _words(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


_PARAMETERS = {
    "views": "camera_poses",
    "min_parallax_deg": "min_parallax",
    "translation_sd_m": "camera_noise",
    "rotation_sd_rad": "camera_noise",
}
"""Names of the parameters by which to mend what differs, where they are others."""


def check_policy(certified: LookPolicy | None, used: LookPolicy | None) -> None:
    """Check that the policy in use is the one that was certified; None is the principal's one view.

    Raises
    ------
    MismatchError
        Naming what differs.
    """
    if certified is None and used is None:
        return
    if certified is None or used is None:
        how = "one view, guided by the principal"
        raise MismatchError(
            f"the certificate is of {certified or how}, but the verdicts are of {used or how}: "
            "certify the policy that is used",
            parameters=("certificate", "camera_poses", "guide", "max_looks"),
        )
    if differing := certified.differences(used):
        names = dict.fromkeys(_PARAMETERS.get(name, name) for name in differing)
        raise MismatchError(
            "the certificate is of another policy than the verdicts, so what is attempted would "
            f"not be what was certified: in the certificate {'; '.join(differing.values())}",
            parameters=tuple(names),
        )
