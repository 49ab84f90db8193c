# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a running node: served to this machine only, and only with its token."""

import json
import secrets
import socket
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from lidar_outlier_filter.core.detectors.registry import rejecting
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.errors import FilterError, ParameterError
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.parameters.declaration import shown
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.live import KEPT_SECONDS, MAX_IN_FRAME, LiveClouds
from lidar_outlier_filter.report.page import constants, live_page, slider_facts
from lidar_outlier_filter.report.steps import all_values

LOCALHOST = '127.0.0.1'
MAX_REQUEST = 1 << 16  # bytes of a request to set parameters
MAX_NUMBER = 2**53  # the largest whole number of JavaScript
MAX_DIGITS = 20  # Python refuses thousands, with an error of its own
MAX_CONNECTIONS = 32  # a browser opens six to a server
MAX_IDLE_S = 10.0  # a page asks twice a second
TOKEN_BYTES = 24
# Only code of the page itself runs, and it connects to this server only.
POLICY = (
    "default-src 'none'; script-src data: 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
HEADERS = {
    'Cache-Control': 'no-store',
    'Content-Security-Policy': POLICY,
    'Referrer-Policy': 'no-referrer',
    'X-Content-Type-Options': 'nosniff',
}
JSON, BYTES, HTML = 'application/json', 'application/octet-stream', 'text/html; charset=utf-8'
TEXT = 'text/plain; charset=utf-8'


class _RequestError(FilterError):
    """An invalid or forbidden request, and its status."""

    def __init__(self, what: str, must_be: str, got: object, status: HTTPStatus) -> None:
        super().__init__(what, must_be, got)
        self.status = status


class PageServer:
    """Serves the page of a node from a thread of its own.

    Attributes
    ----------
    address : of the page, with its token

    """

    def __init__(self, node: Any, port: int = 0) -> None:
        """Take a port of this machine; 0: any free one.

        Of the node its name, topics, parameters, statuses and set are used, from any thread.
        """
        self.node = node
        self.token = secrets.token_urlsafe(TOKEN_BYTES)
        self._clouds: dict[str, LiveClouds] = {}
        try:
            self._server = _Server((LOCALHOST, port), _Handler)
        except OSError as err:
            raise ParameterError('the port of the page', 'free', f'{port}: {err.strerror}') from err
        self._server.page = self
        self._page = live_page(node.name).encode()
        self._thread = threading.Thread(target=self._server.serve_forever, name='page', daemon=True)

    @property
    def port(self) -> int:
        """The port that it has."""
        return int(self._server.server_address[1])

    @property
    def address(self) -> str:
        """The address to open."""
        return f'http://{LOCALHOST}:{self.port}/?token={self.token}'

    def show(self, topic: str, cloud: StreamCloud, msg: Any) -> None:
        """Take a cloud that was judged."""
        view = structured(msg).reshape(-1) if cloud.count else None
        self._clouds.setdefault(topic, LiveClouds()).add(cloud, view)

    def start(self) -> None:
        """Serve."""
        self._thread.start()

    def close(self) -> None:
        """Serve no more, and let go of the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def allows(self, host: str, token: str) -> bool:
        """Return whether a request is from who knows the token, and meant for this server.

        A page of elsewhere whose name was made to lead here has another host.
        """
        hosts = (f'{LOCALHOST}:{self.port}', f'localhost:{self.port}')
        return host in hosts and secrets.compare_digest(token.encode(), self.token.encode())

    def respond(self, path: str, asked: Mapping[str, str]) -> tuple[str, bytes]:
        """Give the type and the content of a path; refuse what makes no sense."""
        if path == '/':
            return HTML, self._page
        if path in {'/about', '/status'}:
            known = self.status() if path == '/status' else about()
            return JSON, json.dumps(known, allow_nan=False).encode()
        if path == '/frames':
            after = _number('after', asked.get('after', '-1'), -1, MAX_NUMBER)
            clouds = self._clouds.get(asked.get('topic', '')) or LiveClouds()
            return BYTES, clouds.since(after)
        raise _unknown(path)

    def status(self) -> dict[str, Any]:
        """Say what may have changed, and is not in the clouds."""
        return {
            'node': self.node.name,
            'topics': self.node.topics,
            'chain': list(rejecting(self.node.parameters)),
            'sliders': sliders_of(self.node.parameters),
            'statuses': self.node.statuses(),
        }

    def change(self, content: bytes) -> str:
        """Set the parameters that a request names; say why not, '' where they are set."""
        try:
            values = json.loads(content)
        except (ValueError, RecursionError):
            values = None
        if not isinstance(values, dict) or not all(isinstance(one, str) for one in values.values()):
            must_be = 'an object of names and texts'
            raise _RequestError('what is set', must_be, 'others', HTTPStatus.BAD_REQUEST)
        return str(self.node.set(values))


def _number(what: str, text: str, least: int, most: int) -> int:
    if text.isascii() and text.removeprefix('-').isdecimal() and len(text) < MAX_DIGITS:
        number = int(text)
        if least <= number <= most:
            return number
    must_be = f'a whole number from {least} to {most}'
    raise _RequestError(what, must_be, shown(text), HTTPStatus.BAD_REQUEST)


def _unknown(path: str) -> _RequestError:
    must_be = 'one that the page asks for'
    return _RequestError('the path', must_be, shown(path), HTTPStatus.NOT_FOUND)


def about() -> dict[str, Any]:
    """Return what never changes while the node runs."""
    return {**constants(), 'live': True, 'kept': KEPT_SECONDS, 'mostInFrame': MAX_IN_FRAME}


@lru_cache(maxsize=1)  # a page asks twice a second, and every value must be tried
def sliders_of(parameters: FilterParameters) -> list[dict[str, Any]]:
    """List the threshold of each detector of the chain: its values, and the current one."""
    every = [one for one in all_values(parameters) if len(one.values) > 1]
    return [{**slider_facts(one), 'given': one.given} for one in every]


class _Server(ThreadingHTTPServer):
    """Serves at most ``MAX_CONNECTIONS``: a further one ends the one that was idle longest."""

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = MAX_CONNECTIONS
    page: PageServer

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._lock = threading.Lock()
        # When each was used last, and whether it had the token: those without it end first.
        self._open: dict[Any, tuple[bool, float]] = {}

    def note_use(self, request: Any, *, allowed: bool) -> None:
        """Note that a connection is used."""
        with self._lock:
            self._open[request] = allowed, time.monotonic()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own."""
        with self._lock:
            if len(self._open) >= MAX_CONNECTIONS:
                idle = min(self._open, key=lambda one: self._open[one])
                del self._open[idle]
                with suppress(OSError):
                    idle.shutdown(socket.SHUT_RDWR)
        self.note_use(request, allowed=False)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """End a connection."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that left before its response was there."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    protocol_version = 'HTTP/1.1'
    timeout = MAX_IDLE_S

    def do_GET(self) -> None:
        """Send the page, its frames or its status."""
        try:
            kind, content = self.server.page.respond(*self._asked())
            self._send(HTTPStatus.OK, kind, content)
        except _RequestError as err:
            self._refuse(err)

    def do_POST(self) -> None:
        """Set parameters."""
        try:
            path, _ = self._asked()
        except _RequestError as err:
            self._refuse(err)
            with suppress(_RequestError):
                self._content()  # unread content would reset the connection before the response
            return
        try:
            content = self._content()
            if path != '/set':
                raise _unknown(path)
            refusal = self.server.page.change(content)
            self._send(HTTPStatus.OK, JSON, json.dumps({'refusal': refusal}).encode())
        except _RequestError as err:
            self._refuse(err)

    def log_message(self, *_: object) -> None:
        """Log nothing: addresses hold the token."""

    def _asked(self) -> tuple[str, dict[str, str]]:
        """Read what is asked for, and refuse who may not ask."""
        try:
            address = urlsplit(self.path)
            asked = {name: one[0] for name, one in parse_qs(address.query).items()}
        except ValueError as err:
            must_be, got = 'a path and what is asked', shown(self.path)
            raise _RequestError('the address', must_be, got, HTTPStatus.BAD_REQUEST) from err
        if not self.server.page.allows(self.headers.get('Host', ''), asked.get('token', '')):
            must_be = 'the one that the log of the node names, with its token'
            raise _RequestError('the address', must_be, 'another', HTTPStatus.FORBIDDEN)
        self.server.note_use(self.connection, allowed=True)
        return address.path, asked

    def _content(self) -> bytes:
        what, said = 'the length of a request', self.headers.get('Content-Length', '')
        length = _number(what, said, 0, MAX_NUMBER)
        if length > MAX_REQUEST:
            must_be = f'at most {MAX_REQUEST} bytes'
            raise _RequestError(what, must_be, length, HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        content = self.rfile.read(length)
        if len(content) < length:
            must_be = f'of {length} bytes, as it says'
            raise _RequestError('a request', must_be, len(content), HTTPStatus.BAD_REQUEST)
        return content

    def _refuse(self, err: _RequestError) -> None:
        """Say what was wrong; what follows on this connection is not read."""
        self.close_connection = True
        self._send(err.status, TEXT, f'{err}\n'.encode())

    def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, 'Content-Type': kind}.items():
            self.send_header(name, value)
        self.send_header('Content-Length', str(len(content)))
        self.end_headers()
        self.wfile.write(content)
