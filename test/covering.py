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
import struct
import sys
import tempfile
from contextlib import redirect_stderr
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import atheris

# What is instrumented cannot be compiled, and kernels are to be covered, too.
os.environ['NUMBA_DISABLE_JIT'] = '1'

with atheris.instrument_imports(include=['lidar_outlier_filter', 'rosbags', 'laspy']):
    import laspy  # noqa: F401  those that would be imported later
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_typestore

    from lidar_outlier_filter.errors import CloudError, RecordingError
    from lidar_outlier_filter.files import cloud_file, las, parquet, pcd, ply, sqlite, text  # noqa: F401
    from lidar_outlier_filter.files.cloud_file import open_cloud
    from lidar_outlier_filter.messages.decoder import Decoder
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.recordings.bags import Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DATA = Path(__file__).resolve().parents[2] / 'shared' / 'data'
STORE = get_typestore(Stores.ROS2_JAZZY)
CLOUD = 'sensor_msgs/msg/PointCloud2'
POINTS = 12  # of a real cloud that are kept
LARGEST = 20_000  # bytes of an input
FILES = {
    'las': '.las',
    'laz': '.laz',
    'pcd': '.pcd',
    'ply': '.ply',
    'csv': '.csv',
    'parquet': '.parquet',
    'sqlite': '.db',
}


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
        from hostile import FORMATS, whole_file  # noqa: PLC0415  hypothesis takes a second

        for number, kind in enumerate(FORMATS):
            if kind.startswith(FILES[target][1:]):
                whole_file(kind, folder / f'{number}{FILES[target]}')
        for path in sorted((DATA / 'clouds').glob(f'*{FILES[target]}')):
            (folder / path.name).write_bytes(path.read_bytes()[:LARGEST])
    elif target == 'mcap':
        source = folder / 'made'
        clouds = list(islice(small_clouds(), 3))
        with Writer(source, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            topic = bag.add_connection('/points', CLOUD, typestore=STORE)
            for time, data in enumerate(clouds):
                bag.write(topic, time, data)
        (folder / 'small').write_bytes((source / 'made.mcap').read_bytes())
        for path in source.iterdir():
            path.unlink()
        source.rmdir()
    else:
        for number, data in enumerate(small_clouds()):
            (folder / str(number)).write_bytes(data)


def read_message(data: bytes) -> None:
    """Read a cloud as ``replay`` does, and decode it."""
    try:
        cloud: Any = STORE.deserialize_cdr(data, CLOUD)
    except SerdeError:
        return
    _refused(lambda: Decoder(FilterParameters()).decode(cloud))


def read_wire(data: bytes) -> None:
    """Read a cloud as the node does, and decode it: what rclpy refuses is refused."""
    from lidar_outlier_filter.ros import cdr  # noqa: PLC0415  needs ROS

    # What is beyond the layout is left to rclpy, which is not Python.
    order = cdr.PLAIN_CDR.get(data[:2])
    if order is None:
        return
    try:
        begin = cdr._find_data(data, order)
    except (struct.error, IndexError):
        return
    assert begin % 4 == 0
    assert begin <= len(data)


def read_file(path: Path, data: bytes) -> None:
    """Read all of a file of points."""
    path.write_bytes(data)

    def read() -> None:
        file = open_cloud(path)
        for _ in cloud_file.read_exact(file, list(file.columns)):
            pass

    _refused(read)


def read_recording(path: Path, data: bytes) -> None:
    """Read all messages of a recording."""
    path.write_bytes(data)

    def read() -> None:
        with Recording(path) as recording:
            for topic, _, message in recording.messages():
                if topic.msgtype == CLOUD:
                    read_message(message)

    _refused(read)


def _refused(work: Callable[[], object]) -> None:
    """Do it; or it is refused in one sentence."""
    try:
        work()
    except (CloudError, RecordingError) as err:
        assert '\n' not in str(err), err  # noqa: PT017  either is right
        assert ' must be ' in str(err), err  # noqa: PT017


def target_of(name: str, folder: Path) -> Callable[[bytes], None]:
    """Return what is done with an input."""
    if name in FILES:
        return lambda data: read_file(folder / f'input{FILES[name]}', data)
    if name == 'mcap':
        return lambda data: read_recording(folder / 'input.mcap', data)
    return {'decoder': read_message, 'cdr': read_wire}[name]


def main(name: str, seconds: int, found: Path) -> None:
    """Run until the time is over, or something is found; libFuzzer ends the process."""
    scratch = Path(tempfile.mkdtemp(dir=found))
    inputs = found / f'corpus_{name}'
    if not inputs.is_dir():
        inputs.mkdir()
        with redirect_stderr(io.StringIO()):
            corpus(name, inputs)
    work = target_of(name, scratch)
    options = [
        f'-max_total_time={seconds}',
        f'-max_len={LARGEST}',
        '-timeout=10',
        '-rss_limit_mb=4096',
        f'-artifact_prefix={found}/{name}_',
        '-print_final_stats=1',
    ]
    atheris.Setup([sys.argv[0], *options, str(inputs)], work)
    atheris.Fuzz()


if __name__ == '__main__':
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
