# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page in a browser: Chromium without a screen, WebGL in software, nothing from the network."""

from __future__ import annotations

import re
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise
from threading import Thread
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.browsers import new_tab
from helpers.report_pages import (
    DESKTOP,
    PHONE,
    READY,
    counted,
    move,
    near,
    opened,
    pixels,
    wait_for_drawing,
)
from naive import groups as naive

from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.report.frames import cut
from lidar_outlier_filter.report.pack import STEPS, pack
from lidar_outlier_filter.report.page import MODULES, START, asset, buffers, shell

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

    from lidar_outlier_filter.report.gather import Gathered


@pytest.fixture(scope='module')
def desktop(browser: Browser, written: Path) -> Iterator[Page]:
    """Open the page as on a desk."""
    with opened(browser, written, DESKTOP) as page:
        wait_for_drawing(page)
        yield page


def test_canvas_is_not_empty(desktop: Page) -> None:
    """Points are drawn, rejected ones among them; decoding and the first picture are timed."""
    image = pixels(desktop)
    assert image.std() > 10
    assert near(image, '#c8500a') > 100
    times = desktop.evaluate('window.report.times')
    assert times['start'] <= times['decoded'] <= times['first']


def test_slider_says_what_a_replay_rejects(
    desktop: Page, found: Gathered, snow: Path, tmp_path: Path
) -> None:
    """Also what it finds and loses, and the settings to copy; more is coloured."""
    slider = found.sliders[0]
    before = near(pixels(desktop), '#c8500a')
    step = slider.given - 3
    move(desktop, step)
    value = slider.values[step]
    (topic,) = replay(snow, tmp_path / 'out', parameters={slider.name: value}).topics
    assert counted(desktop) == topic.rejected
    assert f'{slider.name}: {value}' in desktop.locator('#yaml').inner_text()
    line = f'ros2 param set /outlier_filter_node {slider.name} {value}'
    assert desktop.locator('#lines').inner_text() == line
    counts = found.tally.at[0][step]
    precision = 100 * counts.bad / counts.points
    assert desktop.locator('#precision').inner_text() == f'{precision:.2f} %'
    assert near(pixels(desktop), '#c8500a') > before
    move(desktop, slider.given)
    assert counted(desktop) == found.tally.at[0][slider.given].points


@pytest.mark.parametrize('count', [0, 1, 2, 60, 400])
def test_groups_are_those_of_loops(desktop: Page, count: int) -> None:
    """Random points, dense and sparse, near and far from the origin."""
    rng = np.random.default_rng(count)
    xyz = rng.uniform(-3, 3, (count, 3)) + rng.choice([0.0, 3e6])
    label = np.array(desktop.evaluate('(one) => [...report.connect(one)]', xyz.ravel().tolist()))
    ours = {frozenset(np.flatnonzero(label == one).tolist()) for one in np.unique(label)}
    assert ours == {frozenset(group) for group in naive.connect(xyz.tolist())}


def test_groups_follow_the_slider(desktop: Page, found: Gathered) -> None:
    """Those of the points that the step rejects, frame by frame, the largest first."""
    slider, frames = found.sliders[0], cut(found)
    packed = pack(found, frames)
    step = slider.given - 2
    move(desktop, step)
    desktop.wait_for_function('report.state.found.bit === report.state.bit')
    sizes: list[int] = []
    for number, (begin, end) in enumerate(pairwise(frames.first.tolist())):
        a, b, _, last = packed.points[begin:end].T
        steps = np.stack([a & STEPS, (a >> 21) | ((b & 0x3FF) << 11), b >> 10], axis=1)
        there = (last & (1 << (slider.first + step))) != 0
        xyz = packed.origin[number] + steps[there] * packed.step[number]
        sizes += [len(group) for group in naive.connect(xyz.tolist())]
    listed = desktop.evaluate('report.state.found.groups.map((one) => one.count)')
    assert listed == sorted(sizes, reverse=True)[: len(listed)]
    assert desktop.evaluate('report.state.found.total') == len(sizes) > len(listed)
    assert f'{slider.name} {slider.values[step]}' in desktop.locator('#groups-about').inner_text()
    desktop.locator('#groups button').first.click()
    assert 'score' in desktop.locator('#facts').inner_text()
    move(desktop, slider.given)


def test_click_on_a_point(desktop: Page, found: Gathered) -> None:
    """Its score is that of the filter, and its features are bars; its neighbours are marked."""
    # The first point with a reason that nothing else hides.
    number, index, x, y = desktop.evaluate("""() => {
      const { view, data, state } = window.report;
      const frame = data().frames[state.frame];
      const box = document.getElementById('canvas').getBoundingClientRect();
      const there = [0, 0, 0];
      for (let i = 0; i < frame.explained; i += 1) {
        const a = frame.words[4 * i], b = frame.words[4 * i + 1];
        const steps = [a & 0x1fffff, (a >>> 21) | ((b & 0x3ff) << 11), b >>> 10];
        const position = steps.map((step, k) => frame.origin[k] + frame.step[k] * step);
        const at = view().project(position);
        if (!at || at[0] < 40 || at[1] < 40 || at[0] > box.width - 40 || at[1] > box.height - 90)
          continue;
        const x = Math.round(at[0]), y = Math.round(at[1]);
        const found = view().pick(x, y, state.bit);
        if (found && found.index === i) return [state.frame, i, x, y];
      }
      return null;
    }""")
    desktop.locator('#canvas').click(position={'x': x, 'y': y})
    frames = cut(found)
    kept = found.kept.take(frames.order)
    score = float(kept.score[frames.first[number] + index])
    text = desktop.locator('#facts').inner_text()
    said = re.search(r'score\s+(\S+)', text)
    assert said is not None
    assert float(said[1]) == pytest.approx(score, rel=1e-3)
    assert 'rejected by boosted_trees' in text
    assert desktop.locator('.bars rect').count() > 3
    assert desktop.locator('#ring').is_visible()
    assert desktop.evaluate('window.report.view().marks.every((mark) => mark.visible)')


def test_every_colouring_differs(desktop: Page) -> None:
    """By intensity, height, score, detector, reason and truth; and what is near lights up."""
    seen = []
    for mode in range(6):
        desktop.locator('#mode').select_option(str(mode))
        seen.append(pixels(desktop))
        assert seen[-1].std() > 10
    for one, other in pairwise(seen):
        assert (np.abs(one - other).max(axis=2) > 24).sum() > 50
    desktop.locator('#mode').select_option('0')
    plain = near(pixels(desktop), '#0072b2')
    desktop.locator('#show').select_option('1')
    assert near(pixels(desktop), '#0072b2') > plain
    desktop.locator('#show').select_option('3')
    assert near(pixels(desktop), '#c8500a') < 20
    desktop.locator('#show').select_option('0')


def test_keyboard_alone(desktop: Page, found: Gathered) -> None:
    """Tab reaches the canvas, the sliders and the groups; keys turn, fly, and choose."""
    desktop.locator('h1').click()  # Tab goes on from there
    reached = []
    for _ in range(40):
        desktop.keyboard.press('Tab')
        reached.append(
            desktop.evaluate('document.activeElement.id || document.activeElement.tagName')
        )
        if reached[-1] == 'canvas':
            break
    assert reached[:2] == ['mode', 'show']
    where = 'window.report.view().camera.position.toArray().map((one) => one.toFixed(4)).join()'
    seen = {desktop.evaluate(where)}
    for key in ('ArrowLeft', 'ArrowUp', 'w', 'a', 'e', '+', '2', '1'):
        desktop.keyboard.press(key)
        seen.add(desktop.evaluate(where))
    assert len(seen) >= 7
    desktop.keyboard.press('?')
    assert desktop.locator('#keys').is_visible()
    desktop.keyboard.press('?')
    desktop.keyboard.press('g')
    assert 'score' in desktop.locator('#facts').inner_text()
    while desktop.evaluate('document.activeElement.id') != 'slider-0':
        desktop.keyboard.press('Tab')
    desktop.keyboard.press('ArrowRight')
    slider = found.sliders[0]
    assert counted(desktop) == found.tally.at[0][slider.given + 1].points
    desktop.keyboard.press('ArrowLeft')
    desktop.wait_for_function('report.state.found.bit === report.state.bit')
    desktop.keyboard.press('Tab')
    assert desktop.evaluate("document.activeElement.closest('#groups') !== null")


def test_frames(desktop: Page) -> None:
    """Sweeps that lie on each other are shown one by one, or all of them."""
    assert desktop.locator('#single').get_attribute('aria-pressed') == 'true'
    desktop.locator('#whole').click()
    wait_for_drawing(desktop)
    text = desktop.locator('#shown').inner_text()
    assert len({*re.findall(r'(\d+ \d+)', text.replace('\u202f', ' '))}) == 1, text
    desktop.locator('#single').click()


def test_dark_and_narrow(browser: Browser, written: Path) -> None:
    """In the dark, on a phone: dark ground, nothing beside the screen."""
    with opened(browser, written, PHONE, color_scheme='dark', has_touch=True) as page:
        image = pixels(page)
        assert np.median(image) < 64
        assert near(image, '#ff8c42') > 20
        assert page.evaluate('document.documentElement.scrollWidth') <= PHONE[0]
        for name in ('#sliders', '#groups', '#charts', '#found'):
            box = page.locator(name).bounding_box()
            assert box is not None
            assert box['x'] >= 0
            assert box['x'] + box['width'] <= PHONE[0]


def test_served(browser: Browser, found: Gathered, tmp_path: Path) -> None:
    """A page without data of its own fetches modules and buffers from where it is served."""
    known, parts = buffers(found)
    (tmp_path / 'header.json').write_text(known, encoding='utf-8')
    for name, content in parts.items():
        (tmp_path / f'{name}.bin').write_bytes(content)
    for path in (*MODULES.values(), START):
        (tmp_path / path).write_text(asset(path), encoding='utf-8')
    modules = {name: f'/{path}' for name, path in MODULES.items()}
    (tmp_path / 'index.html').write_text(shell('live', modules, f'/{START}', base='/'))
    handler = partial(QuietHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(('127.0.0.1', 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        page = new_tab(browser)
        page.goto(f'http://127.0.0.1:{server.server_port}/index.html')
        page.wait_for_selector(READY)
        assert counted(page) == found.tally.at[0][found.sliders[0].given].points
        page.context.close()
        server.shutdown()


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files, and says nothing of it."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def test_without_webgl(browser: Browser, written: Path) -> None:
    """Pictures instead, and the sliders work all the same."""
    none = """const given = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
      return kind.startsWith('webgl') ? null : given.call(this, kind, ...more);
    };"""
    with opened(browser, written, DESKTOP, none) as page:
        assert 'Pictures only' in page.locator('#shown').inner_text()
        before = pixels(page)
        assert before.std() > 10
        many = counted(page)
        move(page, 0)
        assert counted(page) > many
        assert (np.abs(before - pixels(page)).max(axis=2) > 24).sum() > 100
