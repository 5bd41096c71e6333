"""Pictures of a report for its page in docs: needs Playwright and Chromium.

python benchmarks/report_pictures.py graspcast-demo/report.html docs/figures
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from playwright.sync_api import sync_playwright

_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
_SIZE = {"width": 1100, "height": 1000}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("report", type=Path)
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=_ARGUMENTS)
        for name, scheme, at in (("report", "light", None), ("report-cases", "dark", "#cases")):
            context = browser.new_context(color_scheme=scheme, viewport=_SIZE)
            page = context.new_page()
            page.goto(options.report.resolve().as_uri())
            if at is not None:
                page.locator(at).evaluate("element => element.scrollIntoView()")
            page.screenshot(path=options.out / f"{name}.png")
            context.close()
        browser.close()


if __name__ == "__main__":
    main()
