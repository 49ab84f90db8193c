# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Archives on a store that speaks S3: as on this machine, and one sentence for what goes wrong."""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import fsspec
import pytest
from helpers.archives import SET, content, replaying
from helpers.drives import hashes, write_drive
from helpers.stores import Store, running_store

from lidar_outlier_filter.archive import publish, sidecar
from lidar_outlier_filter.archive.locations import path_at
from lidar_outlier_filter.archive.sidecar import read_folder
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.remote_path import RemotePath

Capture = pytest.CaptureFixture[str]

NAMES = ('a', 'b', 'c')
ALL = 's3://cleaned/all'
SCORED = '--set=scores=true'


@pytest.fixture(scope='module')
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write three recordings here."""
    folder = tmp_path_factory.mktemp('drives')
    for number, name in enumerate(NAMES):
        write_drive(folder / name, 6, seed=number)
    return folder


@pytest.fixture(scope='module')
def expected(drives: Path, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, bytes]]:
    """Replay them to this machine, without scores and with them."""
    folders = [tmp_path_factory.mktemp(name) for name in ('plain', 'scored')]
    for folder, options in zip(folders, ([], [SCORED]), strict=True):
        assert main(replaying(drives, folder / 'out', *options)) == 0
    return [content(folder / 'out') for folder in folders]


@pytest.fixture(scope='module')
def running(drives: Path) -> Iterator[Store]:
    """Run a store with a bucket of the recordings, and one for outputs."""
    with running_store() as store:
        for bucket in ('drives', 'cleaned'):
            store.new_bucket(bucket)
        store.put_all(drives, 's3://drives/in')
        yield store


@pytest.fixture
def store(running: Store) -> Store:
    """Empty the bucket of outputs."""
    for key in running.keys('cleaned'):
        running.client.delete_object(Bucket='cleaned', Key=key)
    return running


def words(*options: str) -> list[str]:
    """Return the arguments that fill the bucket of outputs."""
    return replaying('s3://drives/in', ALL, *options)


def stored(store: Store) -> dict[str, bytes]:
    """Read the outputs on the store."""
    names = (key for key in store.keys('cleaned') if key.endswith(('.mcap', '.yaml')))
    return {key.removeprefix('all/'): store.get(f's3://cleaned/{key}') for key in names}


@pytest.mark.slow
@pytest.mark.filterwarnings('ignore:.*:ResourceWarning')
@pytest.mark.parametrize('jobs', ['1', '2'])
def test_from_store_to_store(store: Store, expected: list[dict[str, bytes]], jobs: str) -> None:
    """The bytes are those of a replay here; each output comes whole, its sidecar after it."""
    before = len(store.requests.lines)
    assert main(words('--jobs', jobs)) == 0
    assert stored(store) == expected[0]
    assert store.uploads('cleaned') == []
    assert not [key for key in store.keys('cleaned') if '/.' in key]
    lines = store.requests.lines[before:]
    for name in NAMES:
        order = [
            last(lines, f'PUT /cleaned/all/{name}/{name}.mcap?partNumber='),
            last(lines, f'POST /cleaned/all/{name}/{name}.mcap?uploadId'),
            last(lines, f'POST /cleaned/all/{name}/metadata.yaml?uploadId'),
            last(lines, f'PUT /cleaned/all/{name}.json'),
        ]
        assert order == sorted(order)
    assert last(lines, 'PUT /cleaned/all/archive.html') > max(order)


def last(lines: list[str], start: str) -> int:
    """Find the last request that begins so."""
    return max(number for number, line in enumerate(lines) if line.startswith(start))


def test_again(store: Store, drives: Path, capsys: Capture) -> None:
    """What is done is skipped by a few requests each, which read no recording."""
    assert main(words()) == 0
    keys, before = store.keys('cleaned'), len(store.requests.lines)
    capsys.readouterr()
    assert main(words()) == 0
    assert '0 replayed, 3 done before, 0 failed' in capsys.readouterr().out
    lines = store.requests.lines[before:]
    assert len(lines) <= 25 * len(NAMES)
    assert not [one for one in lines if one.startswith('GET') and '.mcap' in one]
    assert not [one for one in lines if one.startswith(('PUT', 'POST')) and '/.lock' not in one]
    assert store.keys('cleaned') == keys
    store.put('s3://drives/in/a/a.mcap', (drives / 'b' / 'b.mcap').read_bytes())
    try:
        main(words())
        assert '1 replayed, 2 done before' in capsys.readouterr().out
    finally:
        store.put_all(drives, 's3://drives/in')


@pytest.mark.parametrize('name', ['a/notes.txt', 'a/metadata.yaml', 'a.json', 'archive.html'])
@pytest.mark.parametrize('is_new', [True, False])
def test_a_foreign_object_is_refused(
    store: Store, capsys: Capture, name: str, *, is_new: bool
) -> None:
    """It is named, and stays, before the first run and after one that is done."""
    if not is_new:
        assert main(words()) == 0
    store.put(f'{ALL}/{name}', b'mine')
    capsys.readouterr()
    for options in ([], [SCORED]):
        assert main(words(*options)) in (1, 3)
        assert f'{ALL}/{name}, which exists' in capsys.readouterr().err
        assert store.get(f'{ALL}/{name}') == b'mine'


class KilledError(BaseException):
    """Ends a run as a kill does."""


STEPS = [(RemotePath, 'unlink', 1), (RemotePath, 'write_text', 2), (None, 'commit', 1)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ('step', 'options', 'last'),  # all pairs
    [(s, o, s[2] + len(o) * (i != 1)) for i, s in enumerate(STEPS) for o in ([], [SCORED])],
)
def test_killed_runs(  # noqa: PLR0913  fixtures
    store: Store,
    expected: list[dict[str, bytes]],
    monkeypatch: pytest.MonkeyPatch,
    options: list[str],
    step: tuple[Any, str, int],
    last: int,
) -> None:
    """Killed before an object is written, completed or removed, the next run ends it."""
    if options:
        assert main(words()) == 0
    home, name = step[0] or import_module('s3fs.core').S3File, step[1]
    known, calls = getattr(home, name), list[object]()

    def call(*given: Any, **more: Any) -> Any:
        calls.append(given)
        if len(calls) >= last:
            raise KilledError
        return known(*given, **more)

    with monkeypatch.context() as patch:
        patch.setattr(home, name, call)
        patch.setattr(publish, '_discard', lambda stream: setattr(stream, 'closed', True))
        with pytest.raises(KilledError):
            main(words(*options))
    monkeypatch.setattr(publish, 'PATIENCE_S', 0.1)
    assert main(words(*options)) == 0
    assert stored(store) == expected[len(options)]
    assert not [key for key in store.keys('cleaned') if '/.' in key]
    assert len(read_folder(path_at(ALL))) == len(NAMES)


def test_an_upload_that_fails_is_given_up(
    store: Store, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Nothing is left on the store, nor any part, and the sentence names the output."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(5, 'Input/output error')

    before = store.uploads('cleaned')
    monkeypatch.setattr(sidecar, 'as_text', fail)
    assert main(words()) == 1
    assert 'Input/output error' in capsys.readouterr().err
    assert not stored(store)
    assert store.uploads('cleaned') == before


def test_one_run_at_a_time(store: Store, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    """While a run renews its lock, another is refused, and writes nothing."""
    monkeypatch.setattr(publish, 'RENEWAL_S', 0.1)
    monkeypatch.setattr(publish, 'PATIENCE_S', 1.0)
    with publish.locked(path_at(ALL)):
        assert main(words()) == 1
        assert len(store.keys('cleaned')) == 1
    assert f'got {ALL}, where another run works' in capsys.readouterr().err
    assert not store.keys('cleaned')


def test_one_recording(store: Store, drives: Path, tmp_path: Path, capsys: Capture) -> None:
    """A recording of a store is replayed to this machine or to the store, and described."""
    assert main(['replay', str(drives / 'a'), '--output', str(tmp_path / 'a'), SET]) == 0
    assert main(['replay', 's3://drives/in/a', '--output', str(tmp_path / 'x' / 'a'), SET]) == 1
    (tmp_path / 'x').mkdir()
    assert main(['replay', 's3://drives/in/a', '--output', str(tmp_path / 'x' / 'a'), SET]) == 0
    assert hashes(tmp_path / 'x' / 'a') == hashes(tmp_path / 'a')
    for status in (0, 1):
        assert main(['replay', str(drives / 'a'), '--output', f'{ALL}/a', SET]) == status
    here = {f'a/{file.name}': file.read_bytes() for file in (tmp_path / 'a').iterdir()}
    assert stored(store) == here
    with Recording(path_at(f'{ALL}/a')) as recording:
        assert recording.message_count
    capsys.readouterr()
    assert main(['info', 's3://drives/in/a']) == 0
    assert '/lidar' in capsys.readouterr().out


@pytest.mark.usefixtures('running')
@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['replay', 's3://nowhere/x.mcap'], 's3://nowhere/x.mcap must be reached, got "The spec'),
        (['replay', 's3://nowhere'], 's3://nowhere must be reached, got "The specified bucket'),
        (['replay', 's3://drives/in', '--output', 's3://nowhere/out'], 'must be reached, got "The'),
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
        arguments = [*arguments, *given, SET]
    assert main(arguments) == 1
    assert sentence in capsys.readouterr().err.splitlines()[-1]
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
    assert main(words()) == 1
    system.clear_instance_cache()
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert sentence in said[0]
    monkeypatch.undo()
    assert store.keys('cleaned') == keys
