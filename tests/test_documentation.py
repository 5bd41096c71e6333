"""Blocks of the documentation: names and options that exist, and reasons where they are not run."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def blocks() -> ModuleType:
    sys.path.insert(0, str(ROOT / "scripts"))
    import blocks

    return blocks


def test_every_block_is_run_or_says_why_not_and_names_what_exists(blocks: ModuleType) -> None:
    found = [block for page in blocks.pages() for block in blocks.blocks(page)]
    assert len(found) > 50
    assert [text for block in found for text in blocks.problems(block)] == []


def said(blocks: ModuleType, text: str) -> list[str]:
    return [w for b in blocks.blocks(ROOT / "README.md", text) for w in blocks.problems(b)]


RUN = "<!-- run -->\n\n"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("```sh\ngraspcast demo\n```\n", "neither run nor marked"),
        ("<!-- not run -->\n```sh\ngraspcast demo\n```\n", "says not what"),
        ("<!-- run by: .ci/none -->\n```sh\nls\n```\n", "no such file"),
        (f"{RUN}```sh\ngraspcast foretell\n```\n", "no verb foretell"),
        (f"{RUN}```sh\ngraspcast demo \\\n  --speed 3\n```\n", "demo has no --speed"),
        (f"{RUN}```sh\nX=1\nfor x in a; do graspcast fuse --outt x; done\n```\n", "no --outt"),
        (f"{RUN}```python\nx = = 1\n```\n", "line 1 of the block"),
        (f"{RUN}```python\nfrom graspcast import Wotcher\n```\n", "has no Wotcher"),
        (f"{RUN}```python\nimport graspcast.nowhere\n```\n", "nowhere"),
        (f"{RUN}```python\nimport graspcast\ngraspcast.foretell(1)\n```\n", "has no foretell"),
    ],
)
def test_what_is_wrong_with_a_block_is_said(blocks: ModuleType, text: str, problem: str) -> None:
    (only,) = said(blocks, text)
    assert problem in only
    assert only.startswith("README.md:")


@pytest.mark.parametrize(
    "text",
    [
        f"{RUN}```sh\ngraspcast demo --out 'a --b' # --c\n```\n",
        "```sh\nls\n```\n\n<!-- not run: lists files,\nof yours -->\n",
        "Some text:\n<!-- run -->\n```python\nfrom graspcast import Watcher\n```\n",
        "```toml\n[none]\n```\n",
    ],
)
def test_what_is_right_is_not_complained_of(blocks: ModuleType, text: str) -> None:
    assert said(blocks, text) == []


def test_links_that_lead_nowhere_are_found(tmp_path: Path) -> None:
    sys.path.insert(0, str(ROOT / "scripts"))
    import docs

    (tmp_path / "a.html").write_text('<a id="here"></a><a href="b.html#there">b</a>')
    (tmp_path / "b.html").write_text('<a href="a.html#here">a</a><img src="none.png">')
    assert docs.broken_links(tmp_path) == [
        "a.html: b.html#there: there is no such place on that page",
        "b.html: none.png: there is no such file",
    ]
