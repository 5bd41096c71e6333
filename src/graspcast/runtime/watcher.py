"""The watcher: decisions on all estimates of a frame, look by look, from a model file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any
from uuid import uuid4

from graspcast.attempt_log.log import AttemptLog
from graspcast.attempt_log.records import FrameRecord, OutcomeRecord
from graspcast.bop.models import Models
from graspcast.demo_data import model_path
from graspcast.errors import GraspcastError, InputError, UnknownNameError
from graspcast.forecasting.fallbacks import Fallbacks, certificate_made_for
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.grasp_ranking import refuse_mask
from graspcast.forecasting.look_again import MIN_GAIN
from graspcast.forecasting.novelty import OOD_ALPHA
from graspcast.guarantees.certificate import Certificate
from graspcast.io.arguments import (
    FLAG,
    NAME,
    PATH,
    a,
    checked,
    mapping,
    number,
    refuse_unless,
    sequence,
)
from graspcast.io.wording import counted
from graspcast.runtime.answer import Answer, Decision
from graspcast.runtime.decisions import decision_of, without_pose
from graspcast.runtime.frame import Frame
from graspcast.runtime.judging import Judge
from graspcast.runtime.nothing_sane import left_out_notes, nothing_sane
from graspcast.runtime.panel import Judged, Panel
from graspcast.runtime.reach import check_reachable
from graspcast.runtime.recording import frame_record
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
        Where decisions and outcomes are kept (opened for writing); decisions are on disk before an
        answer is returned.
    source
        Who asks, for the log.
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
        log=a(AttemptLog),
        source=NAME,
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
        log: AttemptLog | None = None,
        source: str = "api",
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

        def certified(forecaster: Forecaster) -> Certificate | None:
            """Return its certificate; ``Episodes`` checks that it is of the policy."""
            return certificate_made_for(forecaster, certificates) if certificates else None

        judges = [Judge(f, models, certificate=certified(f), **options) for f in self.forecasters]
        self._panel, self._certified = Panel(judges), bool(certificates)
        self.gripper = self.forecasters[0].card.gripper
        every = (name for f in self.forecasters for name in f.card.estimators)
        self.estimators = tuple(dict.fromkeys(every))
        self._log, self._source = log, source
        self._scenes = Scenes(int(max_episodes), float(episode_ttl_s))

    @classmethod
    def load(cls, *paths: str | PathLike[str], **options: Any) -> Watcher:
        """Return a watcher by model files, the one with the most supporters and its fallbacks.

        Parameters
        ----------
        paths
            The files that :meth:`Forecaster.save` and ``graspcast train`` write; ``demo`` is the
            demonstration's, in the package (a file of that name is ``./demo``).
        **options
            As for :class:`Watcher`.

        Raises
        ------
        FormatError
            If a file is missing, damaged or not a model.
        InputError, MismatchError, UnknownNameError
            As :class:`Watcher`.
        """
        for path in paths:
            refuse_unless(PATH, path, "Watcher.load", "paths")
        return cls(*(Forecaster.load(model_path(path)) for path in paths), **options)

    def __repr__(self) -> str:
        card = self.forecasters[0].card
        return (
            f"Watcher({card.principal} with {', '.join(card.supporters) or 'no supporter'}; "
            f"{counted(len(self.forecasters), 'model')}, {counted(len(self._scenes), 'episode')})"
        )

    @property
    def episodes(self) -> int:
        """How many episodes are remembered."""
        return len(self._scenes)

    @property
    def records(self) -> bool:
        """Whether decisions and outcomes are kept in a log."""
        return self._log is not None

    @property
    def policies(self) -> list[dict[str, Any]]:
        """What each forecaster decides by (:attr:`Judge.policy`)."""
        return [judge.policy for judge in self._panel.judges]

    def warm_up(self) -> None:
        """Prepare, so that the first answer is as fast as later ones.

        Call it before threads are started, and before the process forks.
        """
        for judge in self._panel.judges:
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
                found = self._panel.further_look(scene, frame)
                answer, record = self._answer(episode, scene.next(), scene, frame, found)
                self._write([record])
            except GraspcastError:
                scene.running.clear()
                raise
            scene.add(frame)
            return answer

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
        found = self._panel.first_looks([frames[i] for i in good])
        scenes, records = {}, []
        for i, verdicts in zip(good, found, strict=True):
            if isinstance(verdicts, GraspcastError):
                out[i] = verdicts
                continue
            episode, scene = uuid4().hex, Scene([frames[i]])
            answer, record = self._answer(episode, 1, scene, frames[i], verdicts)
            out[i], scenes[i] = answer, (episode, scene)
            records.append(record)
        try:
            self._write(records)
        except GraspcastError as error:  # what is not in the log is not answered
            out = [error if i in scenes else answer for i, answer in enumerate(out)]
        else:
            for episode, scene in scenes.values():
                self._scenes.add(episode, scene)
        return [answer for answer in out if answer is not None]

    @checked(decision_id=NAME, success=FLAG, reason=NAME)
    def outcome(self, decision_id: str, success: bool, reason: str | None = None) -> None:
        """Write to the log what came of an attempt.

        Parameters
        ----------
        decision_id
            :attr:`Decision.id`.
        success
            Whether the grasp held.
        reason
            How it failed, or whatever else is to be known.

        Raises
        ------
        InputError
            If there is no log, or no such decision in it.
        MismatchError
            If the opposite was recorded before.
        """
        if self._log is None:
            raise InputError(
                "outcomes are kept in a log, and this watcher has none: give it one",
                parameters=("log",),
            )
        self._log.add_outcome(OutcomeRecord(decision_id, bool(success), reason))

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
        if frame.reachable is not None:
            if self._certified:
                refuse_mask(frame.reachable)
            check_reachable(frame.reachable, [f.card for f in self.forecasters])

    def _answer(
        self, episode: str, look: int, scene: Scene, frame: Frame, found: list[Judged]
    ) -> tuple[Answer, FrameRecord | None]:
        """Return the answer by the verdicts, and what the log keeps of it."""
        main, decisions, others = self._panel.judges[0], [], {}
        for dataset, verdict, judge in found:
            decision = decision_of(
                verdict,
                scene.number(dataset, verdict.instance),
                gripper=self.gripper,
                obj_T_grasp=judge.grasps_of(verdict.object_name),
            )
            decisions.append(decision)
            if judge is not main:
                others[decision.id] = judge.digests
        there = {each.verdict.object_name for each in found}
        lost = nothing_sane(frame, there, main.forecaster.card.diameters_of)
        decisions += [
            without_pose(name, reason, gripper=self.gripper, looks=look)
            for name, reason in lost.items()
        ]
        decisions.sort(key=lambda decision: (decision.instance < 0, decision.instance))
        notes = tuple(dict.fromkeys(self._notes(frame, decisions)))
        answer = Answer(episode, look, tuple(decisions), notes)
        if self._log is None:
            return answer, None
        record = frame_record(
            frame, answer, digests=main.digests, others=others, source=self._source
        )
        return answer, record

    def _notes(self, frame: Frame, decisions: Sequence[Decision]) -> Iterator[str]:
        """Say which estimators are not in the frame, and which attempts lack a gripper's pose."""
        card = self.forecasters[0].card
        silent = [name for name in card.estimators if not frame.estimates.get(name)]
        if silent:
            yield f"no estimate by {', '.join(silent)} in this frame"
        yield from left_out_notes(frame)
        for d in decisions:
            if d.attempt and d.cam_T_grasp is None:
                yield (
                    f"the model file does not carry the grasp {d.grasp} of {d.object_name} by "
                    f"{d.gripper}, so there is no pose of the gripper: train it again with the "
                    "grasps that the outcomes are of"
                )

    def _write(self, records: Sequence[FrameRecord | None]) -> None:
        if self._log is not None:
            self._log.add([record for record in records if record is not None])


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
