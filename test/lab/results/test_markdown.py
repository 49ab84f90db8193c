# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A page that people write in as well: only what is between the markers changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_lab.results import markdown

if TYPE_CHECKING:
    from pathlib import Path


def test_what_is_new_stands_at_the_end() -> None:
    """What is there stays as it is."""
    page = markdown.put('# Mine\n\nWords.\n', 'one', 'first')
    assert page.startswith('# Mine\n\nWords.\n\n<!-- begin one')
    assert page.endswith('first\n\n<!-- end one -->\n')


def test_only_what_is_between_markers_changes() -> None:
    """Text before, between and after sections is not touched, and twice the same is the same."""
    page = markdown.put(markdown.put('# Mine\n', 'one', 'first'), 'two', 'second')
    page = page.replace('<!-- begin two', 'Between.\n\n<!-- begin two') + '\nAfter.\n'
    changed = markdown.put(page, 'one', 'other')
    assert changed == page.replace('first', 'other')
    assert markdown.put(changed, 'one', 'first') == page


@pytest.mark.parametrize('broken', [markdown.begin_of('one'), markdown.end_of('one')])
def test_a_broken_page_is_refused(tmp_path: Path, broken: str) -> None:
    """With one marker only nobody knows what to replace; nothing is written."""
    path = tmp_path / 'page.md'
    path.write_text(f'Mine.\n{broken}\n')
    with pytest.raises(RecordingError, match='markers of one must be both'):
        markdown.write(path, 'one', 'text')
    assert path.read_text() == f'Mine.\n{broken}\n'


def test_pictures_go_beside_the_page(tmp_path: Path) -> None:
    """Page, folder and pictures are made, and replaced."""
    picture = tmp_path / 'some.png'
    picture.write_bytes(b'PNG')
    page = tmp_path / 'doc' / 'page.md'
    page.parent.mkdir()
    for text in ('first', 'second'):
        markdown.write(page, 'one', text, [picture])
    assert 'second' in page.read_text()
    assert (page.parent / 'images' / 'some.png').read_bytes() == b'PNG'
    assert sorted(path.name for path in page.parent.iterdir()) == ['images', 'page.md']
