"""The gallery."""

from __future__ import annotations

from graspcast.report.gallery import gallery_section
from graspcast.report.pictures import Painter
from graspcast.report.run_data import RunData


def test_cases_without_pictures_keep_their_facts(run: RunData) -> None:
    seen: list[float] = []
    painter = Painter({}, run.trials)
    section = gallery_section(run, painter, 2, lambda share, _: seen.append(share))
    assert seen == sorted(seen) and 0 <= seen[0] <= seen[-1] < 1
    assert {mode.key for mode in section.modes} >= {"gallery", "abstained-held", "unusual"}
    case = next(m for m in section.modes if m.key == "abstained-held").cases[0]
    facts = dict(case.facts)
    assert case.title.startswith("Held: d-") and case.pictures == ()
    assert facts["outcome"] == "held" and facts["verdict"].startswith("abstain")
    assert facts["pose error"].endswith("°") and "<" in facts["why"]


def test_none_are_asked_for_or_there_are_no_outcomes(run: RunData) -> None:
    painter = Painter({}, run.trials)
    assert gallery_section(run, painter, 0).is_empty
    from dataclasses import replace

    assert gallery_section(replace(run, decisions=None), painter, 3).is_empty
