# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Starts while kernels are compiled, and another chain while clouds come."""

from pathlib import Path

import pytest
from helpers.live import environment
from helpers.watching import Watch, fresh_copy
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from lidar_outlier_filter.parameters.yaml_files import NODE_NAME
from lidar_outlier_filter.ros.health import OK, WARN

# The chain that compiles fastest, and one that takes over from it.
FIRST, SECOND = 'alpha_beta_gamma', 'sor'
# What is left out of its cache, so that some seconds are spent on it and not half a minute.
SOME_OF_SECOND = 'tree_search.*.nb?'


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_start_without_kernels(tmp_path: Path) -> None:
    """The node reports that it compiles; nothing is published until then, and all is counted."""
    env = {**environment(), **fresh_copy(tmp_path, '__pycache__')}
    with Watch(env, [f'chain:=[{FIRST}]']) as watch:
        watch.serve(lambda: bool(watch.samples) and watch.samples[-1].filtered > 0)
        found = watch.settle()
        before = [sample for sample in watch.samples if not sample.filtered]
        assert watch.stop() == 0
        log = watch.log()
    assert found.filtered == len(watch.published) == watch.sent - found.count('dropped')
    assert found.bypassed == 0 < found.count('dropped')
    assert any(f'compiling {FIRST}; no output until then' in sample.message for sample in before)
    assert all(sample.level >= WARN for sample in before)
    assert log.count('not ready after') >= len(before) // 6
    assert log.index('compiling') < log.index('is ready')
    assert 'Traceback' not in log


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_old_chain_filters_until_the_new_one_can(tmp_path: Path) -> None:
    """The reply says so, and so do the diagnostics; no cloud is lost, and none waits."""
    env = {**environment(), **fresh_copy(tmp_path, SOME_OF_SECOND)}
    with Watch(env, [f'chain:=[{FIRST}]', 'max_delay:=5.0']) as watch:
        watch.serve(lambda: bool(watch.samples) and watch.samples[-1].filtered > 0)
        before, count_before = watch.samples[-1], len(watch.published)
        client = AsyncParameterClient(watch.node, NODE_NAME)
        reply = client.set_parameters([Parameter('chain', value=[SECOND])])
        watch.serve(reply.done)
        result = reply.result().results[0]
        names = f'rejected by {SECOND}', f'undecided by {SECOND}'
        watch.serve(lambda: any(name in watch.samples[-1].values for name in names))
        said = [sample for sample in watch.samples if f'compiling {SECOND}' in sample.message]
        found = watch.settle()
        assert watch.stop() == 0
    assert result.successful
    assert result.reason.startswith(f'chain {SECOND} starts when its kernels are ready')
    assert said
    assert said[-1].count('messages') > said[0].count('messages') > 0
    assert {sample.level for sample in said} == {WARN}
    assert len(watch.published) > count_before
    assert found.filtered + found.bypassed == watch.sent - found.count('dropped')
    assert (found.bypassed, found.count('dropped')) == (before.bypassed, before.count('dropped'))
    assert found.level == OK or found.message
