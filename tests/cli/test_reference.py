"""Every verb and option of the command line is documented, and nothing else is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from graspcast.cli import parser, verb_parsers
from graspcast.cli.reference import render_reference

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
VERBS = verb_parsers(parser())
OPTIONS = {o for verb in VERBS.values() for a in verb._actions for o in a.option_strings}
# Of other programs that the pages name: Ray, ZebraPose's test.py.
FOREIGN = {"--num-cpus", "--use"}


def test_the_reference_is_what_the_parser_says() -> None:
    assert (ROOT / "docs" / "cli.md").read_text() == render_reference(), (
        "run: python -m graspcast.cli.reference > docs/cli.md"
    )


def test_the_readme_lists_every_verb_and_no_other() -> None:
    readme = (ROOT / "README.md").read_text()
    table = readme[readme.index("| verb | does |") :]
    table = table[: table.index("\n\n")]
    assert set(re.findall(r"`graspcast ([a-z-]+)`", table)) == set(VERBS)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_and_option_has_a_help_text(verb: str) -> None:
    assert VERBS[verb].description
    for action in VERBS[verb]._actions:
        assert action.help, action.option_strings or action.dest


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_on_the_pages_use_verbs_and_options_that_exist(page: Path) -> None:
    text = page.read_text().replace("\\\n", " ")
    for verb, rest in re.findall(r"graspcast ([a-z]+(?:-[a-z]+)*)([^\n`|]*)", text):
        if verb not in VERBS:
            continue
        mine = {o for a in VERBS[verb]._actions for o in a.option_strings}
        used = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", rest.partition(" # ")[0]))
        assert used <= mine, (verb, used - mine)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_options_named_on_the_pages_exist(page: Path) -> None:
    named = set(re.findall(r"`(--[a-z][a-z-]*)", page.read_text()))
    scripts = "".join(
        p.read_text()
        for d in ("benchmarks", "scripts", "training")
        for p in (ROOT / d).glob("*.py")
    )
    unknown = {o for o in named - OPTIONS - FOREIGN if f'"{o}"' not in scripts}
    assert not unknown
