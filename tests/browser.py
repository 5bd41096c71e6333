"""Pages in headless Chromium: what it says, what it asks for, and what axe-core finds."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

_ARGUMENTS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
_NAMES = ("chromium", "chromium-browser", "google-chrome")


def find_chromium() -> str:
    """The browser of the system; a test that needs one is skipped where there is none."""
    pytest.importorskip("playwright", reason="needs Playwright: pip install 'graspcast[test]'")
    pytest.importorskip("axe_core_python", reason="needs axe: pip install 'graspcast[test]'")
    named = os.environ.get("GRASPCAST_CHROMIUM")
    found = named or next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        pytest.skip(
            "needs a browser: apt-get install chromium, or set GRASPCAST_CHROMIUM to Chromium"
        )
    return found


@dataclass
class Opened:
    """A page, what its console said, and what it asked the network for."""

    page: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def violations(self) -> list[str]:
        """What axe-core finds wrong, with the first element of each."""
        from axe_core_python.sync_playwright import Axe

        found = Axe().run(self.page)["violations"]
        return [f"{v['id']}: {v['help']}: {v['nodes'][0]['html'][:200]}" for v in found]

    @property
    def wider(self) -> int:
        """By how many pixels the page is wider than the window."""
        wide: int = self.page.evaluate("document.documentElement.scrollWidth - innerWidth")
        return wide


class Browser:
    """Headless Chromium."""

    def __init__(self, browser: Any):
        self._browser = browser

    @contextmanager
    def open(
        self, path: Path, *, dark: bool = False, width: int = 1200, height: int = 900, **more: Any
    ) -> Iterator[Opened]:
        """Open a file."""
        context = self._browser.new_context(
            color_scheme="dark" if dark else "light",
            viewport={"width": width, "height": height},
            **more,
        )
        page = context.new_page()
        out = Opened(page)
        page.on("console", lambda message: out.said.append(message.text))
        page.on("pageerror", lambda error: out.said.append(str(error)))
        page.on(
            "request",
            lambda request: (
                None
                if request.url.startswith(("data:", path.resolve().as_uri()))
                else out.asked.append(request.url)
            ),
        )
        page.goto(path.resolve().as_uri())
        try:
            yield out
        finally:
            context.close()


@contextmanager
def started() -> Iterator[Browser]:
    """Start the browser."""
    executable = find_chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=list(_ARGUMENTS))
        try:
            yield Browser(browser)
        finally:
            browser.close()


def check_page(browser: Browser, path: Path) -> None:
    """No error, no request, and nothing that axe-core minds: light on a phone, and in the dark."""
    for dark, width in ((False, 360), (True, 1200)):
        with browser.open(path, dark=dark, width=width) as opened:
            assert opened.wider <= 0, width
            assert opened.violations() == [], (dark, width)
            assert opened.said == [] and opened.asked == []
