# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings on a store: found, read by ranges, copied within limits."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.stores import Store, running_store

from lidar_outlier_filter.archive import locations
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings import remote_path
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.remote_path import RemotePath

MCAP, BAG, DATABASE = 'vlp16_mrpt_mcap', 'vlp16_mrpt.bag', 'vlp16_mrpt_db3'


@pytest.fixture(scope='module')
def store(recordings: Path) -> Iterator[Store]:
    """Run a store with a bucket of three recordings: the same sweeps in three formats."""
    with running_store() as store:
        drives = store.new_bucket('drives')
        for name in (MCAP, BAG, DATABASE):
            store.put_all(recordings / 'bags' / name, f'{drives}/2026/{name}')
        store.put(f'{drives}/2026/notes.txt', b'rain')
        store.put(f'{drives}/2026/.{MCAP}.partial-1/metadata.yaml', b'left by a run')
        yield store


def content(path: remote_path.RecordingPath) -> list[tuple[str, int, bytes]]:
    """Read all of a recording."""
    with Recording(path) as recording:
        return [(topic.name, time, data) for topic, time, data in recording.messages()]


@pytest.mark.parametrize('pattern', ['', '/2026', '/2026/*', '/2*/vlp*'])
def test_recordings_are_found(store: Store, pattern: str) -> None:
    """A bucket, a folder and patterns give every recording once; nothing else."""
    found = locations.find(f's3://drives{pattern}')
    names = [f's3://drives/2026/{name}' for name in (BAG, DATABASE, MCAP)]
    assert [str(location.path) for location in found] == names
    assert [location.by_ranges for location in found] == [False, False, True]
    (etag,) = {
        one['ETag'].strip('"')
        for one in store.client.list_objects_v2(Bucket='drives', Prefix=f'2026/{BAG}')['Contents']
    }
    assert found[0].state == f'etag:{etag}'


def test_local_recordings_are_found_alike(recordings: Path) -> None:
    """A folder of this machine gives what its copy on a store gives, with the same sizes."""
    bags = recordings / 'bags'
    found = locations.find(str(bags / 'vlp16*'))
    assert [location.path for location in found] == [bags / BAG, bags / DATABASE, bags / MCAP]
    sizes = [sum(f.stat().st_size for f in (bags / n).iterdir()) for n in (DATABASE, MCAP)]
    assert [location.size for location in found] == [(bags / BAG).stat().st_size, *sizes]
    assert locations.find(f'file://{bags / MCAP}') == found[2:]


@pytest.mark.parametrize('name', [MCAP, BAG, DATABASE])
def test_a_store_gives_the_same_messages(store: Store, recordings: Path, name: str) -> None:
    """Every message of a recording is read from a store as from this machine."""
    (location,) = locations.find(f's3://drives/2026/{name}')
    with locations.staged(location) as path:
        assert isinstance(path, RemotePath) == (name == MCAP)
        assert content(path) == content(recordings / 'bags' / name)
    assert isinstance(path, RemotePath) or not path.exists()
    assert store.uploads('drives') == []


def test_ranges_are_read_once(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening reads the ends of a file; reading all fetches hardly more ranges than it has."""
    monkeypatch.setattr(remote_path, 'BLOCK', 2**17)
    (location,) = locations.find(f's3://drives/2026/{MCAP}')
    file = f'GET /drives/2026/{MCAP}/{MCAP}.mcap'
    before = store.requests.count(file)
    with Recording(location.path) as recording:
        opened = store.requests.count(file) - before
        assert list(recording.messages())
    ranges = location.size // 2**17 + 1
    assert opened <= 5
    assert store.requests.count(file) - before < ranges + opened + 2


def test_a_damaged_end_is_walked(store: Store, recordings: Path) -> None:
    """A file without its end, or without an index, is refused or read as from this machine."""
    data = (recordings / 'bags' / MCAP / f'{MCAP}.mcap').read_bytes()
    store.new_bucket('damaged')
    address = store.put('s3://damaged/cut.mcap', data[:-100])
    with pytest.raises(RecordingError, match=r's3://damaged/cut\.mcap must be readable, got "'):
        content(locations.path_at(address))
    # The footer names no summary: all that is known is in the records.
    bare = bytearray(data)
    bare[-28:-12] = bytes(16)
    address = store.put('s3://damaged/bare.mcap', bytes(bare))
    assert content(locations.path_at(address)) == content(recordings / 'bags' / MCAP)


def test_a_large_recording_is_not_copied(store: Store) -> None:
    """What has more bytes than a copy may have is refused, before a byte is copied."""
    (location,) = locations.find(f's3://drives/2026/{BAG}')
    before = store.requests.count('GET /drives/2026')
    refused = pytest.raises(RecordingError, match=f'of at most 1000 bytes.*, got {location.size}')
    with refused, locations.staged(location, most=1000):
        pass
    assert store.requests.count('GET /drives/2026') == before


def test_a_change_is_noticed(
    store: Store, recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording that is replaced while it is read is refused, on a store and here."""
    data = (recordings / 'bags' / MCAP / f'{MCAP}.mcap').read_bytes()
    address = store.put(f'{store.new_bucket("changing")}/one.mcap', data)
    local = tmp_path / 'one.mcap'
    local.write_bytes(data)
    monkeypatch.setattr(remote_path, 'BLOCK', 2**15)
    found = [*locations.find(str(local)), *locations.find(address)]
    for location in found:
        location.check_unchanged()
    with Recording(found[1].path) as reading:
        next(messages := reading.messages())
        store.put(address, data[::-1])
        with pytest.raises(RecordingError, match=r'must be readable, got "The remote .* no lo'):
            list(messages)
    local.write_bytes(data[::-1])
    for location in found:
        with pytest.raises(RecordingError, match='must be unchanged while it is read, got 1'):
            location.check_unchanged()


@pytest.mark.parametrize(
    ('address', 'sentence'),
    [
        ('s3://drives/2027', 'what is at s3://drives/2027 must be a recording, a folder of'),
        ('s3://drives/2026/*.mcap', 'what is at .* must be a recording, .*, got no recording'),
        ('nosuch://drives/2026', 'the address nosuch://drives/2026 must be reached, got "Protocol'),
        ('/nosuch/*.mcap', 'what is at /nosuch.* must be a recording, .*, got no recording'),
    ],
)
@pytest.mark.usefixtures('store')
def test_what_is_not_there(address: str, sentence: str) -> None:
    """No recording and no such store are refused in one sentence each."""
    with pytest.raises(RecordingError, match=sentence) as caught:
        locations.find(address)
    assert '\n' not in str(caught.value)


def test_files_below_a_hidden_folder(tmp_path: Path) -> None:
    """Hidden files and folders are passed over, but not what the given folder itself lies in."""
    folder = tmp_path / '.cache' / 'survey'
    for name in ('a.las', 'below/b.LAS', '.c.las', '.old/d.las', 'notes.md'):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    found = locations.find_files(folder, ('.las',))
    assert [str(path.relative_to(folder)) for path in found] == ['a.las', 'below/b.LAS']
