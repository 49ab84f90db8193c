# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A store that speaks S3, on this machine, for the tests of archives."""

import logging
import re
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import boto3
import fsspec
import pytest
from moto.server import ThreadedMotoServer

SETTINGS = {
    'AWS_ACCESS_KEY_ID': 'tests',
    'AWS_SECRET_ACCESS_KEY': 'tests',
    'AWS_DEFAULT_REGION': 'us-east-1',
    'AWS_CONFIG_FILE': '/dev/null',
    'AWS_EC2_METADATA_DISABLED': 'true',
}


class Requests(logging.Handler):
    """The requests that a store served, such as ``GET /bucket/key``, and what came of each."""

    def __init__(self) -> None:
        """Hold none yet."""
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the line that the server logs."""
        self.lines.append(re.sub('\x1b[^m]*m', '', record.getMessage()).partition('"')[2])

    def count(self, start: str) -> int:
        """Count those that begin so."""
        return sum(line.startswith(start) for line in self.lines)


class Store:
    """A running store: a client that is not fsspec's, and what was asked of it."""

    def __init__(self, port: int, requests: Requests) -> None:
        """Connect to it."""
        self._port = port
        self.client: Any = boto3.client('s3', endpoint_url=f'http://127.0.0.1:{port}')
        self.requests = requests

    def forget(self) -> None:
        """Forget all buckets: those of an earlier store of this process are still there."""
        connection = HTTPConnection('127.0.0.1', self._port)
        with closing(connection):
            connection.request('POST', '/moto-api/reset')
            assert connection.getresponse().status == 200

    def new_bucket(self, name: str) -> str:
        """Make an empty bucket; return its address."""
        self.client.create_bucket(Bucket=name)
        return f's3://{name}'

    def put(self, address: str, data: bytes) -> str:
        """Put an object to an address, which is returned."""
        parts = urlsplit(address)
        self.client.put_object(Bucket=parts.netloc, Key=parts.path[1:], Body=data)
        return address

    def put_all(self, path: Path, address: str) -> None:
        """Put a file, or all of a folder, to an address, by another client than reads it."""
        for file in (one for one in path.rglob('*') if one.is_file()):
            self.put(f'{address}/{file.relative_to(path)}', file.read_bytes())
        if path.is_file():
            self.put(address, path.read_bytes())

    def get(self, address: str) -> bytes:
        """Read the object at an address."""
        parts = urlsplit(address)
        return bytes(self.client.get_object(Bucket=parts.netloc, Key=parts.path[1:])['Body'].read())

    def keys(self, bucket: str) -> list[str]:
        """List the objects of a bucket."""
        listed = self.client.list_objects_v2(Bucket=bucket)
        return [one['Key'] for one in listed.get('Contents', ())]

    def uploads(self, bucket: str) -> list[str]:
        """List the uploads that are neither completed nor given up."""
        listed = self.client.list_multipart_uploads(Bucket=bucket)
        return [one['Key'] for one in listed.get('Uploads', ())]


@contextmanager
def running_store() -> Iterator[Store]:
    """Run a store; inside, the environment points fsspec to it."""
    requests = Requests()
    log = logging.getLogger('werkzeug')
    log.addHandler(requests)
    log.propagate, log.level = False, logging.INFO
    server = ThreadedMotoServer(port=0, verbose=False)
    server.start()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SETTINGS.items():
            patch.setenv(name, value)
        _, port = server.get_host_and_port()
        patch.setenv('AWS_ENDPOINT_URL_S3', f'http://127.0.0.1:{port}')
        fsspec.get_filesystem_class('s3').clear_instance_cache()
        store = Store(port, requests)
        store.forget()
        yield store
        fsspec.get_filesystem_class('s3').clear_instance_cache()
    server.stop()
    log.removeHandler(requests)
