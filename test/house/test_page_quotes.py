# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of the pages run, and what the pages quote is what they say."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from helpers import ROOT, page_sources
from helpers.page_quotes import SOURCES, Quote
from helpers.page_runs import NOT_RUN, Pages, commands, pages, reason

if TYPE_CHECKING:
    from pathlib import Path

LONG = (pytest.mark.slow, pytest.mark.long)
RUN = [name for name in pages() if not all(map(reason, commands(ROOT / name)))]


@pytest.fixture(scope='module')
def runs(tmp_path_factory: pytest.TempPathFactory, real_data: Path) -> Pages:
    """Run each page once."""
    assert real_data.is_dir()
    return Pages(tmp_path_factory.mktemp('pages'))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize('name', RUN)
def test_commands_run(runs: Pages, name: str) -> None:
    """Every command of a page ends with the status of success."""
    said = runs.run(name).said
    assert said
    assert {line: text for line, (status, text) in said.items() if status != 0} == {}


def test_what_is_not_run_has_a_reason() -> None:
    """A command is one of ours, or it has a reason; no reason is left over."""
    lines = [line for name in pages() for line in commands(ROOT / name)]
    strangers = [line for line in lines if not reason(line)]
    assert [line for line in strangers if not line.startswith('lidar-outlier-filter ')] == []
    assert [one for one in NOT_RUN if not any(line.startswith(one) for line in lines)] == []


@pytest.mark.parametrize(
    'name',
    [
        pytest.param(name, marks=() if source is page_sources.tables else LONG)
        for name, (source, _) in SOURCES.items()
    ],
)
def test_quotations(runs: Pages, name: str) -> None:
    """Where this fails, ``cd test && python -m helpers.page_quotes`` rewrites the pages."""
    source, quotes = SOURCES[name]
    figures = source(runs)
    for quote in quotes:
        assert list(quote.search().groups()) == quote.expected(figures), quote.page


@pytest.mark.parametrize('quote', [one for _, quotes in SOURCES.values() for one in quotes])
def test_quotations_are_on_their_pages(quote: Quote) -> None:
    """Each stretch is there once, and quotes something."""
    assert quote.search().groups()


def test_quotations_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What differs is replaced, and nothing else of the page."""
    monkeypatch.setattr('helpers.page_quotes.ROOT', tmp_path)
    page = tmp_path / 'page.md'
    page.write_text('# Page\n\nIt rejects 12\nof 50 points, 12 by `lof`.\n', 'utf-8')
    quote = Quote('page.md', 'It rejects {count} of {points} points')
    assert quote.search().groups() == ('12', '50')
    quote.write({'count': '7', 'points': '50'})
    assert page.read_text() == '# Page\n\nIt rejects 7\nof 50 points, 12 by `lof`.\n'
