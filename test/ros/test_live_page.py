# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a node that runs: a real browser, a real node, real middleware."""

from __future__ import annotations

import json
import re
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from helpers.browsers import new_tab
from helpers.live import environment
from helpers.nodes import Ros
from helpers.programs import Program
from rclpy.executors import ExternalShutdownException

from lidar_outlier_filter.cli.node import serve_page
from lidar_outlier_filter.report.served import PageServer, about

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page
    from sensor_msgs.msg import PointCloud2

    from lidar_outlier_filter.ros.node import OutlierFilterNode

    # What is not as it should be comes last.
    Served = tuple[OutlierFilterNode, PageServer, Page, list[str]]

pytestmark = pytest.mark.slow
THRESHOLD = 'boosted_trees.threshold'


@pytest.fixture
def served(ros: Ros, sweeps: list[PointCloud2], browser: Browser) -> Iterator[Served]:
    """Filter four sweeps of a VLP-16, and open the page; the node goes on meanwhile."""
    node = ros.filter(parameters={'blocks': 'message', 'scores': True, THRESHOLD: 0.5})
    server = serve_page(node)
    sensor = ros.sensor(node, 'points')
    for count, sweep in enumerate(sweeps, 1):
        sensor.publish(sweep, count)
        sensor.wait_for_outputs()
    stop = threading.Event()

    def spin() -> None:
        with suppress(ExternalShutdownException):
            ros.serve_while(lambda: not stop.is_set())

    spinning = threading.Thread(target=spin)
    spinning.start()
    wrong: list[str] = []
    page = new_tab(browser, viewport={'width': 1280, 'height': 900})
    page.on('console', lambda message: wrong.append(message.text))
    page.on('pageerror', lambda error: wrong.append(str(error)))
    page.goto(server.address)
    yield node, server, page, wrong
    page.context.close()
    stop.set()
    spinning.join()
    server.close()


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
