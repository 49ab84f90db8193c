# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is checked of the files of a recording before rosbags reads them, and of rosbags after."""

from __future__ import annotations

from functools import partial
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, cast

import yaml
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2.storage_mcap import McapReader

from lidar_outlier_filter.disk.sqlite_pages import check_pages
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.parameters.declaration import shown
from lidar_outlier_filter.recordings.remote_path import RemotePath
from lidar_outlier_filter.recordings.salvage.mcap_records import (
    Walk,
    complete,
    complete_from_summary,
    has_summary,
    walk,
)
from lidar_outlier_filter.recordings.unpack import bound_chunks, bound_mcap, unpack

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rosbags.rosbag2 import Reader as Reader2

    from lidar_outlier_filter.recordings.remote_path import RecordingPath

MOST_NODES = 1_000_000  # values of a metadata.yaml, aliases written out


def check_storage(path: RecordingPath, largest: int) -> Mapping[str, Walk]:
    """Refuse a recording whose files are not whole, or hold more than ``largest`` bytes at once.

    Return what was found in its MCAP files, by their names. Of those on a store, only the end is
    read; :func:`bound` checks what it says.

    Raises
    ------
    RecordingError
        With the sentence that says so.

    """
    walks: dict[str, Walk] = {}
    files: list[RecordingPath] = [*path.iterdir()] if path.is_dir() else [path]
    for file in sorted(files, key=str):
        if file.suffix == '.mcap' and file.is_file():
            if isinstance(file, RemotePath) and has_summary(file, largest):
                continue
            found = walk(file, largest)
            if found.wrong and found.whole:
                raise RecordingError(f'the recording {path}', 'readable', f'"{found.wrong}"')
            walks[file.name] = found
        elif file.suffix == '.db3' and file.is_file():
            if isinstance(file, RemotePath):
                raise RecordingError(f'the database {file}', 'copied to this machine', 'a store')
            check_pages(file, partial(_refuse, path))
    return walks


def _refuse(path: RecordingPath, wrong: str) -> RecordingError:
    return RecordingError(f'the recording {path}', 'readable', f'"{wrong}"')


def read_metadata(path: RecordingPath) -> dict[str, Any]:
    """Read what the ``metadata.yaml`` of a bag says of it; of a file, and where there is none, {}.

    Raises
    ------
    RecordingError
        If it becomes larger by aliases than anybody could write.
    YAMLError
        If it is no YAML.

    """
    file = path / 'metadata.yaml'
    if not (path.is_dir() and file.is_file()):
        return {}
    with file.open('rb') as stream:
        # The loader in C refuses names of files that are no text.
        loader = yaml.SafeLoader(stream)
        root = loader.get_single_node()
        sizes: dict[int, int] = {}
        if root is not None and _expanded(root, sizes) > MOST_NODES:
            raise RecordingError(f'{file}', f'of at most {MOST_NODES} values', 'more')
        data = None if root is None else loader.construct_document(root)
    bag = data.get('rosbag2_bagfile_information') if isinstance(data, dict) else None
    return bag if isinstance(bag, dict) else {}


def _expanded(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Count the values below a node, aliases written out; a node within itself counts as all."""
    if id(node) not in sizes:
        sizes[id(node)] = MOST_NODES
        sizes[id(node)] = 1 + sum(_expanded(one, sizes) for one in _children(node))
    return sizes[id(node)]


def _children(node: yaml.Node) -> Iterator[yaml.Node]:
    if isinstance(node, yaml.SequenceNode):
        yield from node.value
    elif isinstance(node, yaml.MappingNode):
        for pair in node.value:
            yield from pair


def whole_number(path: RecordingPath, what: str, number: object) -> int:
    """Refuse what should be a whole number and is none: in a folder it is a text like any other."""
    if type(number) is not int or number < 0:
        raise RecordingError(f'{what} in {path}', 'a whole number', f'"{shown(number)}"')
    return number


def texts_by_name(path: RecordingPath, data: object) -> Mapping[str, str]:
    """Refuse custom data that are not texts by name."""
    if isinstance(data, dict) and all(
        isinstance(text, str) for item in data.items() for text in item
    ):
        return data
    raise RecordingError(f'custom_data in {path}', 'texts by name', f'"{shown(data)}"')


def bound(
    reader: Reader1 | Reader2, walks: Mapping[str, Walk], largest: int
) -> Callable[[bytes], bytes]:
    """Bound what an open reader unpacks, and complete its index.

    Return what is to be done with the bytes of each message.
    """
    bound_mcap()
    if isinstance(reader, Reader1):
        bound_chunks(reader, largest)
        return bytes
    storage: Any = reader.storage
    for one in [storage, *getattr(storage, 'storages', ())]:
        name = PurePath(str(one.path)).name
        if isinstance(one, McapReader) and name in walks:
            complete(one, walks[name])
        elif isinstance(one, McapReader):
            complete_from_summary(cast('RecordingPath', one.path), one, largest)
    if storage.metadata.compression_mode != 'message':
        return _as_it_is
    # Unpacked here, so that it is bounded.
    storage.metadata = storage.metadata._replace(compression_mode=None)
    return partial(unpack, most=largest, compression='zstd')


def _as_it_is(data: bytes) -> bytes:
    return data
