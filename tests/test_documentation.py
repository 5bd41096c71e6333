"""Blocks of the documentation: names and options that exist, and reasons where they are not run."""

from __future__ import annotations

import os
import socket
import sys
from contextlib import ExitStack
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
        ("<!-- run: now -->\n```sh\nls\n```\n", "none of this script's marks"),
        ("```\ngraspcast demo\n```\n", "has to be ```sh or ```python"),
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


def test_the_nearest_mark_counts(blocks: ModuleType) -> None:
    text = "<!-- run by: .ci/run -->\n<!-- not run: lists files -->\n```sh\nls\n```\n"
    (block,) = blocks.blocks(ROOT / "README.md", text)
    assert (block.mark, block.why) == ("not run", "lists files")


def test_what_a_program_prints_is_no_block(blocks: ModuleType) -> None:
    assert list(blocks.blocks(ROOT / "README.md", "```\ngo: 0.9\n```\n")) == []


def test_blocks_of_a_page_are_run_in_one_directory(blocks: ModuleType, tmp_path: Path) -> None:
    serve = f"exec {sys.executable} -m http.server $PORT --bind 127.0.0.1"
    parts = [
        ("file: said.txt", "toml", "hello"),
        ("run", "python", "x = 1"),
        ("run: goes on", "python", "assert x == 1 and open('said.txt').read().strip() == 'hello'"),
        ("run beside: http://127.0.0.1:8000/said.txt", "sh", serve),
        ("run", "sh", "curl -sf http://127.0.0.1:8000/said.txt"),
        ("run", "python", "assert x"),
    ]
    text = "\n".join(f"<!-- {m} -->\n\n```{lang}\n{code}\n```\n" for m, lang, code in parts)
    found = list(blocks.blocks(ROOT / "README.md", text))
    assert [w for block in found for w in blocks.problems(block)] == []
    environment = {**os.environ, "PORT": blocks._free_port()}
    with ExitStack() as until:
        (wrong,) = blocks._run_page(found, tmp_path, environment, until)
    assert "NameError: name 'x' is not defined" in wrong
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", int(environment["PORT"])))


def test_links_that_lead_nowhere_are_found(tmp_path: Path) -> None:
    sys.path.insert(0, str(ROOT / "scripts"))
    import docs

    (tmp_path / "a.html").write_text('<a id="here"></a><a href="b.html#there">b</a>')
    (tmp_path / "b.html").write_text('<a href="a.html#here">a</a><img src="none.png">')
    assert docs.broken_links(tmp_path) == [
        "a.html: b.html#there: there is no such place on that page",
        "b.html: none.png: there is no such file",
    ]
