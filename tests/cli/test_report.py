"""The verb report."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refused
from graspcast.cli import main
from small_run import write_run


def test_a_run_and_files_one_by_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    run = write_run(tmp_path / "run")
    out = tmp_path / "r.html"
    assert main(["report", str(run), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    first = out.read_bytes()
    assert b"written 1970-01-02 00:00 UTC" in first
    assert main(["report", str(run), "--out", str(out)]) == 0
    assert out.read_bytes() == first
    files = [f"--verdicts={run / f'verdicts{k}.csv'}" for k in (1, 2)]
    files += [f"--outcomes={run / f'outcomes{k}.csv'}" for k in (1, 2)]
    assert main(["report", *files, "--title", "Mine & yours", "--out", str(out)]) == 0
    text = out.read_text()
    assert "<title>Mine &amp; yours</title>" in text and 'id="risk-coverage"' in text
    assert main(["report", str(run), *files[:1], "--out", str(out)]) == 0
    assert "looking again" not in out.read_text().partition("What is missing")[0]


def test_several_runs_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two = write_run(tmp_path / "one"), write_run(tmp_path / "two", looks=1, details=False)
    out = tmp_path / "r.html"
    assert main(["report", str(one), str(two), "--cases", "0", "--out", str(out)]) == 0
    text = out.read_text()
    assert "The runs side by side" in text and 'id="run-2-verdicts"' in text
    said = refused(["report", str(one), str(two), "--model", "m.npz", "--out", str(out)], capsys)
    assert "--model is of one run, and there are 2" in said


def test_what_is_not_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = write_run(tmp_path / "run", looks=1)
    out = ["--out", str(tmp_path / "r.html")]
    assert "is an .html file" in refused(["report", str(run), "--out", "r.pdf"], capsys)
    assert "name a RUN, or files" in refused(["report", *out], capsys)
    assert "no such directory" in refused(["report", str(tmp_path / "no"), *out], capsys)
    said = refused(["report", str(run), "--outcomes", str(run / "a_d-test.csv"), *out], capsys)
    assert "no column 'estimator'" in said
    other = write_run(tmp_path / "other", looks=1)
    table = (other / "outcomes1.csv").read_text().replace("a,d,", "a,e,")
    (other / "outcomes1.csv").write_text(table)
    said = refused(["report", str(run), "--outcomes", str(other / "outcomes1.csv"), *out], capsys)
    assert "no outcome is of any of the verdicts" in said and "(see --outcomes, --verdicts)" in said
    said = refused(["report", str(run), "--verdicts", str(run / "outcomes1.csv"), *out], capsys)
    assert "no column" in said
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "soon")
    assert "SOURCE_DATE_EPOCH is 'soon'" in refused(["report", str(run), *out], capsys)
    assert not (tmp_path / "r.html").exists()


def test_the_report_replaces_nothing_that_it_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_run(tmp_path / "run", looks=1)
    verdicts = run / "verdicts1.csv"
    verdicts.rename(run / "v.html")
    said = refused(
        ["report", "--verdicts", str(run / "v.html"), "--out", str(run / "v.html")], capsys
    )
    assert "would be replaced" in said
