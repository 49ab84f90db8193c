# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a report in a browser, and the messages that pages read."""

from __future__ import annotations

import json
import re
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from helpers.browsers import new_tab
from lidar_outlier_filter.report.points import BOX_STEPS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray
    from playwright.sync_api import Browser, Page

READY = 'html[data-ready=yes]'
DESKTOP, PHONE = (1280, 900), (390, 844)  # CSS pixels


# Of each text its contrast with what is behind it (WCAG 2), and what stands in no landmark.
STATE = """() => {
  const light = (text) => {
    const [r, g, b] = text.match(/[\\d.]+/g).slice(0, 3).map((one) => one / 255)
      .map((one) => (one <= 0.03928 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (one) => {
    for (let at = one; at; at = at.parentElement) {
      const colour = getComputedStyle(at).backgroundColor;
      if (!colour.endsWith(', 0)')) return colour;
    }
    return 'rgb(255, 255, 255)';
  };
  const texts = [...document.querySelectorAll('body *:not(script)')].filter((one) =>
    one.checkVisibility() && !one.closest('#view, option, svg')
    && [...one.childNodes].some((part) => part.nodeType === 3 && part.data.trim()));
  const ratio = (one) => {
    const [a, b] = [light(getComputedStyle(one).color), light(behind(one))];
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  };
  const landmark = 'header, main, footer, section[aria-label], section[aria-labelledby]';
  return {
    count: texts.length,
    faint: texts.filter((one) => ratio(one) < 4.5).map((one) => one.outerHTML.slice(0, 90)),
    nowhere: texts.filter((one) => !one.closest(landmark)).map((one) => one.outerHTML.slice(0, 90)),
  };
}"""


def read_message(
    content: bytes,
) -> tuple[dict[str, Any], list[NDArray[np.uint32]], dict[str, NDArray[Any]]]:
    """Read a message as the page does: its header, the words of each frame, and the columns."""
    length = int.from_bytes(content[:4], 'little')
    header = json.loads(content[4 : 4 + length])
    begin = 4 + length
    assert begin % 16 == 0
    words = []
    for frame in header['frames']:
        words.append(np.frombuffer(content, '<u4', 4 * frame['count'], begin).reshape(-1, 4))
        begin += words[-1].nbytes
    total, columns = sum(map(len, words)), {}
    for name, kind, width in header['columns']:
        columns[name] = np.frombuffer(content, f'<{kind}', width * total, begin)
        begin += columns[name].nbytes
    assert begin == len(content)
    return header, words, columns


def positions(frame: Mapping[str, Any], words: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Unpack positions in metres."""
    a, b = words[:, 0], words[:, 1]
    steps = np.stack([a & BOX_STEPS, (a >> 21) | ((b & 0x3FF) << 11), b >> 10], axis=1)
    found: NDArray[np.float64] = frame['origin'] + steps * np.array(frame['step'])
    return found


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
    requested = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(image - requested).max(axis=2) < 24).sum())
