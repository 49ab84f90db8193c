# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a report in a browser: open it, look at it, move its sliders."""

from __future__ import annotations

import re
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from helpers.browsers import new_tab

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray
    from playwright.sync_api import Browser, Page

READY = 'html[data-ready=yes]'
DESKTOP, PHONE = (1280, 900), (390, 844)  # CSS pixels


@contextmanager
def opened(
    browser: Browser, written: Path, size: tuple[int, int], script: str = '', **options: Any
) -> Iterator[Page]:
    """Open the page; leave it only if nothing was wrong, and nothing was asked of a network."""
    wrong: list[str] = []
    asked: list[str] = []
    page = new_tab(browser, viewport={'width': size[0], 'height': size[1]}, **options)
    page.context.set_offline(True)
    page.on('console', lambda message: wrong.append(message.text))
    page.on('pageerror', lambda error: wrong.append(str(error)))
    page.on('request', lambda request: asked.append(request.url))
    if script:
        page.add_init_script(script)
    page.goto(written.as_uri())
    page.wait_for_selector(READY)
    yield page
    page.context.close()
    assert wrong == []
    assert asked == [written.as_uri()]


def wait_for_drawing(page: Page) -> None:
    """Wait until all points of the frames that are shown are drawn."""
    page.wait_for_function('window.report.view().full && !window.report.view().pending')


def pixels(page: Page) -> NDArray[np.float64]:
    """Look at the canvas, (height, width, 3)."""
    page.evaluate('() => new Promise((done) => requestAnimationFrame(() => done()))')
    image = Image.open(BytesIO(page.locator('#canvas').screenshot())).convert('RGB')
    return np.asarray(image, np.float64)


def counted(page: Page) -> int:
    """Read how many points are said to be rejected."""
    text = page.locator('#count').evaluate('(one) => one.firstChild.textContent')
    return int(re.sub(r'\D', '', text))


def move(page: Page, value: int) -> None:
    """Move the first slider to a step."""
    page.locator('#slider-0').evaluate(
        "(one, value) => { one.value = value; one.dispatchEvent(new Event('input')); }", value
    )


def near(image: NDArray[np.float64], colour: str) -> int:
    """Count the pixels of a colour."""
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(image - wanted).max(axis=2) < 24).sum())
