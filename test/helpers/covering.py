# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A run that is guided by coverage, of one reader: ``python covering.py TARGET SECONDS FOLDER``.

atheris (libFuzzer) changes inputs of a corpus, and keeps those that reach code that none has
reached. The corpus is made of small files, and of what is cut from real recordings beside the
project. An input that breaks a promise is written to the folder, and ends the run.
"""

from __future__ import annotations

import io
import os
import sys
import tempfile
import time
from contextlib import redirect_stderr
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import atheris

# What is instrumented cannot be compiled, and kernels are to be covered, too.
os.environ['NUMBA_DISABLE_JIT'] = '1'

with atheris.instrument_imports(include=['lidar_outlier_filter', 'rosbags', 'laspy']):
    import laspy  # noqa: F401  those that would be imported later
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_typestore

    from lidar_outlier_filter.errors import CloudError, RecordingError
    from lidar_outlier_filter.files import cloud_file, las, parquet, pcd, ply, sqlite, text  # noqa: F401
    from lidar_outlier_filter.files.cloud_file import open_cloud
    from lidar_outlier_filter.messages.decoder import Decoder
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.recordings.bags import LARGEST, Recording
    from lidar_outlier_filter.recordings.salvage import salvaged

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DATA = Path(__file__).resolve().parents[3] / 'shared' / 'data'
STORE, OLD_STORE = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
CLOUD = 'sensor_msgs/msg/PointCloud2'
POINTS = 12  # of a real cloud that are kept
LONGEST = 40_000  # bytes of an input
SLOWEST = 10.0  # seconds on the processor that an input may take
FILES = {
    'las': '.las',
    'laz': '.laz',
    'pcd': '.pcd',
    'ply': '.ply',
    'ptx': '.ptx',
    'csv': '.csv',
    'parquet': '.parquet',
    'sqlite': '.db',
}
RECORDINGS = {'mcap': '.mcap', 'db3': '.db3', 'bag': '.bag'}


def small_clouds() -> Iterator[bytes]:
    """Cut the first points out of a cloud of each real recording, as the bytes of a message."""
    for path in sorted((DATA / 'bags').iterdir()):
        with Recording(path) as recording:
            for topic, _, data in recording.messages():
                if topic.msgtype == CLOUD:
                    cloud: Any = STORE.deserialize_cdr(data, CLOUD)
                    step = cloud.point_step
                    cloud.height, cloud.width, cloud.row_step = 1, POINTS, POINTS * step
                    cloud.data = cloud.data[: POINTS * step]
                    yield bytes(STORE.serialize_cdr(cloud, CLOUD))
                    break


def corpus(target: str, folder: Path) -> None:
    """Write the inputs to begin with."""
    if target in FILES:
        sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
        from helpers.hostile import FORMATS, whole_file  # noqa: PLC0415  hypothesis takes a second

        for number, kind in enumerate(FORMATS):
            if kind.startswith(FILES[target][1:]):
                whole_file(kind, folder / f'{number}{FILES[target]}')
        for path in sorted((DATA / 'clouds').glob(f'*{FILES[target]}')):
            (folder / path.name).write_bytes(path.read_bytes()[:LONGEST])
    elif target in RECORDINGS:
        with tempfile.TemporaryDirectory() as scratch:
            made = recording(target, Path(scratch) / 'made', list(islice(small_clouds(), 3)))
            (folder / 'small').write_bytes(made.read_bytes())
    else:
        for number, data in enumerate(small_clouds()):
            (folder / str(number)).write_bytes(data)


def recording(target: str, path: Path, clouds: list[bytes]) -> Path:
    """Write serialised clouds into a small recording."""
    if target == 'bag':
        with Writer1(path) as old:
            link = old.add_connection('/points', CLOUD, typestore=OLD_STORE)
            for time_ns, data in enumerate(clouds):
                old.write(link, time_ns, STORE.cdr_to_ros1(data, CLOUD))
        return path
    plugin = StoragePlugin.MCAP if target == 'mcap' else StoragePlugin.SQLITE3
    with Writer2(path, version=9, storage_plugin=plugin) as bag:
        topic = bag.add_connection('/points', CLOUD, typestore=STORE)
        for time_ns, data in enumerate(clouds):
            bag.write(topic, time_ns, data)
    return path / f'{path.name}{RECORDINGS[target]}'


def read_message(data: bytes) -> None:
    """Read a cloud as ``replay`` does, and decode it."""
    try:
        cloud: Any = STORE.deserialize_cdr(data, CLOUD)
    except SerdeError:
        return
    _refused(lambda: Decoder(FilterParameters()).decode(cloud))


def wire_reader() -> Callable[[bytes], None]:
    """Return what reads a cloud as the node does, and decodes it."""
    with atheris.instrument_imports(include=['lidar_outlier_filter']):
        from lidar_outlier_filter.ros.endpoints import read_cloud  # noqa: PLC0415  needs ROS

    def read(data: bytes) -> None:
        _refused(lambda: Decoder(FilterParameters()).decode(read_cloud(data)))

    return read


def read_file(path: Path, data: bytes) -> None:
    """Read all of a file of points."""
    path.write_bytes(data)

    def read() -> None:
        file = open_cloud(path)
        for _ in cloud_file.read_exact(file, list(file.columns)):
            pass

    _refused(read)


def read_recording(path: Path, data: bytes) -> None:
    """Read all messages of a recording; salvage it, if it is refused."""
    path.write_bytes(data)
    if not _refused(lambda: _read_messages(path)):
        _refused(lambda: _salvage(path))


def _read_messages(path: Path) -> None:
    with Recording(path) as source:
        for topic, _, message in source.messages():
            if topic.msgtype == CLOUD:
                read_message(message)


def _salvage(path: Path) -> None:
    with salvaged(path, path.with_name('output'), LARGEST) as (copy, _):
        _read_messages(copy)


def _refused(work: Callable[[], object]) -> bool:
    """Do it, and return whether it was done; or it is refused in one sentence."""
    try:
        work()
    except (CloudError, RecordingError) as err:
        assert str(err).isprintable(), err  # noqa: PT017  either is right
        assert ' must be ' in str(err), err  # noqa: PT017
        return False
    return True


def target_of(name: str, folder: Path) -> Callable[[bytes], None]:
    """Return what is done with an input."""
    if name in FILES:
        return lambda data: read_file(folder / f'input{FILES[name]}', data)
    if name in RECORDINGS:
        return lambda data: read_recording(folder / f'input{RECORDINGS[name]}', data)
    return wire_reader() if name == 'cdr' else read_message


def timed(work: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """Hold that no input takes long. Time on the processor counts: the machine may be paused."""

    def run(data: bytes) -> None:
        begin = time.process_time()
        work(data)
        assert time.process_time() - begin < SLOWEST

    return run


def main(name: str, seconds: int, found: Path) -> None:
    """Run until the time is over, or something is found; libFuzzer ends the process."""
    scratch = Path(tempfile.mkdtemp(dir=found))
    inputs = found / f'corpus_{name}'
    if not inputs.is_dir():
        inputs.mkdir()
        with redirect_stderr(io.StringIO()):
            corpus(name, inputs)
    work = timed(target_of(name, scratch))
    options = [
        f'-max_total_time={seconds}',
        f'-max_len={LONGEST}',
        '-timeout=600',
        '-report_slow_units=600',
        '-rss_limit_mb=4096',
        f'-artifact_prefix={found}/{name}_',
        '-print_final_stats=1',
    ]
    atheris.Setup([sys.argv[0], *options, str(inputs)], work)
    atheris.Fuzz()


if __name__ == '__main__':
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
