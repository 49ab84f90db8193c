# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of an archive: what is odd is named, nothing is lost, and it opens anywhere."""

from __future__ import annotations

import re
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers.archives import archive, failed, record
from helpers.browsers import new_tab
from helpers.report_pages import STATE
from hypothesis import given, settings
from hypothesis import strategies as st

from lidar_outlier_filter.archive.page import MAX_BARS, page, size, write_page
from lidar_outlier_filter.archive.publish import locked
from lidar_outlier_filter.archive.rows import compare, length, robust_z

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser

    from lidar_outlier_filter.archive.sidecar import ArchiveRecord


def written(lines: list[ArchiveRecord], folder: Path) -> None:
    """Write a page, as the run that holds the lock of the folder."""
    with locked(folder):
        write_page(lines, folder)


def test_files_are_clouds_without_a_length() -> None:
    """Their page speaks of files, and has no column or sum that only recordings have."""
    text = page(archive(40), 'file')
    heads = re.findall(r'<th scope="col"[^>]*>([^<]*)', text)
    assert heads == ['file', 'odd', 'points', 'rejected', 'by detector', 'untested', 'done']
    cells = [row.count('<td') for row in text.split('<tr id=')[1:]]
    assert cells == [len(heads) - 1] * 40
    assert [
        word for word in ('recording', 'clouds', 'real time', 'length') if f'>{word}' in text
    ] == []


@settings(deadline=None)  # the machine may be busy
@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.floats(1e-4, 0.1))
def test_robust_z(values: list[float], least: float) -> None:
    """It is the distance from the median in median absolute deviations, as loops compute them."""
    middle = median(values)
    deviation = max(1.4826 * median(abs(value - middle) for value in values), least)
    found = robust_z(np.array(values), least)
    np.testing.assert_allclose(found, [(v - middle) / deviation for v in values], atol=1e-12)


def test_odd_recordings_come_first_with_their_sentences() -> None:
    """Each oddness is named, and nothing else is odd."""
    found = compare(archive(60))
    assert {
        row.record.source[-9:-5]: [row.record.error] if row.record.is_failed else row.odd
        for row in found[:8]
    } == {
        '0005': [
            'the recording <b>.mcap must be readable, got "an end at byte 7 without a footer"'
        ],
        '0023': [
            'no point of /lidar could be tested: lof needs more points',
            '0 % of the points rejected, median 0.2 % (z −20)',
            '100 % of the points untested, median 0.01 % (z +9,999)',
        ],
        '0008': ['3 of 200 clouds refused'],
        '0018': ['17 messages not found in the recording'],
        '0028': ['2 losses, the first: a chunk at byte 7 is cut off'],
        '0003': [
            '2.1 % of the points rejected, median 0.2 % (z +190)',
            '2 % of the points rejected by sor, median 0.07 % (z +193)',
        ],
        '0013': ['2.5 % of the clouds after a gap, median 0 % (z +25)'],
        '0033': [
            '0 % of the points rejected, median 0.2 % (z −20)',
            '0 % of the points rejected by boosted_trees, median 0.15 % (z −15)',
            '0 % of the points rejected by sor, median 0.07 % (z −7)',
        ],
    }
    assert not any(row.odd for row in found[8:])
    assert [abs(row.z) for row in found[5:]] == sorted(
        (abs(row.z) for row in found[5:]), reverse=True
    )


def test_few_recordings_are_not_compared() -> None:
    """Four recordings have no median worth the name; the page says so."""
    lines = [record(name, rejected=10**i) for i, name in enumerate('abcd')]
    assert not any(row.odd or row.z for row in compare(lines))
    assert 'Fewer than 5 recordings are done' in page(lines)
    assert 'Fewer than' not in page([*lines, record('e')])


def test_several_topics_are_summed() -> None:
    """A recording of two sensors counts the points of both."""
    counts = record('two').topics['/lidar']
    topics = {'/lidar': counts, '/rear': {**counts, 'rejected_by': {'sor': 9}}}
    (row,) = compare([record('two', topics=topics)])
    assert [row.sums[name] for name in ('points', 'messages', 'rejected')] == [2_000_000, 400, 4000]
    assert row.rejected_by == {'boosted_trees': 1500, 'sor': 709}


@pytest.mark.parametrize('lines', [[], [failed('one', 'it failed')], [record('x', points=0)]])
def test_small_archives(lines: list[ArchiveRecord]) -> None:
    """None, one that failed and one without points make a page, too."""
    text = page(lines)
    assert text.count('<tr id=') == len(lines)
    assert 'nan' not in text
    assert 'inf %' not in text


def test_nothing_is_fetched_and_nothing_is_markup() -> None:
    """The page names no other address, and a name of a file stays text."""
    text = page([record('<script>alert(1)</script>&"\'.mcap'), failed('b', '<img src=x>')])
    assert '<script>alert' not in text
    assert '<img' not in text
    assert not re.search(r'(src|href)="(?!#|\./)|@import|url\(', text)


def test_names_lead_to_what_was_made(tmp_path: Path) -> None:
    """Folder and name, the output, the report on it; when all was done, and by what."""
    lines = [record('day 1/a.mcap', output='day 1/a'), record('b', output='b', code='2.0.0+d')]
    lines += [record('c', output='c', finished='2026-03-04T01:02:03+00:00')]
    lines += [failed('d', 'no <way>')]
    (tmp_path / 'b_report.html').touch()
    written(lines, tmp_path)
    text = (tmp_path / 'archive.html').read_text()
    assert '<b>b</b> <a href="./b/">output</a> <a href="./b_report.html">report</a><' in text
    assert 'day 1/<b>a.mcap</b> <a href="./day%201/a/">output</a><' in text
    assert '<b>d</b><small class="failed" tabindex="0" title="no &lt;way&gt;">no' in text
    assert (
        '>done 2026-03-01 to 2026-03-04, by version 1.0.0+abc, parameters 0123456789ab (2); '
        '2.0.0+d, parameters 0123456789ab (1)<'
    ) in text
    assert '<td data-sort="2026-03-04T01:02:03+00:00"' in text
    assert '<a href="./out/e">output</a>' in page([record('e')], 'file')
    before = (tmp_path / 'archive.html').stat().st_ino
    written(lines, tmp_path)
    assert (tmp_path / 'archive.html').stat().st_ino == before
    written(lines[1:], tmp_path)
    assert (tmp_path / 'archive.html').read_text() != text
    assert len([*tmp_path.iterdir()]) == 2


def test_many_recordings_share_bars() -> None:
    """The picture has a bar for several recordings where they are many, and says so."""
    text = page(archive(3 * MAX_BARS))
    assert text.count('<rect') == MAX_BARS
    assert 'the largest of 3 recordings each' in text
    assert text.count('<tr id=') == 3 * MAX_BARS


def test_a_failed_recording_is_below_the_line() -> None:
    """Its mark has another place than bars, the smallest of which is a share."""
    text = page([record('a', rejected=900_000), record('b', rejected=1), failed('c', 'no')])
    bars = re.findall(r'<rect class="(\w+)" .* y="([\d.]+)" .* height="([\d.]+)"', text)
    assert re.findall(r'<line .*y1="(\d+)"', text) == ['60']
    assert bars == [('plain', '0.0', '60.0'), ('plain', '59.0', '1.0'), ('failed', '61.0', '5.0')]


def test_units() -> None:
    """Times and sizes are written as people do."""
    seconds = (0.25, 59.4, 61, 3661)
    assert [length(s) for s in seconds] == ['0.25 s', '59.4 s', '1 min 01 s', '1 h 01 min']
    assert [size(b) for b in (999, 1.5e6, 1e14)] == ['999 B', '1.5 MB', '100 TB']


@pytest.mark.parametrize('width', [390, 1280])
def test_thousands_of_recordings(browser: Browser, tmp_path: Path, width: int) -> None:
    """The first 1000 are shown, all on demand; a long sentence stays on its line.

    On a phone, where a line is short, that of a failed recording is shown whole.
    """
    lines = archive(3000)
    lines[9] = failed(lines[9].source, 'a sentence that is longer than its line ' * 9)
    written(lines, tmp_path)
    tab = new_tab(browser, viewport={'width': width, 'height': 900})
    tab.goto((tmp_path / 'archive.html').as_uri())
    shown = "[...document.querySelectorAll('tbody tr')].filter(row => row.offsetHeight).length"
    assert tab.evaluate(shown) == 1000
    assert tab.evaluate('document.documentElement.scrollWidth') == width
    long = 'tbody small.failed[title^="a sentence"]'
    lines_high = 'node => node.offsetHeight / parseFloat(getComputedStyle(node).lineHeight)'
    assert tab.eval_on_selector(long, lines_high) < 1.5 or width == 390
    assert tab.eval_on_selector('tbody small.odd', lines_high) < 1.5
    is_cut = 'node => node.scrollWidth > node.clientWidth'
    assert tab.eval_on_selector(long, is_cut) == (width > 390)
    wide = tab.eval_on_selector(long, 'node => node.offsetWidth')
    assert wide > (950 if width > 390 else 120)  # over the cells beside it, which are empty
    tab.evaluate("location.hash = '#r2900'")
    assert tab.evaluate(shown) == 1001
    tab.locator('#all').check()
    assert tab.evaluate(shown) == 3000
    tab.context.close()


def test_it_sorts_in_a_browser(browser: Browser, tmp_path: Path) -> None:
    """Every head sorts by its numbers, by key too; there is no error, and no request."""
    written(archive(40), tmp_path)
    tab = new_tab(browser)
    wrong: list[str] = []
    tab.on('console', lambda line: wrong.append(line.text))
    tab.on('pageerror', lambda error: wrong.append(str(error)))
    tab.on('request', lambda request: wrong.append(request.url))
    tab.goto((tmp_path / 'archive.html').as_uri())
    heads = tab.locator('thead button')
    for column in range(heads.count()):
        is_text = column in (0, heads.count() - 1)
        for click in range(2):
            heads.nth(column).press('Enter')
            values = tab.eval_on_selector_all(
                'tbody tr', f'rows => rows.map(row => row.cells[{column}].dataset.sort)'
            )
            known = values if is_text else [float(value or -1) for value in values]
            assert known == sorted(known, reverse=is_text == bool(click))
            assert len(values) == 40
    assert wrong == [tab.url]
    tab.context.close()


@pytest.mark.parametrize(('scheme', 'scripts'), [('light', True), ('dark', True), ('light', False)])
def test_it_is_readable(browser: Browser, tmp_path: Path, scheme: Any, *, scripts: bool) -> None:
    """On a phone nothing sticks out; the text stands out from its ground; without JS, too."""
    written(archive(40), tmp_path)
    phone = {'width': 390, 'height': 844}
    tab = new_tab(browser, viewport=phone, color_scheme=scheme, java_script_enabled=scripts)
    tab.goto((tmp_path / 'archive.html').as_uri())
    assert tab.locator('tbody tr').count() == 40
    if scripts:
        assert tab.evaluate('document.documentElement.scrollWidth') == 390
        assert tab.evaluate(STATE)['faint'] == []
    tab.context.close()
