# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A command says that it compiles kernels, which, once."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from helpers.watching import fresh_copy
from numba import njit

from lidar_outlier_filter.cli.compile import notice
from lidar_outlier_filter.core.kernels.compile_listeners import listeners
from lidar_outlier_filter.core.kernels.compiling import NotCompiled, only_compiled

if TYPE_CHECKING:
    from pathlib import Path

PACKAGE = 'lidar_outlier_filter'


SAID = 'the kernels of sor are compiled, this once\n'


@pytest.mark.slow
def test_the_first_run_says_what_is_compiled(tmp_path: Path) -> None:
    """The second run compiles nothing, and says nothing of it."""
    env = os.environ | fresh_copy(tmp_path, 'detector._average-*.nb?')
    file = tmp_path / 'cloud.csv'
    rows = (f'{n % 20},{n // 20},{n % 3 / 10}\n' for n in range(400))
    file.write_text('x,y,z\n' + ''.join(rows))
    command = [sys.executable, '-P', '-m', f'{PACKAGE}.cli.main', 'clean', str(file), '--dry-run']
    first, second = (
        subprocess.run(
            [*command, '--chain', 'sor'], env=env, capture_output=True, text=True, check=True
        ).stderr
        for _ in range(2)
    )
    assert first.count(SAID) == 1
    assert 'compiled' not in second


def test_each_part_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A detector's own kernels by its name, those of the core as shared; plug-ins' not at all."""
    say_once = notice()
    for module in ('detectors.lof', 'kernels', 'detectors.boosted_trees.near_features'):
        say_once(f'{PACKAGE}.core.{module}')
        say_once(f'{PACKAGE}.core.{module}')
    say_once('lidar_outlier_lab.simulation.world.caster')
    say_once('somebody.else')
    assert capsys.readouterr().err.splitlines() == [
        'the kernels of lof are compiled, this once',
        'the kernels that all share are compiled, this once',
        'the kernels of boosted_trees are compiled, this once',
        'the kernels of lidar_outlier_lab are compiled, this once',
    ]


def test_asking_is_not_compiling() -> None:
    """Listeners learn which module is compiled, and nothing where kernels are only asked for."""
    # Without a cache: what was kept of another run would be used.
    add: Any = njit(lambda x: x + 1)
    compiled: list[str] = []
    listeners.append(compiled.append)
    try:
        with only_compiled(), pytest.raises(NotCompiled):
            add(1)
        assert compiled == []
        assert add(1) == 2
    finally:
        listeners.remove(compiled.append)
    assert compiled == [__name__]
