# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Chromium without a screen, WebGL in software, and its tabs."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from playwright.sync_api import sync_playwright

from helpers import CHROMIUM

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page

TIMEOUT = 300_000  # milliseconds, of a machine with much other work
# Software draws; and nothing but the page is fetched, not by the browser itself either.
OPTIONS = (
    '--no-sandbox',
    '--use-gl=angle',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start Chromium."""
    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=list(OPTIONS))
        yield opened
        opened.close()


def new_tab(browser: Browser, **options: Any) -> Page:
    """Open an empty tab in a context of its own; it waits as long as a busy machine takes."""
    page = browser.new_context(**options).new_page()
    page.set_default_timeout(TIMEOUT)
    return page
