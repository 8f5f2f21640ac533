"""Makes the README's picture again:  the beginning of the brake's report, as docs/report.png.

Needs the extra `test` (Playwright) and a Chromium of the system.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import fopi_tune as ft
from fopi_tune.report.documents import documents_of_run
from fopi_tune.report.html import report_files

ROOT = Path(__file__).parents[1]
WIDTH = 1080


def main() -> None:
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        sys.exit("no Chromium found; install one, as chromium, chromium-browser or google-chrome")
    page = report_files(documents_of_run(ft.run(ROOT / "specs" / "brake.yaml")))["report.html"]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as tool:
        file = Path(folder, "report.html")
        file.write_text(str(page), encoding="utf-8")
        browser = tool.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        shown = browser.new_page(viewport={"width": WIDTH, "height": 900})
        shown.goto(file.as_uri())
        # away from the nominal plant, so that what moves is seen
        shown.focus("#slider")
        shown.keyboard.press("End")
        shown.evaluate("document.activeElement.blur(); scrollTo(0, 0)")
        box = shown.locator(".moved").bounding_box()
        assert box is not None
        clip = {"x": 0, "y": 0, "width": WIDTH, "height": box["y"] + box["height"]}
        shown.screenshot(path=ROOT / "docs" / "report.png", full_page=True, clip=clip)
        browser.close()


if __name__ == "__main__":
    main()
