"""Visibility: one estimator's pose of one instance, in one image, to the probability of success.

Where there is neither another estimator nor another view, nothing tells how far off the pose is.
What remains is how well the object can be seen: from which side and how far away it is, by the pose
itself; the estimator's score; and, where the image is at hand, how well the projected model fits it
(:mod:`graspcast.rendering.image_fit`). Such a forecast is much weaker than that of a consensus, and
adds nothing to one.

A model has up to four forests, since score and image fit are not always there: each row is answered
by the forest that uses all that the row has, and :meth:`Visibility.rests_on` says by which. Each is
calibrated by out-of-fold predictions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.features import Features
from graspcast.forecasting.models.calibration import calibrated, fit_calibration
from graspcast.forecasting.models.encoding import one_hot_numbers
from graspcast.forecasting.models.forest import Forest, grow_forest
from graspcast.forecasting.models.held_out_choice import choice_from, choose_held_out
from graspcast.forecasting.models.out_of_fold import OutOfFold
from graspcast.forecasting.models.visibility_settings import VisibilitySettings
from graspcast.forecasting.splits import fold_numbers
from graspcast.forecasting.visibility_features import POSE_COLUMNS, SCORE_COLUMN
from graspcast.io.progress import Progress, step_of

__all__ = ["Visibility"]

_PARTS = {
    "pose": "the pose",
    "score": "the pose and its score",
    "fit": "the pose and the image",
    "score_fit": "the pose, its score and the image",
}
"""What a part uses besides the object, from the least to the most."""
_OWN = len(POSE_COLUMNS)
_FEWEST = 20
"""Outcomes below which a part that needs more than the pose is left out."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A forest that uses some of the columns, and its calibration.

    Attributes
    ----------
    forest
        From columns and object to success.
    tried
        Which objects it has seen outcomes of, (objects,).
    calibration
        Slope and intercept on the log-odds.
    """

    forest: Forest
    tried: Bool[ndarray, " o"]
    calibration: Float[ndarray, "2"]

    def raw(
        self, columns: Float[ndarray, "n c"], numbers: Int[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """Forecast without calibration."""
        which = one_hot_numbers(numbers, len(self.tried))
        return self.forest.mean(np.concatenate([columns, which], axis=1))

    def calibrated(self, raw: Float[ndarray, " n"]) -> Float[ndarray, " n"]:
        """Calibrate what :meth:`raw` forecasts."""
        return calibrated(raw, self.calibration)


@dataclass(frozen=True, eq=False)
class Visibility:
    """A calibrated model of success by one estimator's own pose, its score and the image.

    Attributes
    ----------
    names
        Names of the columns: :data:`POSE_COLUMNS`, :data:`SCORE_COLUMN`, and those of image fit, if
        there was any in training.
    parts
        Forests by what they use: ``pose``, ``score``, ``fit``, ``score_fit``; ``pose`` is always
        there.
    out_of_fold
        The out-of-fold predictions, each by the part that knows most, or None without calibration.
    choice
        As of :class:`graspcast.forecasting.models.blend.Blend`.
    """

    names: tuple[str, ...]
    parts: Mapping[str, _Part]
    out_of_fold: OutOfFold | None = None
    choice: Float[ndarray, "2"] | None = None

    @classmethod
    def fit(
        cls,
        features: Features,
        success: Float[ndarray, " n"],
        numbers: Int[ndarray, " n"],
        groups: ndarray,
        images: ndarray,
        *,
        objects: int,
        grasps: int = 1,
        settings: VisibilitySettings | None = None,
        progress: Progress | None = None,
    ) -> Visibility:
        """Train on instances with outcomes, and calibrate by out-of-fold predictions.

        A part is left out where fewer than twenty outcomes have what it needs, or all of them are
        equal, or the score is the same throughout.

        Parameters
        ----------
        features
            As :func:`graspcast.forecasting.visibility_features.visibility_features` returns them.
        success
            1, 0, or NaN where not tried, (n,).
        numbers
            Each instance's object number, -1 for one that is not to be learned, (n,).
        groups
            Each instance's scene or block of frames
            (:func:`graspcast.estimates.instances.scene_groups`), (n,).
        images
            Each instance's image, ``dataset/scene/image``, (n,).
        objects
            Number of objects; with several grasps, of targets
            (:mod:`graspcast.forecasting.models.targets`).
        grasps
            Names of grasps: the rows are as many blocks of the same instances.
        settings
            Of the forests.
        progress
            Called with the share of the work that is done and a message.

        Raises
        ------
        InputError
            Without both successes and failures.
        """
        settings = settings or VisibilitySettings()
        rows = features.values
        tried = ~np.isnan(success) & (numbers >= 0) & _has(rows, slice(0, _OWN))
        if len(np.unique(success[tried])) < 2:
            raise InputError(
                f"{int(tried.sum())} outcomes, all of them equal or none, are too few to learn "
                "from: give both successes and failures",
                parameters=("outcomes",),
            )
        wanted = {}
        for name in _PARTS:
            columns = _columns(name, rows.shape[1])
            usable = tried & _has(rows, columns)
            if name == "pose" or _can_learn(rows[usable], success[usable], name):
                wanted[name] = (columns, usable)
        fold_of = fold_numbers(groups, max(1, settings.folds), seed=settings.seed)
        parts, best = {}, np.full(len(rows), np.nan)
        for done, (name, (columns, usable)) in enumerate(wanted.items()):
            step = step_of(progress, done, len(wanted), "growing forests")
            data = (rows[:, columns], success, numbers, objects)
            part = _grow(*data, usable, settings)
            held_out = _out_of_fold(*data, usable, settings, fold_of, step)
            part = replace(part, calibration=fit_calibration(held_out, success))
            known = ~np.isnan(held_out)
            best[known] = part.calibrated(held_out[known])
            parts[name] = part
        found = choose_held_out(best.reshape(grasps, -1), success.reshape(grasps, -1))
        out_of_fold = OutOfFold(found.probability, found.success, np.asarray(images)[found.rows])
        kept = out_of_fold if len(found.rows) else None
        return cls(features.names, parts, kept, found.choice)

    @property
    def uses_image(self) -> bool:
        """Whether images make a difference."""
        return bool({"fit", "score_fit"} & set(self.parts))

    @property
    def most(self) -> str:
        """What a forecast rests on where everything is known, besides the object, in words."""
        return _PARTS[list(self.parts)[-1]]

    @property
    def tried(self) -> Bool[ndarray, " o"]:
        """Which objects have outcomes, and so can be forecast, (objects,)."""
        return self.parts["pose"].tried

    def probability(
        self, features: Float[ndarray, "n d"], objects: Int[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success of each row.

        Parameters
        ----------
        features
            Columns as in :attr:`names`, NaN where score or image fit are not known; those of image
            fit may be left out, (n, d).
        objects
            Object numbers, (n,).

        Returns
        -------
            NaN where the pose is not finite, (n,).

        Raises
        ------
        MismatchError
            For an object without outcomes in training, or other columns than in training.
        """
        rows = self._checked(features, objects)
        out = np.full(len(rows), np.nan)
        answering = self._answering(rows, objects)
        for i, (name, part) in enumerate(self.parts.items()):
            mine = np.flatnonzero(answering == i)
            if len(mine):
                columns = rows[mine][:, _columns(name, rows.shape[1])]
                out[mine] = part.calibrated(part.raw(columns, objects[mine]))
        return out

    def rests_on(
        self, features: Float[ndarray, "n d"], objects: Int[ndarray, " n"]
    ) -> tuple[str, ...]:
        """Say in words what the forecast of each row rests on; as :meth:`probability`.

        For example ``the pose and its score``; an empty text where there is no forecast.
        """
        rows = self._checked(features, objects)
        words = [*(_PARTS[name] for name in self.parts), ""]
        return tuple(words[i] for i in self._answering(rows, objects).tolist())

    def _checked(
        self, features: Float[ndarray, "n d"], objects: Int[ndarray, " n"]
    ) -> Float[ndarray, "n every"]:
        """Return rows of all columns; raise for other columns, or objects that are not known."""
        width = features.shape[1]
        if width not in (len(self.names), _OWN + 1):
            raise MismatchError(
                f"this model takes the {len(self.names)} columns {', '.join(self.names)}, or the "
                f"first {_OWN + 1} of them without images, not {width}"
            )
        if not np.isin(objects, np.flatnonzero(self.tried)).all():
            raise MismatchError(
                "one estimator's single view cannot forecast an object without outcomes in "
                "training; train with outcomes of the object",
                parameters=("outcomes", "objects"),
            )
        if width == len(self.names):
            return features
        missing = np.full((len(features), len(self.names) - width), np.nan)
        return np.concatenate([features, missing], axis=1)

    def _answering(
        self, rows: Float[ndarray, "n d"], objects: Int[ndarray, " n"]
    ) -> Int[ndarray, " n"]:
        """Return which part answers each row, -1 for none: the last that has all it needs."""
        out = np.full(len(rows), -1)
        for i, (name, part) in enumerate(self.parts.items()):
            able = _has(rows, _columns(name, rows.shape[1])) & part.tried[objects]
            out[able] = i
        return out

    def to_arrays(self) -> dict[str, ndarray]:
        """Return everything learned as named arrays."""
        out = {"names": np.array(self.names)}
        for name, part in self.parts.items():
            out |= part.forest.to_arrays(name)
            out |= {f"{name}/tried": part.tried, f"{name}/calibration": part.calibration}
        if self.choice is not None:
            out["choice"] = self.choice
        return out | (self.out_of_fold.to_arrays() if self.out_of_fold is not None else {})

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Visibility:
        """Restore what :meth:`to_arrays` returned; raise a ValueError if it is no model."""
        given = arrays["names"]
        if given.ndim != 1 or given.dtype.kind != "U":
            raise ValueError("the names of the columns are not a list of names")
        names = tuple(given.tolist())
        if names[: _OWN + 1] != (*POSE_COLUMNS, SCORE_COLUMN) or len(set(names)) != len(names):
            raise ValueError("the columns are not those of a visibility model")
        parts = {}
        for name in _PARTS:
            if f"{name}/roots" in arrays:
                if "fit" in name and len(names) == _OWN + 1:
                    raise ValueError("a part needs image fit, of which there are no columns")
                parts[name] = _part(arrays, name, len(_columns(name, len(names))))
        if "pose" not in parts:
            raise ValueError("the part that needs the pose alone is missing")
        if len({len(part.tried) for part in parts.values()}) > 1:
            raise ValueError("the parts of the model know different numbers of objects")
        kept = OutOfFold.from_arrays(arrays) if "out_of_fold/image" in arrays else None
        return cls(names, parts, kept, choice_from(arrays, "choice"))


def _part(arrays: Mapping[str, ndarray], name: str, columns: int) -> _Part:
    """Restore one part; raise a ValueError if it is none."""
    tried, calibration = arrays[f"{name}/tried"], arrays[f"{name}/calibration"]
    if tried.ndim != 1 or tried.dtype != bool:
        raise ValueError("which objects were tried is not a list of yes and no")
    if calibration.shape != (2,) or calibration.dtype != np.float64:
        raise ValueError("a calibration is not a slope and an intercept")
    if not np.isfinite(calibration).all():
        raise ValueError("a calibration is not finite")
    forest = Forest.from_arrays(arrays, name)
    if forest.columns > columns + len(tried):
        raise ValueError("a forest needs columns that are none")
    if not ((forest.value >= 0) & (forest.value <= 1)).all():
        raise ValueError("a forest predicts other than probabilities")
    return _Part(forest, tried, calibration)


def _columns(part: str, width: int) -> Int[ndarray, " c"]:
    """Return the columns that a part uses of rows so wide."""
    fit = range(_OWN + 1, width) if "fit" in part else ()
    score = (_OWN,) if "score" in part else ()
    return np.array([*range(_OWN), *score, *fit], dtype=np.int64)


def _has(rows: Float[ndarray, "n d"], columns: Int[ndarray, " c"] | slice) -> Bool[ndarray, " n"]:
    """Find the rows in which all of some columns are known."""
    return np.asarray(np.isfinite(rows[:, columns]).all(axis=1))


def _can_learn(rows: Float[ndarray, "m d"], success: Float[ndarray, " m"], part: str) -> bool:
    """Whether a part has its columns and outcomes enough, and its score says anything."""
    varies = "score" not in part or len(np.unique(rows[:, _OWN])) > 1
    there = "fit" not in part or rows.shape[1] > _OWN + 1
    return there and varies and len(rows) >= _FEWEST and len(np.unique(success)) == 2


def _grow(
    columns: Float[ndarray, "n c"],
    success: Float[ndarray, " n"],
    numbers: Int[ndarray, " n"],
    objects: int,
    usable: Bool[ndarray, " n"],
    settings: VisibilitySettings,
) -> _Part:
    """Grow a forest from some rows, without calibration."""
    from sklearn.ensemble import ExtraTreesClassifier

    which = one_hot_numbers(numbers[usable], objects)
    inputs = np.concatenate([columns[usable], which], axis=1)
    model = ExtraTreesClassifier(
        settings.trees,
        min_samples_leaf=settings.min_samples_leaf,
        max_features=settings.max_features,
        random_state=settings.seed,
        n_jobs=-1,
    )
    forest = grow_forest(model, inputs, success[usable] == 1)
    tried = np.bincount(numbers[usable], minlength=objects) > 0
    return _Part(forest, tried, np.array([1.0, 0.0]))


def _out_of_fold(
    columns: Float[ndarray, "n c"],
    success: Float[ndarray, " n"],
    numbers: Int[ndarray, " n"],
    objects: int,
    usable: Bool[ndarray, " n"],
    settings: VisibilitySettings,
    fold_of: Int[ndarray, " n"],
    progress: Progress,
) -> Float[ndarray, " n"]:
    """Forecast rows by forests grown without their scenes; NaN where that cannot be."""
    out = np.full(len(columns), np.nan)
    folds = np.unique(fold_of)
    if len(folds) < 2:
        return out
    inner = replace(settings, trees=max(32, settings.trees // 2))
    for done, fold in enumerate(folds.tolist()):
        train = usable & (fold_of != fold)
        if len(np.unique(success[train])) == 2:
            part = _grow(columns, success, numbers, objects, train, inner)
            test = np.flatnonzero(usable & (fold_of == fold))
            test = test[part.tried[numbers[test]]]
            out[test] = part.raw(columns[test], numbers[test])
        progress((done + 1) / len(folds), "growing forests")
    return out
