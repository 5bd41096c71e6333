"""Answers as records of the attempt log."""

from __future__ import annotations

from collections.abc import Mapping

from graspcast.attempt_log.records import DecisionRecord, FrameRecord
from graspcast.runtime.answer import Answer
from graspcast.runtime.frame import Frame

__all__ = ["frame_record"]


def frame_record(
    frame: Frame,
    answer: Answer,
    *,
    digests: tuple[str, str | None],
    others: Mapping[str, tuple[str, str | None]],
    source: str,
) -> FrameRecord:
    """Return what the log keeps of an answered frame.

    Parameters
    ----------
    frame, answer
        What was seen and decided.
    digests
        Of the model and of its certificate.
    others
        Decision's id to these, where a further model decided.
    source
        Who writes.
    """
    decisions = []
    for d in answer.decisions:
        model, certificate = others.get(d.id, (None, None))
        decisions.append(
            DecisionRecord(
                id=d.id,
                instance=d.instance,
                object_name=d.object_name,
                action=d.action,
                probability=d.probability,
                threshold=d.threshold,
                guarantee=d.guarantee,
                reason=d.reason,
                guide=d.guide,
                cam_T_obj=d.cam_T_obj,
                world_T_obj=d.world_T_obj,
                gripper=d.gripper,
                grasp=d.grasp,
                views=d.views,
                looks=d.looks,
                model=model,
                certificate=certificate,
            )
        )
    estimates = {
        name: [(e.object_name, e.cam_T_obj, e.score) for e in given]
        for name, given in frame.estimates.items()
    }
    return FrameRecord(
        episode=answer.episode,
        look=answer.look,
        estimates=estimates,
        decisions=decisions,
        world_T_cam=frame.world_T_cam,
        K=frame.K,
        model=digests[0],
        certificate=digests[1],
        source=source,
    )
