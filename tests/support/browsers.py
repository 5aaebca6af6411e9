"""A Chromium for tests; without one they are skipped."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def chromium() -> Iterator:
    """Yield a browser that is installed, or the one that Playwright has installed."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    with playwright.sync_playwright() as play:
        path = path or play.chromium.executable_path
        if not Path(path).exists():
            pytest.skip(f"needs one of {', '.join(BROWSERS)}")
        browser = play.chromium.launch(executable_path=path, args=list(OPTIONS), timeout=0)
        yield browser
        browser.close()
