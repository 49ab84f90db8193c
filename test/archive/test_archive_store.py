# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Commands on a store that speaks S3: as on this machine, and one sentence for what goes wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import fsspec
import pytest
from helpers.stores import Store, running_store

from lidar_outlier_filter.archive import one_recording, run, uploads
from lidar_outlier_filter.archive.fingerprints import content_hash
from lidar_outlier_filter.archive.manifest import BROKEN_OFF, Entry, How, begun
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.task import Task
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
    """Read the manifest: what became of each recording, by its name."""
    lines = store.get('s3://cleaned/all/manifest.jsonl').splitlines()
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
    noted = numbers(lines, 'PUT /cleaned/all/manifest.jsonl')
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


def test_two_runs_that_write(
    archive: list[str], store: Store, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """A run ends when another one has written the manifest, which stays as that wrote it."""

    def other(location: Location) -> str:
        store.put('s3://cleaned/all/manifest.jsonl', b'')
        return content_hash(location)

    monkeypatch.setattr(one_recording, 'content_hash', other)
    assert main(archive) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert 'manifest.jsonl must be written by one run at a time, got two that write' in said
    assert store.get('s3://cleaned/all/manifest.jsonl') == b''


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
