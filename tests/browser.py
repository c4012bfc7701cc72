"""A real Chromium without a window, for tests of pages; where there is none they are left out, and say so."""

import os
import shutil
from contextlib import contextmanager

import pytest

CHROMIUM = os.environ.get("DIMERSWEEP_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
QUIET = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader"),
    "--enable-unsafe-swiftshader",
)
try:
    from playwright.sync_api import sync_playwright
except ImportError:
    sync_playwright = None
REASON = "no Chromium" if sync_playwright else "playwright is not installed"
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None or sync_playwright is None, reason=f"pages are not tried in a browser: {REASON}"
)


@contextmanager
def chromium():
    """The browser itself."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        yield browser
        browser.close()


@contextmanager
def chromium_page(browser, *, offline, width=1100, height=800):
    """A page and the list of its errors."""
    context = browser.new_context(viewport={"width": width, "height": height}, offline=offline)
    try:
        page = context.new_page()
        with watched(page) as errors:
            yield page, errors
    finally:
        context.close()


@contextmanager
def watched(page):
    """The list of a page's errors: those of its scripts, of its console, and requests that failed."""
    errors = []
    listeners = {
        "pageerror": lambda error: errors.append(f"script: {error}"),
        "console": lambda line: errors.append(f"console: {line.text}") if line.type == "error" else None,
        "requestfailed": lambda request: errors.append(f"request: {request.url}"),
    }
    for event, listener in listeners.items():
        page.on(event, listener)
    try:
        yield errors
    finally:
        for event, listener in listeners.items():
            page.remove_listener(event, listener)


def colors_of(picture):
    """How many pixels of a PNG (bytes) have each colour of a coarse palette."""
    from io import BytesIO

    import numpy as np
    from PIL import Image

    pixels = np.asarray(Image.open(BytesIO(picture)).convert("RGB")).reshape(-1, 3) // 64
    values, counts = np.unique(pixels, axis=0, return_counts=True)
    return {tuple(map(int, value)): int(count) for value, count in zip(values, counts, strict=True)}
