"""Chromium, headless, for tests of the page."""

import shutil
import time
from contextlib import contextmanager

import cv2
import numpy as np
import pytest

__all__ = ["canvas_pixels", "open_browser", "until"]

_NAMES = ("chromium", "chromium-browser", "google-chrome")
#: Nothing that Chromium does by itself, and no graphics hardware.
_FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
          "--disable-background-networking", "--disable-component-update", "--disable-sync",
          "--disable-quic", "--no-first-run")


@contextmanager
def open_browser():
    """A browser of playwright's; the test is left out where there is none."""
    program = next(filter(None, map(shutil.which, _NAMES)), None)
    if program is None:
        pytest.skip("the tests of the page in a browser: `apt-get install chromium` brings them")
    from playwright.sync_api import sync_playwright
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=_FLAGS)
        try:
            yield browser
        finally:
            browser.close()


def until(page, expression, seconds=30.0):
    """Wait until an expression of the page is true; its own policy forbids playwright's way."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        said = page.evaluate("document.getElementById('message').textContent")
        assert time.monotonic() < end, f"{expression} did not become true; the page says {said!r}"
        time.sleep(0.03)


def canvas_pixels(page, selector="#view"):
    """What a canvas shows, array (height, width, 3) of blue, green, red."""
    page.evaluate("page.stage.dirty = true")
    time.sleep(0.1)
    octets = page.locator(selector).screenshot()
    return cv2.imdecode(np.frombuffer(octets, np.uint8), cv2.IMREAD_COLOR)
