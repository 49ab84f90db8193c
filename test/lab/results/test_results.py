# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The sections of the results, the command itself, and the pages that it writes."""

from pathlib import Path

import numpy as np
import pytest

from lidar_outlier_filter.cli import terminal
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_lab.results import markdown, real_clouds


def quiet(_done: int, _total: int, _what: str) -> None:
    """Show no progress."""


def test_labelled_clouds(real_data: Path) -> None:
    """Artefacts are found by their class; a cloud without them is not used."""
    sample = real_clouds.labelled(real_data / 'clouds' / 'sample_lareunion_epsg2975.laz')
    assert sample is not None
    assert np.count_nonzero(sample.data.bad) == 3
    assert len(sample.data) == 59_712
    assert real_clouds.labelled(real_data / 'clouds' / 'plane.laz') is None


def test_without_real_clouds(tmp_path: Path) -> None:
    """A sentence says so."""
    assert 'There was no folder' in real_clouds.section(tmp_path / 'none', quiet)
    text = real_clouds.section(tmp_path, quiet)
    assert 'No cloud in `clouds` has points of the classes' in text
    assert 'None of the clean recordings could be reached.' in text


def test_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is written by hand stays; each part has its markers; a second run gives the same."""
    monkeypatch.setattr(terminal, 'LINE_PERIOD', 0)
    page = tmp_path / 'page.md'
    page.write_text('# By hand\n')
    command = ['results', '--output', str(page), '--quick', '--presets', 'sotoodeh-hod']
    command += ['--data', str(tmp_path / 'none'), '--sections', 'contest', 'real']
    assert main(command) == 0
    text = page.read_text()
    assert text.startswith('# By hand\n\n<!-- begin default')
    for part in ('default', 'contest', 'real'):
        assert f'<!-- end {part} -->' in text
    assert '| `hierarchical` |' in text
    said = capsys.readouterr()
    assert 'contest written to' in said.out
    # Where there is no terminal, lines say what goes on.
    assert said.err.startswith('results: section contest, 0 %\n')
    assert main([*command, '--sections', 'real']) == 0
    assert page.read_text() == text


def test_only_what_is_between_markers_changes(tmp_path: Path) -> None:
    """New sections stand at the end; text around sections is not touched; pictures are beside."""
    page, picture = tmp_path / 'doc' / 'page.md', tmp_path / 'some.png'
    picture.write_bytes(b'PNG')
    page.parent.mkdir()
    page.write_text('# Mine\n')
    for section in ('one', 'two'):
        markdown.write(page, section, f'text of {section}', [picture])
    text = page.read_text().replace('<!-- begin two', 'Between.\n\n<!-- begin two') + '\nAfter.\n'
    assert text.startswith('# Mine\n\n<!-- begin one')
    page.write_text(text)
    markdown.write(page, 'one', 'other')
    assert page.read_text() == text.replace('text of one', 'other')
    assert (page.parent / 'images' / 'some.png').read_bytes() == b'PNG'
    assert sorted(path.name for path in page.parent.iterdir()) == ['images', 'page.md']


def test_a_row_is_replaced_or_added(tmp_path: Path) -> None:
    """By its first cell; all other rows stay."""
    page = tmp_path / 'page.md'
    markdown.write(page, 'one', '| a | b |\n| --- | --- |\n| x | 1 |\n| y | 2 |', command='load')
    for row in (['x', '3'], ['z', '']):
        markdown.write_row(page, 'one', row, 'load')
    assert page.read_text().splitlines()[2:7] == [
        '| a | b |', '| --- | --- |', '| x | 3 |', '| y | 2 |', '| z | |'
    ]  # fmt: skip


@pytest.mark.parametrize('broken', [markdown.begin_of('one'), markdown.end_of('one')])
def test_a_broken_page_is_refused(tmp_path: Path, broken: str) -> None:
    """With one marker only nobody knows what to replace; nothing is written."""
    path = tmp_path / 'page.md'
    path.write_text(f'Mine.\n{broken}\n')
    with pytest.raises(RecordingError, match='markers of one must be both'):
        markdown.write(path, 'one', 'text')
    assert path.read_text() == f'Mine.\n{broken}\n'
