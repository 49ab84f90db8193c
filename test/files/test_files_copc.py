# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""COPC: a copy has the same octree, by laspy's own reader, and every other byte of the file."""

import struct
from pathlib import Path

import numpy as np
import pytest
from helpers.cloud_files import columns, copied, every_third, number, patch, verdict
from helpers.copc import INFO, levels, write_copc

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, open_cloud

ROOT = INFO + 40  # offset and bytes of the root page
COUNT = 366


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Write a file of four nodes in two pages, and one without points."""
    write_copc(tmp_path / 'made.copc.laz')
    return tmp_path / 'made.copc.laz'


def test_without_a_change(path: Path) -> None:
    """The copy is the file, byte for byte."""
    assert copied(path, Change()).read_bytes() == path.read_bytes()


def test_marks(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each level has its points with their marks; header and records are kept.

    The points come in blocks that end within nodes, and with one.
    """
    monkeypatch.setattr('lidar_outlier_filter.files.las.CHUNK_ROWS', 13)
    before, known = levels(path), path.read_bytes()
    assert [len(one) for one in before] == [25, 340, 1, 0]
    after = copied(path, Change(noise=np.ones(COUNT, np.bool_)))
    for old, new in zip(before, levels(after), strict=True):
        old['classification'] = 7
        np.testing.assert_array_equal(new, old)
    written, points = after.read_bytes(), number(known, 96, 4)
    moved = {*range(235, 243), *range(ROOT, ROOT + 8)}
    assert {at for at in range(points) if known[at] != written[at]} <= moved
    assert written[-9:] == b'kept, too'
    np.testing.assert_array_equal(columns(after, 'gps_time'), columns(path, 'gps_time'))


def test_left_out_and_added(path: Path) -> None:
    """Nodes lose points, some of them all; added columns are in each level."""
    keep, added = every_third(COUNT), verdict(COUNT)
    keep[40:66] = False  # the root, and the only node of level 2
    after = copied(path, Change(keep=keep, added=added))
    found = levels(after)
    assert [len(one) for one in found] == [0, keep.sum(), 0, 0]
    times = np.concatenate([one['gps_time'] for one in found])
    scores = np.concatenate([one['outlier_score'] for one in found])
    by_time = dict(zip(columns(path, 'gps_time')[0], added['outlier_score'], strict=True))
    np.testing.assert_array_equal(scores, [by_time[time] for time in times])
    assert b'COPC extents' not in after.read_bytes()
    assert copied(after, Change(), 'again.copc.laz').read_bytes() == after.read_bytes()


def test_clean(path: Path) -> None:
    """COPC is cleaned to COPC, whose name says so, and to LAZ if the name of the output does."""
    assert main(['clean', str(path), '--chain', 'sor', '--rejected', 'separate']) == 0
    parts = [levels(path.with_name(f'made_{one}.copc.laz')) for one in ('cleaned', 'outliers')]
    for old, *new in zip(levels(path), *parts, strict=True):
        assert sorted(np.concatenate(new)['gps_time']) == sorted(old['gps_time'])
    plain = path.with_name('plain.laz')
    assert main(['clean', str(path), '--chain', 'sor', '--output', str(plain)]) == 0
    assert open_cloud(plain).octree is None


def _entry(data: bytes, number_of: int) -> int:
    """Return where an entry of the root page is."""
    return number(data, ROOT, 8) + 32 * number_of


HOSTILE = {
    'a page that is its own': (3, '<Q', 16, 'referred to once'),
    'a page behind the file': (3, '<Q', 16, 'a page of the octree of .* must be from byte'),
    'a page of 2 GiB': (3, '<i', 24, 'the bytes in a page of the octree'),
    'a page of -1 bytes': (3, '<i', 24, 'the bytes in a page of the octree'),
    'a node elsewhere': (0, '<Q', 16, 'the points of the nodes of .* must be behind'),
    'a node of no bytes': (0, '<i', 24, 'the points of the nodes of .* must be behind'),
    'more points': (0, '<i', 28, 'the nodes of .* must be of 366 points, as it says, got 2147'),
    'a count of -2': (0, '<i', 28, 'the points of a node of .* must be at least 0, got -2'),
}
VALUES = {
    'a page behind the file': 2**63,
    'a page of 2 GiB': 2**31 - 32,
    'a page of -1 bytes': -1,
    'a node elsewhere': 2**64 - 1,
    'a node of no bytes': 0,
    'more points': 2**31 - 1,
    'a count of -2': -2,
}


@pytest.mark.parametrize('case', HOSTILE)
def test_hostile_octrees(path: Path, case: str, capsys: pytest.CaptureFixture[str]) -> None:
    """They are refused in one sentence before anything is judged; as LAZ they are read."""
    entry, kind, at, sentence = HOSTILE[case]
    data = path.read_bytes()
    value = VALUES.get(case, number(data, ROOT, 8))
    patch(path, _entry(data, entry) + at, struct.pack(kind, value))
    with pytest.raises(CloudError, match=sentence):
        copied(path, Change())
    assert main(['clean', str(path), '--chain', 'sor']) == 1
    assert capsys.readouterr().err.count('\n') <= 2
    assert [one.name for one in path.parent.glob('*.laz')] == [path.name]
    assert len(columns(path, 'x')[0]) == COUNT


def test_chunks_that_are_not_nodes(path: Path) -> None:
    """Points that would get into other nodes are refused."""
    data = path.read_bytes()
    first, second = (number(data, _entry(data, one) + 28, 4) for one in (0, 2))
    patch(path, _entry(data, 0) + 28, struct.pack('<i', first + 1))
    patch(path, _entry(data, 2) + 28, struct.pack('<i', second - 1))
    with pytest.raises(CloudError, match='other chunks than those of its octree'):
        copied(path, Change())
