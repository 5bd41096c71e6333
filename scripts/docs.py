"""Build the documentation site strictly, and check its links.

python scripts/docs.py               # into docs/_build/html
python scripts/docs.py --out site

A warning of Sphinx is an error, as is a link or an anchor that leads nowhere: on the site, and from
the Markdown files outside of it. Links to other hosts are not followed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from argparse import ArgumentParser
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).parents[1]
OUTSIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")
# Their links are made by Sphinx's own search, in the browser.
_GENERATED = ("search.html",)


class Page(HTMLParser):
    """What a page links to, and the anchors it has."""

    def __init__(self, text: str):
        super().__init__()
        self.links: set[str] = set()
        self.anchors = {"", "top"}  # every browser knows these
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            elif name in ("href", "src") and value:
                self.links.add(value)


def broken_links(site: Path) -> list[str]:
    """Return what is wrong with the links between the pages of a site."""
    pages = {path.resolve(): Page(path.read_text("utf-8")) for path in site.rglob("*.html")}
    out = []
    for path, page in sorted(pages.items(), key=lambda item: item[0]):
        if path.name in _GENERATED:
            continue
        for link in sorted(page.links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            where = f"{path.relative_to(site.resolve())}: {link}"
            if not target.is_file():
                out.append(f"{where}: there is no such file")
            elif target in pages and unquote(parts.fragment) not in pages[target].anchors:
                out.append(f"{where}: there is no such place on that page")
    return out


def broken_links_outside(site: Path) -> list[str]:
    """Return what is wrong with the links of Markdown files that are not on the site."""
    out = []
    for name in OUTSIDE:
        text = re.sub(r"^```.*?^```", "", (ROOT / name).read_text("utf-8"), flags=re.S | re.M)
        for link in re.findall(r"\]\(([^)\s]+)\)", text):
            parts = urlsplit(link)
            if parts.scheme or not parts.path:
                continue
            if not (ROOT / parts.path).exists():
                out.append(f"{name}: {link}: there is no such file")
            elif parts.fragment and parts.path.startswith("docs/"):
                page = site / Path(parts.path).relative_to("docs").with_suffix(".html")
                if parts.fragment not in Page(page.read_text("utf-8")).anchors:
                    out.append(f"{name}: {link}: there is no such place on that page")
    return out


def main() -> int:
    parser = ArgumentParser(description="Build the documentation site, and check its links.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "_build" / "html")
    out = parser.parse_args().out
    shutil.rmtree(ROOT / "docs" / "api", ignore_errors=True)  # made by an earlier build
    if (out / ".buildinfo").is_file():
        shutil.rmtree(out)
    build = [sys.executable, "-m", "sphinx", "-q", "-n", "-W", "--keep-going", "-b", "html"]
    if subprocess.run([*build, str(ROOT / "docs"), str(out)]).returncode:
        return 1
    wrong = broken_links(out) + broken_links_outside(out)
    print("\n".join(wrong) if wrong else f"{out}: built, links and anchors lead somewhere")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
