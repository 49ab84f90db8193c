# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a node that runs: a real browser, a real node, real middleware."""

from __future__ import annotations

import json
import re
import socket
import threading
from contextlib import closing, suppress
from http.client import HTTPConnection
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

import pytest
from helpers.browsers import chromium, new_tab
from helpers.live import environment
from helpers.nodes import Ros, Sensor
from helpers.programs import Program
from rclpy.executors import ExternalShutdownException

from lidar_outlier_filter.cli.node import serve_page
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.report.served import PageServer, about
from lidar_outlier_filter.ros.live_parameters import NodeAccess

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Page
    from sensor_msgs.msg import PointCloud2

    from lidar_outlier_filter.ros.node import OutlierFilterNode

pytestmark = pytest.mark.slow
THRESHOLD = 'boosted_trees.threshold'


class Served(NamedTuple):
    """A node that runs, its page, and what is not as it should be."""

    node: OutlierFilterNode
    server: PageServer
    page: Page
    wrong: list[str]


@pytest.fixture
def served(ros: Ros, sweeps: list[PointCloud2]) -> Iterator[Served]:
    """Filter four sweeps of a VLP-16, and open the page; the node goes on meanwhile."""
    node = ros.filter(parameters={'blocks': 'message', 'scores': True, THRESHOLD: 0.5})
    server = serve_page(node)
    node.start()
    sensor = Sensor(ros, 'points')
    sensor.wait_for_filter(node)
    for count, sweep in enumerate(sweeps, 1):
        sensor.publish(sweep, count)
        sensor.wait_for_outputs()
    stop = threading.Event()

    def spin() -> None:
        with suppress(ExternalShutdownException):
            while not stop.is_set():
                ros.executor.spin_once(0.05)

    spinning = threading.Thread(target=spin)
    spinning.start()
    wrong: list[str] = []
    with chromium() as browser:
        page = new_tab(browser, viewport={'width': 1280, 'height': 900})
        page.on('console', lambda message: wrong.append(message.text))
        page.on('pageerror', lambda error: wrong.append(str(error)))
        page.goto(server.address)
        yield Served(node, server, page, wrong)
    stop.set()
    spinning.join()
    server.close()


def get(server: PageServer, path: str, host: str = '', method: str = 'GET') -> tuple[int, bytes]:
    """Ask the server for a path, as if it had this name; return the status and the response."""
    body = b'{}' if method == 'POST' else None
    with closing(HTTPConnection('127.0.0.1', server.port, timeout=10)) as connection:
        connection.request(method, path, body, headers={'Host': host or f'127.0.0.1:{server.port}'})
        result = connection.getresponse()
        return result.status, result.read()


def test_page_shows_the_node_and_sets_it(served: Served) -> None:
    """Clouds are drawn, a slider sets the parameter, what is refused is said."""
    node, server, page, wrong = served
    page.wait_for_selector('html[data-frames="4"]')
    found = page.evaluate('window.live.data.frames.map((one) => [one.points, one.rejected])')
    counts = node.channels[0].statistics
    points = counts.points - counts.invalid
    assert sum(one for one, _ in found) == points
    assert sum(rejected for _, rejected in found) == counts.outliers
    numbers = re.sub(r'\s', '', page.inner_text('#lead strong'))
    assert numbers == f'{counts.outliers}of{points}points'
    page.wait_for_selector('#shown:not(:empty)')
    page.wait_for_selector('.level')
    assert '/points' in page.inner_text('#statuses')
    asked = page.evaluate('performance.getEntriesByType("resource").map((one) => one.name)')
    assert (
        sum('/status?' in name for name in asked) >= sum('/about?' in name for name in asked) == 1
    )
    assert not server.status().keys() & about().keys()
    assert f'{about()["version"]}. Kept: the last ' in page.inner_text('#footer')
    page.select_option('#mode', label='strongest reason')
    often = [name for name, _ in node.channels[0].statistics.reasons.most_common(6)]
    assert page.inner_text('#legend').splitlines()[:6] == often

    slider = page.locator('#slider-0')
    before = int(slider.input_value())
    slider.focus()
    with page.expect_response(re.compile('/set')):
        page.keyboard.press('ArrowRight')
    texts = server.status()['sliders'][0]['texts']
    assert node.get_parameter(THRESHOLD).value == float(texts[before + 1]) > 0.5

    page.fill('#exact-0', '0.7')
    with page.expect_response(re.compile('/set')):
        page.keyboard.press('Enter')
    assert node.get_parameter(THRESHOLD).value == 0.7
    for ill, got in (('-1', '-1'), ('much', "'much'")):
        page.fill('#exact-0', ill)
        with page.expect_response(re.compile('/set')):
            page.keyboard.press('Enter')
        page.wait_for_selector(f'#refusal:text({json.dumps(got)})')
        assert page.inner_text('#refusal').startswith(f'{THRESHOLD} must be ')
    assert node.get_parameter(THRESHOLD).value == 0.7
    assert wrong == []


def test_only_this_machine_with_the_token(ros: Ros) -> None:
    """Others are refused: without the token, under another name, at another address."""
    node = ros.filter()
    server = serve_page(node)
    port, token = server.port, server.token
    assert urlsplit(server.address).netloc == f'127.0.0.1:{port}'
    for path in (
        '/',
        '/about',
        '/status',
        '/frames?topic=/points&after=-1',
        '/?token=',
        '/?token=x',
    ):
        assert get(server, path)[0] == 403
        assert token.encode() not in get(server, path)[1]
    assert get(server, f'/set?token={token[:-1]}', method='POST')[0] == 403
    # A name elsewhere that was made to lead here.
    assert get(server, f'/?token={token}', host=f'example.org:{port}')[0] == 403
    assert get(server, f'/?token={token}', host=f'localhost:{port}')[0] == 200
    assert get(server, f'/nothing?token={token}')[0] == 404
    assert get(server, f'/frames?token={token}&after=x')[0] == 400
    for address in own_addresses():
        with pytest.raises(OSError, match='refused'):
            socket.create_connection((address, port), timeout=10)
    with pytest.raises(ParameterError, match=f'the port of the page must be free, got {port}'):
        PageServer(NodeAccess(node), port)
    server.close()


@pytest.mark.parametrize(('error', 'is_said'), [(BrokenPipeError, False), (ValueError, True)])
def test_a_browser_that_leaves(
    ros: Ros, capsys: pytest.CaptureFixture[str], error: type[Exception], *, is_said: bool
) -> None:
    """A tab that is closed before its response came is no error of the node."""

    def leave() -> None:
        raise error

    server = serve_page(ros.filter())
    try:
        leave()
    except error:
        server._server.handle_error(None, ('127.0.0.1', 1))
    server.close()
    assert ('Traceback' in capsys.readouterr().err) == is_said


def own_addresses() -> list[str]:
    """List addresses of this machine that are not 127.0.0.1: one of the loop always."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.connect(('192.0.2.1', 9))  # sends nothing: says which interface would be taken
        return ['127.0.0.2', probe.getsockname()[0]]
    return ['127.0.0.2']


def test_off_by_default() -> None:
    """Without the option nothing is served; with it the log names the address once."""
    command = ('-m', 'lidar_outlier_filter.cli.node')
    with Program(*command, '--lifecycle', env=environment()) as node:
        node.wait_for('managed node: waiting')
        node.signal(2)
        assert node.wait() == 0
        assert not any('page: ' in line for line in node.output)
    with Program(*command, '--lifecycle', '--page', env=environment()) as node:
        line = node.wait_for('page: ')
        found = re.search(r'http://127\.0\.0\.1:(\d+)/\?token=[\w-]{32}$', line)
        assert found is not None
        node.wait_for('managed node: waiting')
        node.signal(2)
        assert node.wait() == 0
        assert sum('token' in line for line in node.output) == 1
