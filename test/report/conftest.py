# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A browser, and the page of two turns in snow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from helpers.browsers import chromium
from helpers.report_pages import DESKTOP, opened, wait_for_drawing

from lidar_outlier_filter.report.page import write_page

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

    from lidar_outlier_filter.report.gather import Gathered


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    """Start Chromium."""
    with chromium() as opened:
        yield opened


@pytest.fixture(scope='module')
def written(found: Gathered, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write their page."""
    path = tmp_path_factory.mktemp('page') / 'report.html'
    write_page(found, path)
    return path


@pytest.fixture(scope='module')
def desktop(browser: Browser, written: Path) -> Iterator[Page]:
    """Open the page as on a desk."""
    with opened(browser, written, DESKTOP) as page:
        wait_for_drawing(page)
        yield page
