"""The document that shows the paper's figures beside ours."""

from __future__ import annotations

import copy
from typing import Any

from graspcast.paper.configurations import CONFIGURATIONS, PROTOCOLS
from graspcast.paper.dataset import GRIPPERS, OBJECTS
from graspcast.paper.render import render
from graspcast.paper.tables import paper_tables


def found_as_printed() -> dict[str, Any]:
    """What a reproduction would return if it met the paper in every figure."""
    paper = paper_tables()

    def averages(printed: dict[str, Any]) -> dict[str, Any]:
        return copy.deepcopy(printed["average"]) | {"by_principal": printed}

    table3: dict[str, Any] = {"baseline": {"fitted": averages(paper["table3"]["baseline"])}}
    for method in CONFIGURATIONS:
        table3[method] = {p: averages(paper["table3"][method]) for p in PROTOCOLS}
    return {
        "table1": paper["table1"],
        "table2": paper["table2"],
        "table3": table3,
        "baseline": {"add": "from the object models"},
        "majority": {"parallel": 0.755, "underactuated": 0.808},
        "seeds": 1,
        "seconds": 12.3,
    }


def lines_of(text: str, heading: str) -> list[str]:
    """The table's lines below a heading."""
    section = text.split(heading)[1].split("\n## ")[0]
    return [line for line in section.splitlines() if line.startswith("|")]


def test_every_figure_stands_beside_the_papers() -> None:
    text = render(found_as_printed())
    one = lines_of(text, "## Table I:")
    assert len(one) == 2 + 15
    for line, title in zip(one[2:], OBJECTS.values(), strict=True):
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        assert cells[0] == title
        assert len(cells) == 1 + 3 * 6
        dash = title == "Egg carton"
        for i in range(1, len(cells), 3):
            paper, ours, difference = cells[i : i + 3]
            assert paper == ours
            parallel = (i // 3) % 2 == 0
            assert difference == ("-" if dash and parallel else "+0.000")
    assert len(lines_of(text, "## Table II:")) == 2 + 6
    three = lines_of(text, "## Table III:")
    assert [line.split("|")[1].strip() for line in three[2:]] == [
        "baseline (fitted)",
        *(f"{name} (paper)" for name in CONFIGURATIONS),
    ]
    assert all(line.count("+0.000") == 8 for line in three[2:])


def test_a_difference_has_its_sign() -> None:
    found = found_as_printed()
    found["table1"]["lmo-1"]["epos"]["parallel"] -= 0.0104
    found["table3"]["MLP"]["paper"]["parallel"] += 0.0104
    text = render(found)
    (ape,) = (line for line in lines_of(text, "## Table I:") if "Ape" in line)
    assert "-0.010" in ape
    (mlp,) = (line for line in lines_of(text, "## Table III:") if "MLP (paper)" in line)
    assert "+0.010" in mlp


def test_every_figure_of_a_network_has_its_protocol() -> None:
    found = found_as_printed()
    for i, protocol in enumerate(PROTOCOLS):
        for j, method in enumerate(CONFIGURATIONS):
            averages = found["table3"][method][protocol]
            averages |= {"parallel": 0.1 * i + 0.01 * j, "underactuated": 0.5 + 0.1 * i + 0.01 * j}
    by_protocol = lines_of(render(found), "## Table III without selection")
    header = [cell.strip() for cell in by_protocol[0].strip("|").split("|")]
    assert header == ["Method", *(f"{p} {g[:3]}." for p in PROTOCOLS for g in GRIPPERS)]
    rows = {}
    for line in by_protocol[2:]:
        name, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        rows[name] = dict(zip(header[1:], cells, strict=True))
    assert list(rows) == ["baseline", *CONFIGURATIONS, "majority"]
    for j, method in enumerate(CONFIGURATIONS):
        for i, protocol in enumerate(PROTOCOLS):
            assert rows[method][f"{protocol} par."] == f"{0.1 * i + 0.01 * j:.3f}"
            assert rows[method][f"{protocol} und."] == f"{0.5 + 0.1 * i + 0.01 * j:.3f}"
    # Methods without checkpoints have no figure by the paper's protocol.
    for name in ("baseline", "majority"):
        assert rows[name]["paper par."] == rows[name]["paper und."] == "-"
        assert rows[name]["last par."] == rows[name]["validated par."] != "-"
    assert rows["majority"]["last und."] == "0.808"


def test_the_words_that_must_be_there() -> None:
    found = found_as_printed() | {"seeds": 5}
    cell = {"released": 0.8, "meshes": 0.75}
    found["baseline"] = {
        "add": "as released",
        "meshes": {"parallel": 0.795, "underactuated": 0.858},
        "deviating_cells": {"zebrapose/ycbv-3/parallel": cell},
    }
    text = render(found)
    for word in (
        "`paper`",
        "`last`",
        "`validated`",
        "test set",
        "mean of 5 seeds",
        "cells deviate",
    ):
        assert word in text, word
    for method in ("baseline", *CONFIGURATIONS):
        assert f"| {method} " in text
    assert "zebrapose/ycbv-3/parallel" in text
    assert "0.795 / 0.858" in text
    assert "mean of 1 seed," in render(found | {"seeds": 1})
