# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Commands on a store that speaks S3: as on this machine, and one sentence for what goes wrong."""

from __future__ import annotations

import json
from dataclasses import replace as changed
from pathlib import Path
from typing import TYPE_CHECKING

import fsspec
import pytest
from helpers.drives import write_drive
from helpers.stores import Store, running_store
from lidar_outlier_filter.archive.manifest import (
    BROKEN_OFF,
    Entry,
    How,
    _line,
    begun,
    opened_manifest,
)

from lidar_outlier_filter.archive import one_recording, run, uploads
from lidar_outlier_filter.archive.fingerprints import content_hash
from lidar_outlier_filter.archive.locations import path_at
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lidar_outlier_filter.archive.task import Task

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

    Capture = pytest.CaptureFixture[str]

MCAP, BAG, LARGE = 'vlp16_mrpt_mcap', 'vlp16_mrpt.bag', 'hesai_xt32_nebula_mcap'
CHAIN = 'alpha_beta_gamma'
FAST = ['--set', f'chain=[{CHAIN}]', '--jobs', '1']


@pytest.fixture(scope='module')
def store(recordings: Path) -> Iterator[Store]:
    """Run a store with a bucket of two recordings, and an empty one."""
    with running_store() as store:
        drives = store.new_bucket('drives')
        store.new_bucket('cleaned')
        for file in (recordings / 'bags' / MCAP).iterdir():
            store.put(f'{drives}/one/{file.name}', file.read_bytes())
        store.put(f'{drives}/two.bag', (recordings / 'bags' / BAG).read_bytes())
        yield store


def content(path: RecordingPath) -> list[tuple[str, int, bytes]]:
    """Read all of a recording."""
    with Recording(path) as recording:
        return [(topic.name, time, data) for topic, time, data in recording.messages()]


@pytest.fixture
def archive(store: Store, recordings: Path) -> list[str]:
    """Empty the bucket of outputs, and give the command that fills it."""
    for key in store.keys('cleaned'):
        store.client.delete_object(Bucket='cleaned', Key=key)
    large = (recordings / 'bags' / LARGE / f'{LARGE}.mcap').read_bytes()
    store.put('s3://drives/large.mcap', large)
    return ['replay', 's3://drives', '--output', 's3://cleaned/all', *FAST]


def entries(store: Store) -> dict[str, dict[str, str]]:
    """Read the manifest, and what a run has added: what became of each recording, by its name."""
    names = [key for key in store.keys('cleaned') if '/.manifest/' in key]
    if 'all/manifest.jsonl' in store.keys('cleaned'):
        names.insert(0, 'all/manifest.jsonl')
    lines = b''.join(store.get(f's3://cleaned/{name}') for name in names).splitlines()
    return {Path(entry['source']).stem: entry for entry in map(json.loads, lines)}


def times(store: Store) -> dict[str, object]:
    """Find when the outputs were written."""
    return {
        key: store.client.head_object(Bucket='cleaned', Key=key)['LastModified']
        for key in store.keys('cleaned')
        if key.endswith('.mcap')
    }


@pytest.mark.slow
@pytest.mark.filterwarnings('ignore:.*:ResourceWarning')
def test_from_store_to_store(  # noqa: PLR0913  fixtures
    archive: list[str],
    store: Store,
    recordings: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    """Two processes give the bytes of a replay here; what changes meanwhile fails alone."""

    def change(task: Task, how: How) -> Entry:
        if task.location.path.name == 'two.bag':
            data = (recordings / 'bags' / BAG).read_bytes()
            store.put('s3://drives/two.bag', data + data[-1:])
        return begun(task, how)

    before = len(store.requests.lines)
    with monkeypatch.context() as patch:
        patch.setattr(run, 'begun', change)
        assert main([*archive, '--jobs', '2']) == 3
    for source, name in ((MCAP, 'one'), (LARGE, 'large')):
        replay(recordings / 'bags' / source, tmp_path / name, parameters={'chain': [CHAIN]})
        for file in (tmp_path / name).iterdir():
            assert store.get(f's3://cleaned/all/{name}/{file.name}') == file.read_bytes()
    found = entries(store)
    assert {name: entry['state'] for name, entry in found.items()} == {
        'one': 'done',
        'large': 'done',
        'two': 'failed',
    }
    assert 'two.bag must be unchanged while it is read' in found['two']['error']
    assert ':' in found['large']['worker']
    check_uploads(store.requests.lines[before:], 'all/large/large.mcap', 1)
    assert store.uploads('cleaned') == []
    assert not any(key.startswith('all/two/') for key in store.keys('cleaned'))
    store.put('s3://drives/two.bag', (recordings / 'bags' / BAG).read_bytes())
    written, reads = times(store), store.requests.count('GET /drives/large')
    assert main(archive) == 0
    assert {key: time for key, time in times(store).items() if 'two' not in key} == written
    keys, stored = store.keys('cleaned'), store.requests.count('PUT /cleaned/all/two')
    capsys.readouterr()
    assert main(archive) == 0
    assert '0 replayed, 3 done before, 0 failed' in ' '.join(capsys.readouterr())
    assert store.requests.count('GET /drives/large') == reads
    assert store.requests.count('PUT /cleaned/all/two') == stored
    assert store.keys('cleaned') == keys


def check_uploads(lines: list[str], key: str, parts: int) -> None:
    """Check that an object is made of parts at once, after them, and metadata come after it."""
    mine = [line for line in lines if f' /cleaned/{key}' in line and line[:3] != 'GET']
    puts = [line for line in mine if line.startswith('PUT')]
    assert len(puts) >= parts
    assert all('?partNumber=' in line for line in puts)
    (done,) = numbers(lines, f'POST /cleaned/{key}?uploadId')
    assert done > max(lines.index(line) for line in puts)
    (last,) = numbers(lines, f'POST /cleaned/{key.rpartition("/")[0]}/metadata.yaml?uploadId')
    assert last > done
    noted = numbers(lines, 'PUT /cleaned/all/.manifest/')
    assert noted[0] < min(lines.index(line) for line in mine)
    assert noted[-1] > last


def numbers(lines: list[str], start: str) -> list[int]:
    """Find the requests that begin so."""
    return [number for number, line in enumerate(lines) if line.startswith(start)]


def test_ctrl_c_leaves_its_manifest(
    archive: list[str], store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was done and what was begun is on the store; the next run does the rest."""

    def interrupt(location: Location) -> str:
        if location.path.name == 'one':
            raise KeyboardInterrupt
        return content_hash(location)

    monkeypatch.setattr(uploads, 'PART', 5 * 2**20)
    before = len(store.requests.lines)
    with monkeypatch.context() as patch:
        patch.setattr(one_recording, 'content_hash', interrupt)
        assert main(archive) == 130
    check_uploads(store.requests.lines[before:], 'all/large/large.mcap', 2)
    assert {name: (entry['state'], entry['error']) for name, entry in entries(store).items()} == {
        'large': ('done', None),
        'one': ('failed', BROKEN_OFF),
    }
    written = times(store)
    assert main(archive) == 0
    assert times(store)['all/large/large.mcap'] == written['all/large/large.mcap']
    assert {entry['state'] for entry in entries(store).values()} == {'done'}


@pytest.mark.parametrize('key', ['manifest.jsonl', '.manifest/000000001', '.manifest/000000002'])
def test_two_runs_that_write(
    archive: list[str], store: Store, monkeypatch: pytest.MonkeyPatch, capsys: Capture, key: str
) -> None:
    """A run ends when another one has written the manifest, which stays as that wrote it."""
    address = f's3://cleaned/all/{key}'

    def other(location: Location) -> str:
        if key != '.manifest/000000001':
            store.put(address, b'')
        return content_hash(location)

    def before(task: Task, how: How) -> Entry:
        if key == '.manifest/000000001':
            store.put(address, b'')
        return begun(task, how)

    monkeypatch.setattr(one_recording, 'content_hash', other)
    monkeypatch.setattr(run, 'begun', before)
    assert main(archive) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert 'manifest.jsonl must be written by one run at a time, got two that write' in said
    assert store.get(address) == b''
    names = {name.split('/')[1] for name in store.keys('cleaned')}
    assert ('large' in names) == (key != '.manifest/000000001')


def test_an_answer_that_is_lost(store: Store) -> None:
    """An object that is there already is ours, if it has our bytes: the store was asked twice."""
    folder = path_at(f'{store.new_bucket("asked-twice")}/out')
    with opened_manifest(folder) as manifest:
        manifest.add(entry := Entry('a', 1, 'h', 'p', 'v', 'm', 'a', 'done'))
        store.put('s3://asked-twice/out/.manifest/000000001', _line(entry))
        manifest.flush()
    with opened_manifest(folder) as manifest:
        assert manifest.entries == {'a': changed(entry, lost=[])}


def test_requests_are_as_many_as_recordings(store: Store, tmp_path: Path) -> None:
    """Requests, and bytes of the manifest, grow no faster than recordings; again, not at all."""
    drive = next(write_drive(tmp_path / 'drive', 6).glob('*.mcap')).read_bytes()
    asked: list[tuple[int, int, int]] = []
    for number in (10, 40):
        drives = store.new_bucket(f'tiny{number}')
        for one in range(number):
            store.put(f'{drives}/in/{one:05}.mcap', drive)
        words = ['replay', f'{drives}/in', '--output', f'{drives}/out', *FAST]
        for times in (1, 0):
            before = len(store.requests.lines)
            assert main(words) == 0
            lines = store.requests.lines[before:]
            puts = sum('PUT' in line and '.manifest/' in line for line in lines)
            assert puts == (number + 1) * times
            asked.append((number, len(lines), len(store.get(f'{drives}/out/manifest.jsonl'))))
    (_, few, small), (_, few_again, _), (_, many, large), (_, many_again, _) = asked
    assert 20 * 30 < many - few <= few / 10 * 30
    assert many_again == few_again < 30
    assert 3.9 < large / small < 4.1


def test_one_recording(store: Store, recordings: Path, tmp_path: Path, capsys: Capture) -> None:
    """A recording of a store is replayed to this machine, and described."""
    assert store.keys('drives')
    assert main(['replay', 's3://drives/one', '--output', str(tmp_path / 'far'), *FAST]) == 0
    replay(
        recordings / 'bags' / MCAP, tmp_path / 'near', parameters={'chain': ['alpha_beta_gamma']}
    )
    assert content(tmp_path / 'far') == content(tmp_path / 'near')
    capsys.readouterr()
    for address in ('s3://drives/one', 's3://drives/two.bag'):
        assert main(['info', address]) == 0
        assert '16 rings' in capsys.readouterr().out


@pytest.mark.usefixtures('store')
@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['replay', 's3://nowhere/x.mcap'], 's3://nowhere/x.mcap must be reached, got "The spec'),
        (['replay', 's3://nowhere'], 's3://nowhere must be reached, got "The specified bucket'),
        (
            ['replay', 's3://drives', '--output', 's3://nowhere/out'],
            'manifest.jsonl must be reached, got "The spec',
        ),
        (['replay', 's3://drives', '--output', 's3://drives/out'], 'must be outside of s3://driv'),
        (['info', 's3://nowhere/x.mcap'], 's3://nowhere/x.mcap must be reached, got "The specif'),
    ],
)
def test_what_is_not_there(
    arguments: list[str], sentence: str, tmp_path: Path, capsys: Capture
) -> None:
    """A bucket that is not there costs one sentence, and status 1."""
    if arguments[0] == 'replay':
        given = [] if '--output' in arguments else ['--output', str(tmp_path / 'out')]
        arguments = [*arguments, *given, *FAST]
    assert main(arguments) == 1
    said = capsys.readouterr().err.splitlines()
    assert sentence in said[-1]
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(
    ('missing', 'sentence'),
    [('network', 'got "Could not connect'), ('credentials', 'got "Unable to locate credentials"')],
)
def test_no_network_and_no_credentials(
    store: Store, missing: str, sentence: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Without either there is one sentence; what the other bucket holds stays as it is."""
    keys = store.keys('cleaned')
    system = fsspec.get_filesystem_class('s3')
    monkeypatch.setenv('AWS_MAX_ATTEMPTS', '1')
    if missing == 'network':
        monkeypatch.setenv('AWS_ENDPOINT_URL_S3', 'http://127.0.0.1:1')
    else:
        for name in ('AWS_ACCESS_KEY_ID', 'AWS_SECRET_ACCESS_KEY'):
            monkeypatch.delenv(name)
    system.clear_instance_cache()
    assert main(['replay', 's3://drives', '--output', 's3://cleaned/new', *FAST]) == 1
    system.clear_instance_cache()
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert sentence in said[0]
    assert store.keys('cleaned') == keys
