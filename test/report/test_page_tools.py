# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page in a browser: the picture stays in view; one can measure, select and share."""

from __future__ import annotations

import csv
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.browsers import new_tab
from helpers.report_pages import PHONE, counted, move, near, opened, pixels, wait_for_drawing

from lidar_outlier_filter.evaluation.judged import CAUSES
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.gather import gather
from lidar_outlier_filter.report.page import write_page
from lidar_outlier_filter.report.sources import RecordedSource

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

    from lidar_outlier_filter.report.gather import Gathered

DESK = (1440, 900)
# Two drawn points with nothing else near them on the screen: [x, y, position] of each.
TWO_POINTS = """() => {
  const { view, data, state, isolated } = window.report;
  const found = [];
  const box = document.getElementById('canvas').getBoundingClientRect();
  view().seen(state, (frame, index, [u, v]) => {
    if (found.length >= 2 || u < 400 || v < 90 || u > box.width - 60 || v > box.height - 90) return;
    const [x, y] = [Math.round(u), Math.round(v)];
    if (found.length && Math.hypot(x - found[0][0], y - found[0][1]) < 120) return;
    const hit = view().pick(x, y, state);
    if (hit.index !== index) return;
    const a = data().frames[frame], i = 4 * index, [p, q] = [a.words[i], a.words[i + 1]];
    const steps = [p & 0x1fffff, (p >>> 21) | ((q & 0x3ff) << 11), q >>> 10];
    found.push([x, y, steps.map((step, k) => a.origin[k] + a.step[k] * step)]);
  });
  return found;
}"""


@pytest.fixture
def desk(browser: Browser, written: Path) -> Iterator[Page]:
    """Open the page on a usual screen."""
    with opened(browser, written, DESK) as page:
        wait_for_drawing(page)
        yield page


@pytest.fixture(scope='module')
def chain(snow: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Gathered, Path]:
    """Judge by a chain of two, and write its page."""
    parameters = FilterParameters().changed({'chain': ['sor', 'boosted_trees']})
    found = gather(RecordedSource(snow, parameters), CAUSES, 20_000)
    path = tmp_path_factory.mktemp('chain') / 'chain.html'
    write_page(found, path)
    return found, path


def tops(page: Page) -> list[float]:
    """Say how far the page is scrolled, and where the picture and a group of the list are."""
    found: list[float] = page.evaluate("""() => [scrollY, ...['#canvas', '#groups li:nth-child(3)']
      .map((name) => document.querySelector(name).getBoundingClientRect().top)]""")
    return found


def test_picture_stays_in_view(desk: Page) -> None:
    """A group is chosen: neither the picture nor the list moves under the pointer."""
    before = tops(desk)
    desk.locator('#groups li:nth-child(3) button').click()
    assert 'score' in desk.locator('#facts').inner_text()
    assert tops(desk) == before
    canvas = desk.locator('#canvas').bounding_box()
    assert canvas is not None
    assert canvas['y'] >= 0
    assert canvas['y'] + canvas['height'] <= DESK[1]
    # The last of a long list, and the bottom of the panel: still in view.
    desk.locator('#groups li:last-child button').click()
    desk.locator('#removed').scroll_into_view_if_needed()
    assert tops(desk)[:2] == before[:2]


def test_one_total(desk: Page, found: Gathered) -> None:
    """Measured points are counted, and only these: above, at the slider, in what was found."""
    total = f'{found.tally.all.points:,}'.replace(',', ' ')
    for name in ('#lead', '#count', '#found'):
        text = re.sub(r'\s', ' ', desk.locator(name).inner_text())
        assert f'{total} measured points' in text
    assert 'Every count and share on this page is of them' in desk.locator('#found').inner_text()


def test_escape(desk: Page) -> None:
    """It closes the keys, and puts a tool away."""
    desk.locator('#keys-button').click()
    assert desk.locator('#keys').is_visible()
    desk.keyboard.press('Escape')
    assert not desk.locator('#keys').is_visible()
    assert desk.locator('#keys-button').get_attribute('aria-expanded') == 'false'
    desk.locator('[data-tool=measure]').click()
    desk.keyboard.press('Escape')
    assert not desk.locator('#tool').is_visible()


def test_distance(desk: Page) -> None:
    """Of two points that are clicked, in metres; it is on the picture, too."""
    (x1, y1, one), (x2, y2, other) = desk.evaluate(TWO_POINTS)
    desk.locator('[data-tool=measure]').click()
    desk.locator('#canvas').click(position={'x': x1, 'y': y1})
    desk.locator('#canvas').click(position={'x': x2, 'y': y2})
    metres = float(np.linalg.norm(np.subtract(one, other)))
    said = re.search(r'distance\s+([\d.]+) m', desk.locator('#tool').inner_text())
    assert said is not None
    assert float(said[1]) == pytest.approx(metres, abs=0.001)
    assert desk.locator('#overlay text.distance').text_content() == f'{metres:.2f} m'


def test_scale_bar(desk: Page) -> None:
    """As long as it says, in a flat view; three axes; they follow the view."""
    desk.locator('[data-view=top]').click()
    wait_for_drawing(desk)
    text = desk.locator('#scale-text').text_content()
    assert text is not None
    metres = float(text.split()[0])
    pixels_ = desk.evaluate(
        """(metres) => {
      const { view } = window.report;
      const [x, y, z] = view().centre;
      return view().project([x + metres, y, z])[0] - view().project([x, y, z])[0];
    }""",
        metres,
    )
    drawn = desk.locator('#overlay .scale').get_attribute('d')
    assert drawn is not None
    assert float(drawn.split('h')[1].split('v')[0]) == pytest.approx(pixels_, rel=1e-3)
    assert desk.locator('#overlay line[class^=axis]').count() == 3
    before = desk.locator('#overlay .axis-x').get_attribute('y2')
    desk.locator('[data-view=side]').click()
    wait_for_drawing(desk)
    assert desk.locator('#overlay .axis-z').get_attribute('y2') != before


def select(page: Page) -> None:
    """Drag a box over the middle of the picture."""
    page.locator('[data-tool=box]').click()
    box = page.locator('#canvas').bounding_box()
    assert box is not None
    x, y = box['x'] + box['width'] / 2, box['y'] + box['height'] / 2
    page.mouse.move(x - 120, y - 90)
    page.mouse.down()
    page.mouse.move(x + 100, y + 80, steps=3)
    page.mouse.up()


def test_box_is_counted_and_saved(desk: Page, tmp_path: Path) -> None:
    """What is in a box on the screen; counts follow the slider, the file has a line each."""
    select(desk)
    known: dict[str, Any] = desk.evaluate("""() => {
      const { state, view } = window.report;
      const canvas = document.getElementById('canvas').getBoundingClientRect();
      const [x, y] = [canvas.width / 2, canvas.height / 2];
      let inside = 0;
      view().seen(state, (f, i, [u, v]) => {
        inside += Math.abs(u - x + 10) <= 110 && Math.abs(v - y + 5) <= 85;
      });
      return { inside, selected: state.selected.length };
    }""")
    assert known['selected'] == pytest.approx(known['inside'], rel=0.02)
    assert known['selected'] > 100
    with desk.expect_download() as download:
        desk.locator('#save-csv').click()
    download.value.save_as(tmp_path / 'some.csv')
    rows = list(csv.DictReader((tmp_path / 'some.csv').read_text().splitlines()))
    assert len(rows) == known['selected']
    text = desk.locator('#tool').inner_text().replace('\u202f', ' ')
    rejected = sum(row['rejected'] == '1' for row in rows)
    assert f'rejected\n{rejected:,}'.replace(',', ' ') in re.sub(r'(\d)\s(\d)', r'\1 \2', text)
    assert {row['detector'] for row in rows if row['rejected'] == '1'} == {'boosted_trees'}
    assert {row['truth'] for row in rows} <= {'good', 'outlier'}
    assert all(np.isfinite([float(row[one]) for one in 'xyz']).all() for row in rows)
    move(desk, 0)
    assert desk.locator('#tool').inner_text() != text


def test_size_of_points(desk: Page) -> None:
    """Larger points cover more."""
    few = near(pixels(desk), '#c8500a')
    desk.locator('#size').fill('6')
    wait_for_drawing(desk)
    assert near(pixels(desk), '#c8500a') > 1.5 * few


def test_address_keeps_the_view(browser: Browser, desk: Page, written: Path) -> None:
    """Slider, colour, what is shown, and where the eye is: opened again, all are as they were."""
    desk.locator('[data-view=top]').click()
    desk.locator('#canvas').focus()
    for key in ('+', '+', 'w', ']'):
        desk.keyboard.press(key)
    desk.locator('#mode').select_option('2')
    desk.locator('#show').select_option('2')
    move(desk, 3)
    desk.wait_for_function("location.hash.includes('value=') && location.hash.includes('show=2')")
    desk.wait_for_timeout(400)  # behind the pause before it is written
    saved = written.as_uri() + desk.evaluate('location.hash')
    what = """[report.view().pose.map((one) => one.toFixed(2)),
      ...['step', 'mode', 'show', 'frame'].map((name) => report.state[name])]"""
    page = new_tab(browser, viewport={'width': DESK[0], 'height': DESK[1]})
    page.goto(saved)
    page.wait_for_selector('html[data-ready=yes]')
    assert page.evaluate(what) == desk.evaluate(what)
    assert counted(page) == counted(desk)
    page.goto('about:blank')
    page.goto(written.as_uri() + '#value=x&slider=y&frame=z&colour=99&eye=1,2&size=-3')
    page.wait_for_selector('html[data-ready=yes]')
    page.context.close()


def test_a_detector_is_hidden(browser: Browser, chain: tuple[Gathered, Path]) -> None:
    """What it rejects is not drawn any more; dashed lines of a chain; counts follow the slider."""
    found, path = chain
    with opened(browser, path, DESK) as page:
        wait_for_drawing(page)
        many = near(pixels(page), '#c8500a')
        page.locator('[data-detector=sor]').uncheck()
        wait_for_drawing(page)
        few = near(pixels(page), '#c8500a')
        page.locator('[data-detector=boosted_trees]').uncheck()
        wait_for_drawing(page)
        assert many > few > near(pixels(page), '#c8500a') < 60  # of the legend
        assert page.locator('#charts .limit').count() == 1
        move(page, 1)
        assert page.locator('#charts .limit').count() == 2
        said = page.locator('#removed .removed').first.inner_text()
        counts = found.tally.at[0][1]
        shown = [
            int(re.sub(r'\D', '', one)) for one in re.findall(r'[\d\s]*\d\s*$', said, re.MULTILINE)
        ]
        assert sum(shown) == counts.points
        assert found.sliders[0].name in page.locator('#removed-text').inner_text()


def test_large_pictures_begin_with_a_sample(desk: Page) -> None:
    """Slice by slice every point is drawn once, the rejected and an even sample first."""
    found = desk.evaluate("""async () => {
      const { Slices, ranges } = await import('slices');
      const frame = { marked: 300, count: 1000 };
      const slices = new Slices(100);
      const times = new Uint8Array(1000);
      const sizes = [];
      while (!slices.done) {
        let size = 0;
        for (const [first, many] of ranges(frame, 120, slices.next(120, 880))) {
          size += many;
          for (let i = first; i < first + many; i += 1) times[i] += 1;
        }
        sizes.push(size);
      }
      return { sizes, once: times.every((one) => one === 1) };
    }""")
    assert found['once']
    assert len(found['sizes']) >= 10
    assert max(found['sizes']) <= 104


# Of each text its contrast with what is behind it (WCAG 2), and what stands in no landmark.
LOOK = """() => {
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


@pytest.mark.parametrize(
    ('size', 'scheme'), [(DESK, 'light'), (DESK, 'dark'), (PHONE, 'light'), (PHONE, 'dark')]
)
def test_everybody_can_read_it(
    browser: Browser, written: Path, size: tuple[int, int], scheme: Any
) -> None:
    """Every text is dark enough on its ground, and stands in a landmark with a name."""
    with opened(browser, written, size, color_scheme=scheme) as page:
        page.locator('#groups li:first-child button').click()
        page.locator('[data-tool=measure]').click()
        found = page.evaluate(LOOK)
        assert found['count'] > 80
        assert found['faint'] == []
        assert found['nowhere'] == []


def test_nothing_is_rejected_though_labels_say_so(desk: Page) -> None:
    """The page says what that may mean, and only then."""
    assert not desk.locator('#nothing').is_visible()
    move(desk, desk.evaluate('report.data().header.sliders[0].texts.length - 1'))
    assert counted(desk) == 0
    assert 'The labels call' in desk.locator('#nothing').inner_text()
    assert '--codes' in desk.locator('#nothing').inner_text()


def test_features_in_words(desk: Page) -> None:
    """What a feature is comes first, then the name that clouds have; as reason, and as part."""
    desk.locator('#groups li:first-child button').click()
    known: dict[str, str] = dict(desk.evaluate('report.data().header.features'))
    shown = desk.locator('#point .bars text:not([class])').all_text_contents()
    assert len(shown) > 3
    assert set(shown) <= set(known.values())
    assert desk.locator('#removed .removed b').nth(1).text_content() in known.values()
    assert not [text for text in known.values() if 'results' in text or len(text.split()) < 2]
