# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the page's server makes of requests that no browser sends: a sentence, never an error."""

from __future__ import annotations

import socket
import sys
import threading
import time
from contextlib import ExitStack, closing, suppress
from http.client import HTTPConnection
from typing import TYPE_CHECKING, NamedTuple

import pytest
from helpers.browsers import new_tab
from hypothesis import given
from hypothesis import strategies as st

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.report.served import MAX_CONNECTIONS, MAX_REQUEST, PageServer

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from playwright.sync_api import Browser

TIMEOUT = 120.0  # seconds; reached in failures only
DIGITS = '9' * 5000
DEEP = '[' * 60_000
KNOWN = {200, 400, 403, 404, 413, 414, 431, 501, 505}


class Settable:
    """What a page reads of a node, and sets: here it is only noted."""

    name = '/node'
    parameters = FilterParameters()

    def __init__(self) -> None:
        self.topics = ['/points']
        self.values: list[Mapping[str, str]] = []

    def statuses(self) -> list[dict[str, object]]:
        """Say nothing."""
        return []

    def set(self, values: Mapping[str, str]) -> str:
        """Note what is set."""
        self.values.append(values)
        return ''


class Page(NamedTuple):
    """A server, what was set through it, and the errors that it did not expect."""

    server: PageServer
    node: Settable
    errors: list[BaseException | None]

    def ask(self, request: str, *, ended: bool = True) -> bytes:
        """Send characters as bytes; return all that comes back until the server has done."""
        address = ('127.0.0.1', self.server.port)
        with closing(socket.create_connection(address, TIMEOUT)) as connection:
            # Who is refused may find the door shut before all was said.
            with suppress(OSError):
                connection.sendall(request.encode('latin-1'))
                if ended:
                    connection.shutdown(socket.SHUT_WR)
            result = b''
            with suppress(ConnectionResetError):
                while data := connection.recv(1 << 16):
                    result += data
        return result

    def status(self, request: str, *, ended: bool = True) -> int:
        """Return the status of the response."""
        return int(self.ask(request, ended=ended).split(maxsplit=2)[1])

    def headers(self, *more: str) -> str:
        """Write the headers of a request that is meant for this server."""
        return '\r\n'.join([f'Host: 127.0.0.1:{self.server.port}', *more, '', ''])


@pytest.fixture(scope='module')
def page() -> Iterator[Page]:
    """Serve a page; what would be a traceback is noted."""
    node, errors = Settable(), list[BaseException | None]()
    server = PageServer(node)

    def note(*_: object) -> None:
        if not isinstance(sys.exception(), ConnectionError):
            errors.append(sys.exception())

    server._server.handle_error = note  # type: ignore[assignment, method-assign]
    server.start()
    yield Page(server, node, errors)
    server.close()


@pytest.mark.parametrize(
    'target',
    ['http://[', '/?token=é', '/nothing', '/', '/status', '/frames?topic=/points', '/?token=x'],
)
@pytest.mark.parametrize('method', ['GET', 'POST'])
def test_a_stranger_is_refused(page: Page, target: str, method: str) -> None:
    """Whatever the address is, and before anything else of the request is read."""
    for length in ('2', DIGITS, '-1', str(10 * MAX_REQUEST)):
        head = f'{method} {target} HTTP/1.1\r\n' + page.headers(f'Content-Length: {length}')
        result = page.ask(head + '{}')
        assert result.split(maxsplit=2)[1] in {b'400', b'403'}
        assert page.server.token.encode() not in result
    assert page.errors == []
    assert page.node.values == []


def test_only_this_machine(page: Page) -> None:
    """Who knows the token is refused under another name, and at another address."""
    port, known = page.server.port, f'?token={page.server.token} HTTP/1.1\r\n'
    for path, name, status in (
        ('/', 'localhost', 200),
        ('/nothing', 'localhost', 404),
        ('/', 'example.org', 403),  # which was made to lead here
    ):
        assert page.status(f'GET {path}{known}Host: {name}:{port}\r\n\r\n') == status
    with pytest.raises(OSError, match='refused'):
        socket.create_connection(('127.0.0.2', port), TIMEOUT)
    with pytest.raises(ParameterError, match=f'the port of the page must be free, got {port}'):
        PageServer(page.node, port)


@pytest.mark.parametrize(('error', 'is_said'), [(BrokenPipeError, False), (ValueError, True)])
def test_a_browser_that_leaves(
    capsys: pytest.CaptureFixture[str], error: type[Exception], *, is_said: bool
) -> None:
    """A tab that is closed before its response came is no error of the node."""

    def leave() -> None:
        raise error

    server = PageServer(Settable())
    server.start()
    try:
        leave()
    except error:
        server._server.handle_error(None, ('127.0.0.1', 1))
    server.close()
    assert ('Traceback' in capsys.readouterr().err) == is_said


def test_a_stranger_is_refused_before_he_has_said_all(page: Page) -> None:
    """The response does not wait for content that never comes."""
    head = 'POST /set?token=x HTTP/1.1\r\n' + page.headers('Content-Length: 5')
    with closing(socket.create_connection(('127.0.0.1', page.server.port), TIMEOUT)) as stranger:
        stranger.sendall(head.encode())
        assert stranger.recv(1 << 16).startswith(b'HTTP/1.1 403 ')


@pytest.mark.parametrize('after', [DIGITS, '-' + DIGITS, '%20', '1.5', '--1', '%D9%A3'])
def test_after_is_a_number(page: Page, after: str) -> None:
    """Anything else is refused in a sentence that is not longer than a line."""
    address = f'/frames?token={page.server.token}&topic=/points&after={after}'
    result = page.ask(f'GET {address} HTTP/1.1\r\n' + page.headers())
    assert result.startswith(b'HTTP/1.1 400 ')
    sentence = result.rpartition(b'\r\n\r\n')[2].decode()
    assert sentence.startswith('after must be a whole number from -1 to ')
    assert len(sentence) < 200
    assert page.errors == []


@pytest.mark.parametrize(
    ('length', 'content', 'status'),
    [
        *((length, '{}', 400) for length in (DIGITS, '-1', '1_0', '²', '', '3')),
        (str(MAX_REQUEST + 1), '{}', 413),
        *((None, one, 400) for one in (DEEP, '{"a": ' + DIGITS, '{"a": 1}', '1', '"', '\xff', '')),
    ],
)
def test_content(page: Page, length: str | None, content: str, status: int) -> None:
    """Invalid lengths, and contents other than an object of strings, do not reach the node."""
    known = str(len(content)) if length is None else length
    head = f'POST /set?token={page.server.token} HTTP/1.1\r\n'
    request = head + page.headers(f'Content-Length: {known}') + content
    assert page.status(request, ended=length is not None) == status
    assert page.errors == []
    assert page.node.values == []


def test_what_makes_sense_is_served(page: Page) -> None:
    """Over the same connection, one request after the other."""
    token, content = page.server.token, '{"a": "1", "b": "\\ud800"}'
    set_ = f'POST /set?token={token} HTTP/1.1\r\n'
    set_ += page.headers(f'Content-Length: {len(content)}') + content
    frames = f'GET /frames?token={token}&topic=/points HTTP/1.1\r\n' + page.headers()
    result = page.ask(set_ + frames + set_)
    assert result.count(b'HTTP/1.1 200 OK') == 3
    assert page.node.values == [{'a': '1', 'b': '\ud800'}] * 2
    page.node.values.clear()


def test_connections_are_bounded(page: Page) -> None:
    """Idle ones without the token are closed for new ones; who has the token stays connected."""
    address = ('127.0.0.1', page.server.port)
    status = f'/status?token={page.server.token}'
    before = threading.active_count()
    with ExitStack() as stack:
        friend = stack.enter_context(closing(HTTPConnection(*address)))
        friend.request('GET', status)
        result = friend.getresponse()
        assert (result.status, result.read()[:1]) == (200, b'{')
        connection = friend.sock
        strangers = [
            stack.enter_context(closing(socket.create_connection(address)))
            for _ in range(3 * MAX_CONNECTIONS)
        ]
        for stranger in strangers[: 2 * MAX_CONNECTIONS]:
            stranger.settimeout(TIMEOUT)
            assert stranger.recv(1) == b''
        end = time.monotonic() + TIMEOUT  # the threads of closed connections are about to end
        while threading.active_count() > before + MAX_CONNECTIONS:
            assert time.monotonic() < end
        friend.request('GET', status)
        assert friend.getresponse().status == 200
        assert friend.sock is connection
    assert page.errors == []


PARTS = ('/', '?', '&', 'token=', 'after=', '[', '//', 'http://', ':', '%', '%00', '#')
TARGETS = st.lists(
    st.sampled_from((*PARTS, 'TOKEN', 'set', 'frames', 'status', DIGITS))
    | st.text(st.characters(max_codepoint=255), max_size=5),
    max_size=8,
).map(''.join)
NAMES = ('Host', 'Content-Length', 'Transfer-Encoding', 'Connection', 'Expect', '', 'é')
VALUES = st.sampled_from(('HOST', '0', '2', '70000', DIGITS, 'chunked', 'close', '100-continue'))
HEADERS = st.lists(
    st.tuples(st.sampled_from(NAMES), VALUES | st.text(st.characters(max_codepoint=255))),
    max_size=4,
)


@given(
    method=st.sampled_from(('GET', 'POST', 'HEAD', 'get', '', '\0')),
    target=TARGETS,
    version=st.sampled_from(('HTTP/1.1', 'HTTP/1.0', '', 'HTTP/9.9', f'HTTP/1.{DIGITS}', 'x')),
    headers=HEADERS,
    content=st.sampled_from(('', '{}', DEEP[:2000], '"\\ud800"', 'GET / HTTP/1.1\r\n\r\n')),
)
def test_any_request(  # noqa: PLR0913  the parts of one
    page: Page,
    method: str,
    target: str,
    version: str,
    headers: list[tuple[str, str]],
    content: str,
) -> None:
    """No request ends in an error, and the next one is served."""
    known = {'TOKEN': page.server.token, 'HOST': f'127.0.0.1:{page.server.port}'}
    head = ''.join(f'{name}: {known.get(value, value)}\r\n' for name, value in headers)
    target = target.replace('TOKEN', known['TOKEN'])
    result = page.ask(f'{method} {target} {version}\r\n{head}\r\n{content}')
    if result.startswith(b'HTTP/1.1 '):
        assert int(result.split(maxsplit=2)[1]) in KNOWN | {100}
    assert page.errors == []
    address = f'/status?token={page.server.token}'
    assert page.status(f'GET {address} HTTP/1.1\r\n' + page.headers()) == 200


def test_diagnostics_in_a_browser(browser: Browser) -> None:
    """Values stand beside their names, and none is squeezed."""
    node = Settable()
    node.statuses = lambda: [  # type: ignore[method-assign]
        {'name': '/points', 'level': 1, 'message': 'slow', 'values': {'points': '1234567'}}
    ]
    server = PageServer(node)
    server.start()
    tab = new_tab(browser, viewport={'width': 1280, 'height': 900})
    tab.goto(server.address)
    tab.wait_for_selector('#statuses dd')
    assert tab.inner_text('#statuses dl').split('\n') == ['points', '1234567']
    # In one step: every status replaces the elements.
    assert tab.evaluate("document.querySelector('#statuses dd').getBoundingClientRect().width") > 80
    tab.context.close()
    server.close()
