# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a page sets in a node, from a thread that is not the executor's."""

import threading
from concurrent.futures import Future
from typing import Any

import pytest
from helpers.nodes import Ros
from helpers.programs import TIMEOUT

from lidar_outlier_filter.ros import live_parameters
from lidar_outlier_filter.ros.live_parameters import NodeAccess

NAME = 'gap_factor'
LATE = 'the node did not reply within 0.01 s'


def test_a_change_that_is_given_up_is_not_made(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that serves again later does not do what its page said was not done."""
    monkeypatch.setattr(live_parameters, 'NODE_TIMEOUT', 0.01)
    node = ros.filter()
    before = node.get_parameter(NAME).value
    assert NodeAccess(node).set({NAME: '7.5'}) == LATE
    assert ros.set(sor__k=12) == ['']
    assert node.get_parameter(NAME).value == before != 7.5


def test_a_change_that_is_begun_is_waited_for(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long it takes: what is said of it is true."""
    begun, given_up = threading.Event(), threading.Event()

    class Impatient(Future[str]):
        def result(self, timeout: float | None = None) -> str:
            if timeout is not None:  # it runs out when the change has begun
                assert begun.wait(TIMEOUT)
                raise TimeoutError
            return super().result()

        def cancel(self) -> bool:
            given_up.set()
            return super().cancel()

    monkeypatch.setattr(live_parameters, 'Future', Impatient)
    node = ros.filter()
    set_really = node.set_parameters_atomically

    def set_slowly(values: Any) -> Any:
        begun.set()
        assert given_up.wait(TIMEOUT)
        return set_really(values)

    monkeypatch.setattr(node, 'set_parameters_atomically', set_slowly)
    said: list[str] = []
    page = threading.Thread(target=lambda: said.append(NodeAccess(node).set({NAME: '7.5'})))
    page.start()
    while page.is_alive():
        ros.executor.spin_once(0.05)
    assert said == ['']
    assert node.get_parameter(NAME).value == 7.5
