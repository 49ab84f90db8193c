# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page in a browser: Chromium without a screen, WebGL in software, nothing from the network."""

from __future__ import annotations

import csv
import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import laspy
import numpy as np
import pyproj
import pytest
from helpers.browsers import new_tab
from helpers.profile_scanner import REPLAYED, Drive, write
from helpers.report_pages import (
    DESKTOP,
    PHONE,
    STATE,
    counted,
    move,
    near,
    opened,
    pixels,
    positions,
    read_message,
    wait_for_drawing,
)
from naive import groups as naive

from lidar_outlier_filter.evaluation.judged import CAUSES
from lidar_outlier_filter.evaluation.labels import ALL_BUT_0
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.report.gather import gather
from lidar_outlier_filter.report.page import messages
from lidar_outlier_filter.report.page import page as page_of
from lidar_outlier_filter.report.sources import FileSource, RecordedSource

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

    from lidar_outlier_filter.report.gather import Gathered

FOOT = 0.3048
# Points that nothing else hides: [frame, index, x, y, position] of at most two, far apart.
FREE_POINTS = """(what) => {
  const { view, data, state } = window.report;
  const found = [];
  const box = document.getElementById('canvas').getBoundingClientRect();
  view().seen(state, (f, index, [u, v]) => {
    if (found.length >= 2 || u < 300 || v < 90 || u > box.width - 60 || v > box.height - 90) return;
    const frame = data().frames[f];
    if (what === 'explained' && !frame.columns.why[3 * index]) return;
    const [x, y] = [Math.round(u), Math.round(v)];
    if (found.length && Math.hypot(x - found[0][2], y - found[0][3]) < 60) return;
    if (view().pick(x, y, state).index !== index) return;
    const [a, b] = frame.words.subarray(4 * index, 4 * index + 2);
    const steps = [a & 0x1fffff, (a >>> 21) | ((b & 0x3ff) << 11), b >>> 10];
    const there = steps.map((step, k) => frame.origin[k] + frame.step[k] * step);
    found.push([f, index, x, y, there]);
  });
  return found;
}"""


# How many neighbours of the chosen point are in the picture.
NEIGHBOURS = """() => {
  const { view } = window.report;
  const box = document.getElementById('canvas').getBoundingClientRect();
  const where = view().marks[0].geometry.attributes.position.array;
  let inside = 0;
  for (let k = 0; k < where.length; k += 3) {
    const at = view().project([0, 1, 2].map((a) => where[k + a] + view().centre[a]));
    inside += at && at[0] > 0 && at[1] > 0 && at[0] < box.width && at[1] < box.height;
  }
  return inside;
}"""


@pytest.fixture(scope='module')
def desktop(browser: Browser, written: Path) -> Iterator[Page]:
    """Open the page as on a desk."""
    with opened(browser, written, DESKTOP) as page:
        wait_for_drawing(page)
        yield page


def text_of(page: Page, name: str) -> str:
    """Read a text, with plain spaces."""
    return re.sub(r'[\u202f\xa0]', ' ', page.locator(name).first.inner_text())


def test_pictures(desktop: Page) -> None:
    """Points are drawn, each colouring differs, points that are near the threshold light up."""
    times = desktop.evaluate('window.report.times')
    assert times['start'] <= times['decoded'] <= times['first']
    seen = []
    for mode in range(6):
        desktop.locator('#mode').select_option(str(mode))
        seen.append(pixels(desktop))
        assert seen[-1].std() > 10
    for one, other in pairwise(seen):
        assert (np.abs(one - other).max(axis=2) > 24).sum() > 50
    desktop.locator('#mode').select_option('0')
    rejected, blue = near(pixels(desktop), '#c8500a'), near(pixels(desktop), '#0072b2')
    assert rejected > 100
    desktop.locator('#show').select_option('1')
    assert near(pixels(desktop), '#0072b2') > blue
    desktop.locator('#show').select_option('3')
    assert near(pixels(desktop), '#c8500a') < 20
    desktop.locator('#show').select_option('0')
    desktop.locator('#size').fill('6')
    wait_for_drawing(desktop)
    assert near(pixels(desktop), '#c8500a') > 1.5 * rejected
    desktop.locator('#size').fill('2')


def test_slider(desktop: Page, found: Gathered, snow: Path, tmp_path: Path) -> None:
    """It counts what a replay rejects, everywhere; it names the settings."""
    slider = found.sliders[0]
    step = slider.given - 3
    move(desktop, step)
    value = slider.values[step]
    (topic,) = replay(snow, tmp_path / 'out', parameters={slider.name: value}).topics
    assert counted(desktop) == topic.rejected
    assert f'{slider.name}: {value}' in text_of(desktop, '#yaml')
    assert text_of(desktop, '#lines') == (
        f'ros2 param set /outlier_filter_node {slider.name} {value}'
    )
    counts = found.counts[0][step]
    assert text_of(desktop, '#precision') == f'{100 * counts.bad / counts.points:.2f} %'
    total = f'{found.all.points:,}'.replace(',', ' ')
    for name in ('#lead', '#count', '#found'):
        assert f'{total} measured points' in text_of(desktop, name)
    assert not desktop.locator('#nothing').is_visible()
    move(desktop, len(slider.values) - 1)
    assert counted(desktop) == 0
    assert 'The labels call' in text_of(desktop, '#nothing')
    move(desktop, slider.given)
    assert counted(desktop) == found.counts[0][slider.given].points


@pytest.mark.parametrize('count', [0, 1, 2, 60, 400])
def test_groups_are_those_of_loops(desktop: Page, count: int) -> None:
    """Random points, dense and sparse, near and far from the origin."""
    rng = np.random.default_rng(count)
    xyz = rng.uniform(-3, 3, (count, 3)) + rng.choice([0.0, 3e6])
    label = np.array(desktop.evaluate('(one) => [...report.connect(one)]', xyz.ravel().tolist()))
    ours = {frozenset(np.flatnonzero(label == one).tolist()) for one in np.unique(label)}
    assert ours == {frozenset(group) for group in naive.connect(xyz.tolist())}


def test_groups_follow_the_slider(desktop: Page, found: Gathered) -> None:
    """Groups of the points that the step rejects, frame by frame, the largest first."""
    slider = found.sliders[0]
    step = slider.given - 2
    move(desktop, step)
    desktop.wait_for_function('report.state.found.bit === report.state.bit')
    sizes: list[int] = []
    (content,) = messages(found)
    known, parts, _ = read_message(content)
    for frame, words in zip(known['frames'], parts, strict=True):
        there = words[:, 3] >> np.uint32(slider.first + step) & 1 != 0
        xyz = positions(frame, words)[there]
        sizes += [len(group) for group in naive.connect(xyz.tolist())]
    listed = desktop.evaluate('report.state.found.groups.map((one) => one.count)')
    assert listed == sorted(sizes, reverse=True)[: len(listed)]
    assert desktop.evaluate('report.state.found.total') == len(sizes) > len(listed)
    assert f'{slider.name} {slider.values[step]}' in text_of(desktop, '#groups-about')
    move(desktop, slider.given)
    desktop.wait_for_function('report.state.found.bit === report.state.bit')


def test_a_group_of_one_point(desktop: Page) -> None:
    """It has coordinates in the list; why it is rejected is in words; nothing scrolls."""
    single = desktop.evaluate("""() => {
      // Of a block with many rejected points, some are explained.
      const explained = (one) => report.data().frames[one.frame].columns.why[3 * one.worst];
      const distance = (one) => (one.count === 1 && explained(one) ? Math.hypot(...one.low) : 0);
      const far = report.state.found.groups.map((one, i) => [distance(one), i]);
      return far.sort((a, b) => b[0] - a[0])[0][1];
    }""")
    before = desktop.evaluate("document.querySelector('#canvas').getBoundingClientRect().top")
    button = desktop.locator('#groups button').nth(single)
    assert re.search(r'1 point\s+-?\d+\.\d, -?\d+\.\d, -?\d+\.\d m', button.inner_text())
    button.click()
    facts = text_of(desktop, '#facts')
    distance = re.search(r'nearest drawn ones ([\d.]+) m', facts)
    assert distance is not None
    why = text_of(desktop, '#point .why')
    assert f'alone: nearest return {float(distance[1]):.1f} m' in why
    known = dict(desktop.evaluate('report.data().header.features.map(([a, b]) => [b, a])'))
    assert any(f'{text} {name}, +' in why for text, name in known.items())
    assert not [text for text in known if 'log-odds' in text]
    # Neither the picture nor the page moved.
    desktop.locator('#groups li:last-child button').click()
    after = desktop.evaluate("document.querySelector('#canvas').getBoundingClientRect().top")
    assert after == before
    desktop.locator('[data-view=orbit]').click()


def test_points_are_clicked_and_measured(desktop: Page, found: Gathered) -> None:
    """Score and marks of a point; the distance of two; a scale bar as long as it says."""
    wait_for_drawing(desktop)
    number, index, x, y, _ = desktop.evaluate(FREE_POINTS, 'explained')[0]
    desktop.locator('#canvas').click(position={'x': x, 'y': y})
    score = float(found.points['score'][found.frames.first[number] + index])
    said = re.search(r'score\s+(\S+)', text_of(desktop, '#facts'))
    assert said is not None
    assert float(said[1]) == pytest.approx(score, rel=1e-3)
    assert 'rejected by boosted_trees' in text_of(desktop, '#facts')
    assert desktop.locator('#ring').is_visible()
    assert desktop.evaluate('window.report.view().marks.every((mark) => mark.visible)')

    (*_, x1, y1, one), (*_, x2, y2, other) = desktop.evaluate(FREE_POINTS, 'any')
    desktop.locator('[data-tool=measure]').click()
    desktop.locator('#canvas').click(position={'x': x1, 'y': y1})
    desktop.locator('#canvas').click(position={'x': x2, 'y': y2})
    metres = float(np.linalg.norm(np.subtract(one, other)))
    said = re.search(r'distance\s+([\d.]+) m', text_of(desktop, '#tool'))
    assert said is not None
    assert float(said[1]) == pytest.approx(metres, abs=0.001)
    assert desktop.locator('#overlay text.distance').text_content() == f'{metres:.2f} m'
    desktop.keyboard.press('Escape')
    assert not desktop.locator('#tool').is_visible()

    desktop.locator('[data-view=top]').click()
    wait_for_drawing(desktop)
    length = float((desktop.locator('#scale-text').text_content() or '').split()[0])
    across = desktop.evaluate(
        """(metres) => {
      const { view } = window.report;
      const [x, y, z] = view().centre;
      return view().project([x + metres, y, z])[0] - view().project([x, y, z])[0];
    }""",
        length,
    )
    drawn = desktop.locator('#overlay .scale').get_attribute('d') or ''
    assert float(drawn.split('h')[1].split('v')[0]) == pytest.approx(across, rel=1e-3)
    assert desktop.locator('#overlay line[class^=axis]').count() == 3
    desktop.locator('[data-view=orbit]').click()


def save_box(page: Page, path: Path) -> list[dict[str, str]]:
    """Drag a box over the middle of the picture; read the points that are saved."""
    page.locator('[data-tool=box]').click()
    box = page.locator('#canvas').bounding_box()
    assert box is not None
    x, y = box['x'] + box['width'] / 2, box['y'] + box['height'] / 2
    page.mouse.move(x - 120, y - 90)
    page.mouse.down()
    page.mouse.move(x + 100, y + 80, steps=3)
    page.mouse.up()
    with page.expect_download() as download:
        page.locator('#save-csv').click()
    download.value.save_as(path)
    return list(csv.DictReader(path.read_text().splitlines()))


def test_box_is_saved_with_the_values_of_its_points(
    desktop: Page, found: Gathered, tmp_path: Path
) -> None:
    """Each line has the index of its point, and what the cloud has of it, exactly."""
    rows = save_box(desktop, tmp_path / 'some.csv')
    assert len(rows) == desktop.evaluate('report.state.selected.length') > 100
    begin = found.frames.first[desktop.evaluate('report.state.frame')]
    frame = found.points[begin : found.frames.first[found.frames.first > begin].min()]
    frame = frame[np.argsort(frame['index'])]
    points = frame[[int(row['index']) for row in rows]]
    xyz = np.array([[row[axis] for axis in 'xyz'] for row in rows], float)
    assert np.abs(xyz - points['xyz']).max() < 1e-3
    intensity = np.array([row['intensity'] for row in rows], np.float32)
    assert np.array_equal(intensity, points['intensity'])
    assert [row['time'] for row in rows] == [f'{t // 10**9}.{t % 10**9:09}' for t in points['t']]
    assert [row['rejected'] == '1' for row in rows] == points['rejected'].tolist()
    assert {row['detector'] for row in rows if row['rejected'] == '1'} == {'boosted_trees'}
    assert {row['truth'] for row in rows} <= {'good', 'outlier'}
    before = text_of(desktop, '#tool')
    move(desktop, 0)
    assert text_of(desktop, '#tool') != before
    move(desktop, found.sliders[0].given)
    desktop.keyboard.press('Escape')


def test_keyboard_and_frames(desktop: Page, found: Gathered) -> None:
    """Tab reaches the canvas, the sliders and the groups; keys turn, fly, and choose."""
    desktop.locator('#whole').click()
    wait_for_drawing(desktop)
    assert len({*re.findall(r'\d+ \d+', text_of(desktop, '#shown'))}) == 1
    desktop.locator('#single').click()
    desktop.locator('h1').click()  # Tab goes on from there
    reached: list[str] = []
    while 'canvas' not in reached and len(reached) < 40:
        desktop.keyboard.press('Tab')
        reached.append(desktop.evaluate('document.activeElement.id'))
    assert reached[:2] == ['mode', 'show']
    where = 'window.report.view().camera.position.toArray().map((one) => one.toFixed(4)).join()'
    seen = {desktop.evaluate(where)}
    for key in ('ArrowLeft', 'ArrowUp', 'w', 'a', 'e', '+', '2', '1'):
        desktop.keyboard.press(key)
        seen.add(desktop.evaluate(where))
    assert len(seen) >= 7
    desktop.keyboard.press('?')
    assert desktop.locator('#keys').is_visible()
    desktop.keyboard.press('Escape')
    assert not desktop.locator('#keys').is_visible()
    desktop.keyboard.press('g')
    assert 'score' in text_of(desktop, '#facts')
    while desktop.evaluate('document.activeElement.id') != 'slider-0':
        desktop.keyboard.press('Tab')
    desktop.keyboard.press('ArrowRight')
    slider = found.sliders[0]
    assert counted(desktop) == found.counts[0][slider.given + 1].points
    desktop.keyboard.press('ArrowLeft')


def test_address_keeps_the_view(browser: Browser, desktop: Page, written: Path) -> None:
    """Opened again, slider, colour, what is shown, and the eye are as they were."""
    desktop.locator('[data-view=top]').click()
    desktop.locator('#canvas').focus()
    for key in ('+', '+', 'w', ']'):
        desktop.keyboard.press(key)
    desktop.locator('#mode').select_option('2')
    desktop.locator('#show').select_option('2')
    move(desktop, 3)
    what = """[...report.view().pose,
      ...['step', 'mode', 'show', 'frame'].map((name) => report.state[name])]"""
    eye = 'report.view().pose.map((value) => Number(value.toFixed(3))).join()'
    desktop.wait_for_function(f"location.hash.includes('value=') && location.hash.endsWith({eye})")
    page = new_tab(browser, viewport={'width': DESKTOP[0], 'height': DESKTOP[1]})
    page.goto(written.as_uri() + desktop.evaluate('location.hash'))
    page.wait_for_selector('html[data-ready=yes]')
    assert page.evaluate(what) == pytest.approx(desktop.evaluate(what), abs=1e-3)
    page.goto('about:blank')
    page.goto(written.as_uri() + '#value=x&slider=y&frame=z&colour=99&eye=1,2&size=-3')
    page.wait_for_selector('html[data-ready=yes]')
    page.context.close()


def test_large_pictures_begin_with_a_sample(desktop: Page) -> None:
    """Slice by slice every point is drawn once, the rejected and an even sample first."""
    found = desktop.evaluate("""async () => {
      const { Slices, evenOrder, ranges } = await import('shaders');
      const frame = { marked: 300, count: 1000 };
      const [slices, order] = [new Slices(100), evenOrder(frame)];
      const times = new Uint8Array(1000);
      const sizes = [];
      while (!slices.done) {
        let size = 0;
        for (const [first, many] of ranges(frame, 120, slices.next(120, 880))) {
          size += many;
          for (let i = first; i < first + many; i += 1) times[order[i]] += 1;
        }
        sizes.push(size);
      }
      const some = [...order.subarray(300, 370)].sort((a, b) => a - b);
      const gaps = some.slice(1).map((value, k) => value - some[k]);
      return { sizes, once: times.every((one) => one === 1), gap: Math.max(...gaps) };
    }""")
    assert found['once']
    assert len(found['sizes']) >= 10
    assert max(found['sizes']) <= 104
    assert found['gap'] < 30  # of 70 points among 700


# --- Other pages -------------------------------------------------------------------------------


def test_a_chain_in_the_dark(browser: Browser, snow: Path, tmp_path: Path) -> None:
    """What a detector rejects can be hidden; a dashed line for the slider, one for the others."""
    parameters = FilterParameters().changed({'chain': ['sor', 'boosted_trees']})
    found = gather(RecordedSource(snow, parameters), CAUSES, 20_000)
    (tmp_path / 'chain.html').write_text(page_of(found), encoding='utf-8')
    with opened(browser, tmp_path / 'chain.html', DESKTOP, color_scheme='dark') as page:
        wait_for_drawing(page)
        assert np.median(pixels(page)) < 64
        many = near(pixels(page), '#ff8c42')
        page.locator('[data-detector=sor]').uncheck()
        wait_for_drawing(page)
        few = near(pixels(page), '#ff8c42')
        page.locator('[data-detector=boosted_trees]').uncheck()
        wait_for_drawing(page)
        assert many > few > near(pixels(page), '#ff8c42') < 60  # of the legend
        assert page.locator('#charts .limit').count() == 1
        move(page, 1)
        assert page.locator('#charts .limit').count() == 2
        said = text_of(page, '#removed .removed')
        shown = [
            int(re.sub(r'\D', '', one)) for one in re.findall(r'[\d ]*\d\s*$', said, re.MULTILINE)
        ]
        assert sum(shown) == found.counts[0][1].points
        assert found.sliders[0].name in text_of(page, '#removed-text')


def test_a_drive(tmp_path: Path, browser: Browser) -> None:
    """The path of the sensor is a line in the picture, and the legend names it."""
    bag = write(tmp_path / 'drive', Drive(0.4))
    found = gather(RecordedSource(bag, FilterParameters().changed(REPLAYED)), ALL_BUT_0, 10**6)
    (tmp_path / 'report.html').write_text(page_of(found), encoding='utf-8')
    with opened(browser, tmp_path / 'report.html', DESKTOP) as page:
        wait_for_drawing(page)
        assert text_of(page, '#legend').split('\n') == ['rejected', 'path of the sensor']
        assert page.locator('#overlay .path').count() > 0


def test_a_file_in_feet(tmp_path: Path, browser: Browser) -> None:
    """Coordinates, lengths and saved points are in the unit of the file, with its columns."""
    rng = np.random.default_rng(3)
    las = laspy.create(point_format=3, file_version='1.2')
    las.header.add_crs(pyproj.CRS.from_epsg(2992))
    las.header.scales, las.header.offsets = np.full(3, 0.01), np.array([636000.0, 849000, 400])
    xyz = rng.uniform((636_000, 849_000, 400), (636_200, 849_150, 400.2), (4000, 3))
    xyz[17, 2] = 520
    las.xyz = xyz
    las.intensity = rng.integers(0, 60_000, len(xyz))
    las.gps_time = 245_000.0 + 1e-5 * np.arange(len(xyz))
    las.return_number, las.classification = np.arange(len(xyz)) % 5, np.full(len(xyz), 2)
    las.red, las.green, las.blue = (np.full(len(xyz), part << 8) for part in (0x20, 0xC0, 0x40))
    las.write(str(path := tmp_path / 'feet.las'))
    found = gather(FileSource(path, FilterParameters(), truth=(path, '')), ALL_BUT_0, 10**6)
    (tmp_path / 'report.html').write_text(page_of(found), encoding='utf-8')
    with opened(browser, tmp_path / 'report.html', DESKTOP) as page:
        wait_for_drawing(page)
        assert 'as in the file, ft' in text_of(page, '#found')
        assert 'NAD83 / Oregon' in text_of(page, '#found')
        assert not page.locator('#time').is_visible()
        assert 'running node' not in text_of(page, '#settings')
        for label, colour, legend in (
            ('RGB', '#20c040', 'rejected'),
            ('class', '#009e73', 'class 2'),
            ('return number', '#56b4e9', 'return 4'),
        ):
            assert near(pixels(page), colour) < 20
            page.locator('#mode').select_option(label=label)
            wait_for_drawing(page)
            assert near(pixels(page), colour) > 300
            assert legend in text_of(page, '#legend')
        page.locator('#groups button').first.click()
        x, y, z = las.xyz[17]
        assert f'{x:.1f}, {y:.1f}, {z:.1f} ft' in text_of(page, '#groups')
        assert f'{x:.2f}, {y:.2f}, {z:.2f} ft' in text_of(page, '#facts')
        assert re.match(r'alone: nearest return 1(19|20)\.\d ft', text_of(page, '#point .why'))
        assert page.evaluate(NEIGHBOURS) == 8  # 120 ft away
        page.locator('[data-view=top]').click()
        wait_for_drawing(page)
        bar = page.locator('#scale-text').text_content() or ''
        drawn = page.locator('#overlay .scale').get_attribute('d') or ''
        length = float(drawn.split('h')[1].split('v')[0]) * page.evaluate(
            'report.view().metresPerPixel'
        )
        assert bar == f'{round(length / FOOT)} ft'
        rows = save_box(page, tmp_path / 'some.csv')
        index = [int(row['index']) for row in rows]
        for name, values in (
            ('intensity', las.intensity),
            ('gps_time', las.gps_time),
            ('class', las.classification),
            ('return_number', las.return_number),
        ):
            assert [float(row[name]) for row in rows] == np.array(values)[index].tolist()
        saved = np.array([[row[axis] for axis in 'xyz'] for row in rows], float)
        assert np.abs(saved - las.xyz[index]).max() < 1e-3


def test_without_webgl(browser: Browser, written: Path) -> None:
    """Pictures instead, and the sliders work all the same."""
    none = """const given = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
      return kind.startsWith('webgl') ? null : given.call(this, kind, ...more);
    };"""
    with opened(browser, written, DESKTOP, none) as page:
        assert 'Pictures only' in text_of(page, '#shown')
        canvases = "[...document.querySelectorAll('.flat')].map((one) => one.toDataURL())"
        before, many = page.evaluate(canvases), counted(page)
        move(page, 0)
        assert counted(page) > many
        assert all(one != other for one, other in zip(before, page.evaluate(canvases), strict=True))
        assert len(before) == 2


@pytest.mark.parametrize(('size', 'scheme'), [(PHONE, 'light'), (PHONE, 'dark')])
def test_everybody_can_read_it(
    browser: Browser, written: Path, size: tuple[int, int], scheme: Any
) -> None:
    """Every text has contrast and a landmark; nothing lies beside the screen, or under a button."""
    with opened(browser, written, size, color_scheme=scheme, has_touch=True) as page:
        page.locator('#groups li:first-child button').click()
        page.locator('[data-tool=measure]').click()
        found = page.evaluate(STATE)
        assert found['count'] > 80
        assert found['faint'] == []
        assert found['nowhere'] == []
        assert page.evaluate('document.documentElement.scrollWidth') <= size[0]
        assert text_of(page, '.kind') == 'lidar-outlier-filter · report'
        pixels = "map => parseFloat(map.getContext('2d').font) * map.clientWidth / map.width"
        assert page.eval_on_selector('#charts canvas', pixels) > 11  # of the labels of the map
        for name in ('yaml', 'lines'):
            text = page.locator(f'#{name}').bounding_box()
            button = page.locator(f'[data-copy={name}]').bounding_box()
            assert text is not None
            assert button is not None
            assert button['y'] + button['height'] <= text['y']
