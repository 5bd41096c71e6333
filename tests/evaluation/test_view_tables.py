"""Markdown of the evaluation with several views."""

from __future__ import annotations

from graspcast.evaluation.view_tables import render_views

CERTIFICATE = {"gripper": "p", "guide": "best", "views": 1, "n": 5, "none": 1.0, "false": 0.0}


def test_what_is_undefined_is_a_dash() -> None:
    rates = {"attempted": 0.0, "of_perfect": 0.0, "success": None}
    policy = {"attempts": 0.0, "attempts_interval": None, "success": None, "looks": 1.0}
    policy |= {"success_interval": None, "looks_interval": [1.0, 1.0]}
    mine = {
        "description": "said",
        "scores": {"3 views": {}},
        "threshold": 0.8,
        "policies": {"single view": {"p": {"n": 5.0, "one look": policy}}},
        "certificates": [{**CERTIFICATE, **rates}],
    }
    text = render_views({"several_views": mine})
    cells = [[c.strip() for c in line.split("|")[1:-1]] for line in text.splitlines()]
    assert ["one look", "0.000", "-", "1.000 [1.000, 1.000]"] in cells
    assert ["p, best, one view", "5", "1.000", "0.000", "0.000", "0.000", "-"] in cells
