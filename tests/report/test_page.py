"""The page of a report, as bytes and in a browser."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import pytest

from browser import Browser, check_page
from graspcast.errors import InputError
from graspcast.report.content import Case, Mode, Picture, Run, Section
from graspcast.report.page import Report, render
from graspcast.report.run_files import RunFiles, find_run
from graspcast.report.write import write_report
from small_run import NASTY, verdicts


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory, run_dir: Path, nasty_dir: Path) -> Path:
    """One run whose names are ordinary, and one whose names are not."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(path, [find_run(run_dir), find_run(nasty_dir)], cases=2, written="today")
    return path


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "pictured.html"
    path.write_text(render(Report("With pictures", (with_pictures(),))))
    return path


def webp() -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.new("RGB", (20, 24), (200, 120, 30)).save(buffer, format="WEBP")
    return buffer.getvalue()


def with_pictures(count: int = 3) -> Run:
    shots = (Picture("pose", "the pose", webp(), 20, 20), Picture("end", "held", webp(), 20, 24))
    cases = tuple(
        Case(f"Case {k}", (("outcome", "held"), ("why", "x")), shots) for k in range(count)
    )
    modes = (
        Mode("one", "One kind", "Of one kind.", cases, 9),
        Mode("two", "Two", "", cases[:1], 0),
    )
    return Run("run", "The lead.", (("n", "3", ""),), (Section("cases", "Cases", modes=modes),))


def test_names_are_text_and_nothing_else_is_asked_for(page: Path) -> None:
    text = page.read_text()
    assert "<script>alert" not in text and NASTY not in text
    assert "&lt;script&gt;alert(&#34;1&#34;)&lt;/script&gt;" in text
    outside = re.findall(r'(?:src|href)="(?!data:|#)([^"]*)"', text)
    assert outside == []
    assert "default-src &#39;none&#39;" in text and "unsafe" not in text
    assert text.count("<script>") == 2 and " style=" not in text


def test_no_pictures_rather_than_too_large() -> None:
    whole = render(Report("t", (with_pictures(),)))
    size = len(whole.encode())
    assert render(Report("t", (with_pictures(),))) == whole
    smaller = render(Report("t", (with_pictures(),)), most_bytes=size - 10)
    assert len(smaller.encode()) < size and "Pictures of some grasps are left out" in smaller
    assert 0 < smaller.count("<img") < whole.count("<img")
    none = render(Report("t", (with_pictures(),)), most_bytes=smaller.index("</html>"))
    assert "Case 2" in none
    with pytest.raises(InputError, match="without any picture"):
        render(Report("t", (with_pictures(),)), most_bytes=1000)


def test_odd_text_everywhere() -> None:
    text = "</style></script><img src=x onerror=alert(1)>\x00\udcff" + "long" * 200
    run = replace(with_pictures(), name=text, lead=text, numbers=((text, text, text),))
    run = replace(run, sections=(Section("s", text, (text,), code=text),))
    for runs in ((run,), (run, run)):
        found = render(Report(text, runs).__class__(text, tuple(map(cleaned, runs))))
        assert "<img src=x" not in found and "\x00" not in found
        found.encode()


def cleaned(run: Run) -> Run:
    """A run whose text is as the sections make it, without what cannot be encoded."""
    from graspcast.report.text import clean

    section = run.sections[0]
    section = replace(
        section, title=clean(section.title), paragraphs=tuple(map(clean, section.paragraphs)),
        code=clean(section.code),
    )  # fmt: skip
    numbers = tuple(tuple(map(clean, row)) for row in run.numbers)
    return replace(
        run, name=clean(run.name), lead=clean(run.lead), sections=(section,), numbers=numbers
    )  # type: ignore[arg-type]


@pytest.mark.slow
def test_the_browser_finds_nothing_wrong(browser: Browser, page: Path, pictured: Path) -> None:
    with browser.open(page, width=360) as opened:
        assert opened.wider <= 0
        assert opened.violations() == []
        assert opened.said == [] and opened.asked == []
    check_page(browser, pictured)


@pytest.mark.slow
def test_tables_sort_by_pointer_and_by_key(browser: Browser, page: Path) -> None:
    with browser.open(page) as opened:
        table = opened.page.locator("#run-1-verdicts table")
        column = table.locator("thead th", has_text="probability")
        number = "rows => rows.map(row => Number(row.cells[7].dataset.v))"
        rows = table.locator("tbody tr")
        column.locator("button").click()
        found = rows.evaluate_all(number)
        assert found == sorted(found) and len(set(found)) > 5
        assert column.get_attribute("aria-sort") == "ascending"
        column.locator("button").press("Enter")
        assert rows.evaluate_all(number) == sorted(found, reverse=True)
        assert column.get_attribute("aria-sort") == "descending"
        table.locator("thead th", has_text="object").locator("button").press("Space")
        names = table.locator("tbody tr > :first-child").all_inner_texts()
        assert names == sorted(names)
        assert column.get_attribute("aria-sort") == "none"
        # What is empty stands last, either way.
        rates = opened.page.locator("#run-1-policies-1 table")
        assert opened.page.locator("#status").inner_text() == "Sorted by object, rising"
        assert rates.locator("tbody tr").count() == 5


@pytest.mark.slow
def test_the_theme_is_kept(browser: Browser, page: Path) -> None:
    background = "getComputedStyle(document.body).backgroundColor"
    with browser.open(page) as opened:
        light = opened.page.evaluate(background)
        button = opened.page.locator("#theme")
        assert button.get_attribute("aria-pressed") == "false"
        button.click()
        dark = opened.page.evaluate(background)
        assert dark != light and button.get_attribute("aria-pressed") == "true"
        opened.page.reload()
        assert opened.page.evaluate(background) == dark
        opened.page.emulate_media(media="print")
        assert opened.page.evaluate(background) == light
        assert not opened.page.locator("nav").is_visible()
        assert opened.said == []
    with browser.open(page, dark=True) as opened:
        assert opened.page.evaluate(background) == dark
        opened.page.locator("#theme").press("Enter")
        assert opened.page.evaluate(background) == light


@pytest.mark.slow
def test_the_keyboard_reaches_everything(browser: Browser, pictured: Path) -> None:
    with browser.open(pictured) as opened:
        page = opened.page
        every = page.locator("a[href], button, [tabindex='0']").evaluate_all(
            "all => all.filter(e => e.checkVisibility() && !e.closest('dialog')).length"
        )
        reached = set()
        for _ in range(every + 3):
            page.keyboard.press("Tab")
            told = (
                "document.activeElement.outerHTML.slice(0, 80) + document.activeElement.offsetTop"
            )
            reached.add(page.evaluate(told))
        assert len(reached - {"<body>"}) >= every
        page.locator("button.zoom").first.focus()
        page.keyboard.press("Enter")
        dialog = page.locator("#viewer")
        assert dialog.is_visible() and dialog.locator("img").count() == 2
        titles = [page.locator("#viewer-title").inner_text()]
        for key in ("ArrowRight", "ArrowRight", "ArrowRight", "ArrowRight", "ArrowLeft"):
            page.keyboard.press(key)
            titles.append(page.locator("#viewer-title").inner_text())
        assert titles == ["Case 0", "Case 1", "Case 2", "Case 0", "Case 0", "Case 0"]
        assert opened.violations() == []
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("Escape")
        assert not dialog.is_visible()
        focused = page.evaluate("document.activeElement.closest('article').innerText")
        assert focused.startswith("Case 2")
        assert opened.said == []


@pytest.mark.slow
def test_the_data_of_a_figure_can_be_downloaded(browser: Browser, page: Path) -> None:
    with browser.open(page) as opened:
        link = opened.page.locator("#run-2-verdicts a.csv")
        with opened.page.expect_download() as waiting:
            link.click()
        found = waiting.value
        assert found.suggested_filename == "run-2-verdicts.csv"
        rows = list(csv.DictReader(io.StringIO(Path(found.path()).read_text())))
        assert len(rows) == len(verdicts(1)) and rows[0]["grasp"] == NASTY
        assert opened.said == [] and opened.asked == []


@pytest.mark.slow
def test_many_verdicts_and_long_names(browser: Browser, tmp_path: Path) -> None:
    from graspcast.forecasting.verdict import VerdictRow
    from graspcast.forecasting.verdict_file import write_verdicts
    from small_run import outcomes

    rows = [
        VerdictRow(
            row.key._replace(scene_id=1 + k % 50, im_id=k, obj_id=1 + k % 40),
            row.principal,
            "g" * 300,
            row.verdict,
            row.cam_T_obj,
            grasp=NASTY * 10,
        )
        for k, row in enumerate(verdicts(1, looks=1) * 170)
    ]
    assert len(rows) > 5000
    write_verdicts(tmp_path / "v.csv", rows)
    outcomes(rows).write_csv(tmp_path / "o.csv")
    files = RunFiles("many", verdicts=(tmp_path / "v.csv",), outcomes=(tmp_path / "o.csv",))
    write_report(tmp_path / "r.html", [files], cases=1)
    assert (tmp_path / "r.html").stat().st_size < 8 * 1024**2
    check_page(browser, tmp_path / "r.html")
