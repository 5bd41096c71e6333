"""What was judged, and by what."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from graspcast.forecasting.model_card import ModelCard
from graspcast.io.hashing import sha256_of_file
from graspcast.report.content import Table
from graspcast.report.provenance import provenance_section
from graspcast.report.run_data import RunData
from report.test_forecast_quality import a_certificate


def card() -> ModelCard:
    return ModelCard(
        principal="a",
        supporters=("b",),
        gripper="parallel",
        objects=("d-1",),
        method="blend",
        features="full",
        settings={"seed": 7},
        samples=10,
        success_rate=0.5,
        data="0" * 64,
        versions={"graspcast": "0"},
        scenes=tuple(f"d/{k}" for k in range(1, 12)),
        warnings=("few outcomes",),
    )


def cells(table: Table) -> dict[str, str]:
    return {row[0].text: row[1].text for row in table.rows}


def test_files_have_digests_and_no_place_of_this_machine(run: RunData) -> None:
    tables = {table.key: table for table in provenance_section(run).tables}
    assert run.files.directory is not None
    _, rows = tables["files"].data or ((), ())
    digests = {row[1]: row[3] for row in rows}
    path = run.files.directory / "verdicts1.csv"
    assert digests["verdicts1.csv"] == sha256_of_file(path)
    assert not any(str(run.files.directory) in str(row) for t in tables.values() for row in t.rows)
    assert [row[0].text for row in tables["estimates"].rows] == ["a", "fused2"]
    assert tables["trials"].rows[0][3].text == "not stated"


def test_models_certificates_and_commands(run: RunData) -> None:
    certificate = a_certificate()
    more = replace(
        run,
        cards={Path("model.npz"): card()},
        certificates={Path("c.json"): certificate},
        commands="graspcast predict\n",
    )
    section = provenance_section(more)
    tables = {table.key: table for table in section.tables}
    told = cells(tables["model-1"])
    assert told["supporters"] == "b" and told["settings, with seed"] == "seed 7"
    assert told["training scenes"].endswith("and 5 more") and told["warnings"] == "few outcomes"
    assert told["digest of the model"] == card().digest
    (row,) = tables["certificates"].rows
    assert row[-1].text == "no, of another model" and row[2].text == "0.600"
    assert section.code == "graspcast predict"
