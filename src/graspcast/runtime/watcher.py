"""The watcher: decisions on all estimates of a frame, look by look, from a model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any
from uuid import uuid4

from graspcast.bop.models import Models
from graspcast.errors import GraspcastError, InputError, UnknownNameError
from graspcast.forecasting.episode_verdict import EpisodeVerdict
from graspcast.forecasting.fallbacks import Fallbacks, certificate_of
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.look_again import MIN_GAIN
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.guarantees.certificate import Certificate
from graspcast.io.arguments import NAME, a, checked, mapping, number, sequence
from graspcast.io.wording import counted
from graspcast.runtime.answer import Answer, Decision
from graspcast.runtime.decisions import decision_of, without_pose
from graspcast.runtime.frame import Frame
from graspcast.runtime.judging import Judge
from graspcast.runtime.nothing_sane import nothing_sane
from graspcast.runtime.scenes import Scene, Scenes
from graspcast.views.camera_motion import CameraNoise

__all__ = ["Watcher"]


class Watcher:
    """Decisions on all estimates of a frame: attempt, look again or abstain, and by which pose.

    ::

        watcher = Watcher.load("model.npz", threshold=0.8)
        watcher.warm_up()
        answer = watcher.judge(Frame({"epos": [Estimate("ycbv-5", cam_T_obj, 0.9)]}, world_T_cam))
        for decision in answer.attempts:
            held = grasp(decision.world_T_grasp)
            watcher.outcome(decision.id, held)

    Several threads may ask one watcher. The looks of one episode are taken one after another.

    Parameters
    ----------
    forecasters
        A trained forecaster; further ones, trained with fewer supporters, serve where a supporter
        has no estimate (:class:`~graspcast.forecasting.fallbacks.Fallbacks`).
    models
        Dataset's name to its object models; those in the model files if None.
    threshold, guide, max_looks, max_views, min_gain, noise, ood_alpha
        As for :class:`~graspcast.forecasting.episodes.Episodes`.
    certificate
        Of this policy, or one for each forecaster: its threshold and guarantee are used.
    log
        Where decisions and outcomes are kept; decisions are there before an answer is returned.
    max_episodes
        How many episodes are kept; the one not used for longest makes room for a new one.
    episode_ttl_s
        An episode that was not used for so many seconds has expired.

    Raises
    ------
    InputError, MismatchError, UnknownNameError
        As ``Fallbacks`` and ``Episodes``; and if neither the model files nor ``models`` have the
        sizes and points of the objects that a forecaster needs.
    """

    @checked(
        models=mapping(a(Models), "dataset"),
        threshold=number(),
        guide=NAME,
        max_looks=number(1.0, 1000.0),
        max_views=number(1.0, 1000.0),
        min_gain=number(0.0, 1.0),
        noise=a(CameraNoise),
        ood_alpha=number(0.0, 1.0),
        max_episodes=number(1.0, 1e7),
        episode_ttl_s=number(1e-3, 1e9),
    )
    def __init__(
        self,
        *forecasters: Forecaster,
        models: Mapping[str, Models] | None = None,
        threshold: float | None = None,
        certificate: Certificate | Sequence[Certificate] | None = None,
        guide: str | None = None,
        max_looks: int = 3,
        max_views: int = 3,
        min_gain: float = MIN_GAIN,
        noise: CameraNoise | None = None,
        ood_alpha: float = OOD_ALPHA,
        log: Any = None,
        max_episodes: int = 1000,
        episode_ttl_s: float = 3600.0,
    ):
        self.forecasters = tuple(Fallbacks(forecasters))
        options: dict[str, Any] = {
            "threshold": threshold,
            "guide": guide,
            "max_looks": max_looks,
            "max_views": max_views,
            "min_gain": min_gain,
            "noise": noise,
            "ood_alpha": ood_alpha,
        }
        certificates = _listed(certificate)
        self._judges = [
            Judge(f, models, certificate=_certificate(f, certificates, ood_alpha), **options)
            for f in self.forecasters
        ]
        self.gripper = self.forecasters[0].card.gripper
        every = (name for f in self.forecasters for name in f.card.estimators)
        self.estimators = tuple(dict.fromkeys(every))
        self._log = log
        self._scenes = Scenes(int(max_episodes), float(episode_ttl_s))

    @classmethod
    def load(cls, *paths: str | PathLike[str], **options: Any) -> Watcher:
        """Return a watcher by model files, the one with the most supporters and its fallbacks.

        Parameters
        ----------
        paths
            The files that :meth:`Forecaster.save` and ``graspcast train`` write.
        **options
            As for :class:`Watcher`.

        Raises
        ------
        FormatError
            If a file is missing, damaged or not a model.
        InputError, MismatchError, UnknownNameError
            As :class:`Watcher`.
        """
        return cls(*(Forecaster.load(path) for path in paths), **options)

    def __repr__(self) -> str:
        card = self.forecasters[0].card
        return (
            f"Watcher({card.principal} with {', '.join(card.supporters) or 'no supporter'}; "
            f"{counted(len(self.forecasters), 'model')}, {counted(len(self._scenes), 'episode')})"
        )

    def warm_up(self) -> None:
        """Prepare, so that the first answer is as fast as later ones.

        Call it before threads are started, and before the process forks.
        """
        for judge in self._judges:
            judge.warm_up()

    @checked(frame=a(Frame), episode=NAME)
    def judge(self, frame: Frame, episode: str | None = None) -> Answer:
        """Decide on every instance in a frame.

        Parameters
        ----------
        frame
            All that the estimators found in one image.
        episode
            The episode of which it is a further look (:attr:`Answer.episode`): the objects stand
            where they stood. None starts a new one.

        Raises
        ------
        UnknownNameError
            For an estimator that no model knows, or a reachable object or grasp likewise.
        UnknownEpisodeError
            For an episode that is not known any more, or never was.
        InputError, MismatchError
            As :meth:`Episodes.look`, for what cannot be right of the whole frame. The look then
            does not count.
        """
        if episode is None:
            answer = self.judge_all([frame])[0]
            if isinstance(answer, GraspcastError):
                raise answer
            return answer
        self._check(frame)
        scene = self._scenes.get(episode)
        with scene.lock:
            try:
                found = self._further(scene, frame)
                scene.add(frame)
                return self._answer(episode, scene, frame, found)
            except GraspcastError:
                scene.running.clear()
                raise

    @checked(frames=sequence(a(Frame)))
    def judge_all(self, frames: Sequence[Frame]) -> list[Answer | GraspcastError]:
        """Decide on the first looks at several scenes at once, which takes less time a frame.

        Parameters
        ----------
        frames
            One frame of each scene.

        Returns
        -------
        Each frame's answer, or the error that :meth:`judge` would raise, in order.
        """
        out: list[Answer | GraspcastError | None] = [None] * len(frames)
        good = []
        for i, frame in enumerate(frames):
            try:
                self._check(frame)
                good.append(i)
            except GraspcastError as error:
                out[i] = error
        found = self._first([frames[i] for i in good])
        for i, verdicts in zip(good, found, strict=True):
            if isinstance(verdicts, GraspcastError):
                out[i] = verdicts
                continue
            episode, scene = uuid4().hex, Scene([frames[i]])
            out[i] = self._answer(episode, scene, frames[i], verdicts)
            self._scenes.add(episode, scene)
        return [answer for answer in out if answer is not None]

    @checked(episode=NAME)
    def forget(self, episode: str) -> None:
        """Forget an episode, as when an object was moved.

        Raises
        ------
        UnknownEpisodeError
            If it is not known.
        """
        self._scenes.forget(episode)

    def _check(self, frame: Frame) -> None:
        """Raise for names that no model knows."""
        for name in frame.estimates:
            if name not in self.estimators:
                raise UnknownNameError(
                    "estimator", name, self.estimators, parameters=("estimates",)
                )
        named = frame.reachable if isinstance(frame.reachable, Mapping) else ()
        for name in named:
            if not any(name in f.card.objects for f in self.forecasters):
                known = self.forecasters[0].card.objects
                raise UnknownNameError("reachable object", name, known, parameters=("reachable",))

    def _first(
        self, frames: Sequence[Frame]
    ) -> list[list[tuple[str, EpisodeVerdict]] | GraspcastError]:
        """Judge first looks: verdicts with their datasets."""
        out: list[list[tuple[str, EpisodeVerdict]] | GraspcastError] = [[] for _ in frames]
        for dataset in sorted({name for frame in frames for name in frame.datasets}):
            rows = [i for i, frame in enumerate(frames) if dataset in frame.datasets]
            main = self._judges[0].first_looks([frames[i] for i in rows], dataset)
            for judge in self._judges[1:]:
                again = [j for j, found in enumerate(main) if _lacks(found, judge)]
                others = judge.first_looks([frames[rows[j]] for j in again], dataset)
                for j, other in zip(again, others, strict=True):
                    main[j] = _better(main[j], other)
            for i, found in zip(rows, main, strict=True):
                kept = out[i]
                if isinstance(kept, GraspcastError):
                    continue
                if isinstance(found, GraspcastError):
                    out[i] = found
                else:
                    kept += [(dataset, verdict) for verdict in found]
        return out

    def _further(self, scene: Scene, frame: Frame) -> list[tuple[str, EpisodeVerdict]]:
        """Judge a further look."""
        datasets = sorted({name for each in (*scene.frames, frame) for name in each.datasets})
        out = []
        for dataset in datasets:
            found: list[EpisodeVerdict] | GraspcastError = []
            for m, judge in enumerate(self._judges):
                if m and not _lacks(found, judge):
                    continue
                episodes = scene.running.get((m, dataset))
                if episodes is None or episodes.count < scene.count:
                    episodes = scene.running[m, dataset] = judge.replayed(dataset, scene.frames)
                other = judge.look(episodes, frame)
                found = _better(found, other) if m else other
            assert isinstance(found, list)
            out += [(dataset, verdict) for verdict in found]
        return out

    def _answer(
        self, episode: str, scene: Scene, frame: Frame, found: list[tuple[str, EpisodeVerdict]]
    ) -> Answer:
        """Return the answer by the verdicts, after it is logged."""
        decisions: list[Decision] = []
        judge = self._judges[0]
        for dataset, verdict in found:
            instance = scene.number(dataset, verdict.instance)
            poses = judge.grasps_of(verdict.object_name)
            decisions.append(
                decision_of(verdict, instance, gripper=self.gripper, obj_T_grasp=poses)
            )
        there = {verdict.object_name for _, verdict in found}
        sizes = judge.forecaster.card.diameters_of
        for name, reason in nothing_sane(frame, there, sizes).items():
            decisions.append(without_pose(name, reason, gripper=self.gripper, looks=scene.count))
        decisions.sort(key=lambda decision: (decision.instance < 0, decision.instance))
        return Answer(episode, scene.count, tuple(decisions))


def _listed(certificate: Any) -> list[Certificate]:
    if certificate is None:
        return []
    given = [certificate] if isinstance(certificate, Certificate) else certificate
    test, words = sequence(a(Certificate))
    if not test(given):
        raise InputError(
            f"Watcher: certificate should be a Certificate, or {words}",
            parameters=("certificate",),
        )
    return list(given)


def _certificate(
    forecaster: Forecaster, certificates: Sequence[Certificate], ood_alpha: float
) -> Certificate | None:
    """Return a forecaster's certificate; Episodes checks that it is of the policy."""
    if not certificates:
        return None
    card = forecaster.card
    for certificate in certificates:
        if certificate.provenance.get("model") == card.digest:
            return certificate
    return certificate_of(forecaster, certificates, ood_alpha)


def _lacks(found: list[EpisodeVerdict] | GraspcastError, judge: Judge) -> bool:
    """Return whether a further model may forecast what the models before it did not."""
    if isinstance(found, GraspcastError):
        return False
    known = judge.forecaster.card.objects
    return any(v.probability is None and v.object_name in known for v in found)


def _better(
    found: list[EpisodeVerdict] | GraspcastError, other: list[EpisodeVerdict] | GraspcastError
) -> list[EpisodeVerdict] | GraspcastError:
    """Return the verdicts with those of a further model where only that one has a forecast."""
    if isinstance(found, GraspcastError) or isinstance(other, GraspcastError):
        return found
    # All of one frame, so object and rank by score are enough.
    forecast = {v.row.key[3:]: v for v in other if v.row is not None and v.probability is not None}
    out = []
    for verdict in found:
        key = None if verdict.row is None else verdict.row.key[3:]
        better = forecast.get(key) if verdict.probability is None and key is not None else None
        out.append(verdict if better is None else replace(better, instance=verdict.instance))
    return out
