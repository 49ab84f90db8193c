# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A command says that it compiles kernels, once."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.watching import fresh_copy

from lidar_outlier_filter.cli import compile as compile_notice
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.kernels.kernel_cache import CacheFile
from lidar_outlier_filter.pipeline import compiling

PACKAGE = 'lidar_outlier_filter'


@pytest.mark.slow
def test_the_first_run_says_what_is_compiled(tmp_path: Path) -> None:
    """The second run compiles nothing, and says nothing of it."""
    env = os.environ | fresh_copy(tmp_path, 'sor._average*.nb?')
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
    assert first.count(f'{compile_notice.SENTENCE}\n') == 1
    assert 'compiled' not in second


def test_what_is_compiled_is_said_before(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command names all parts before the first, which takes a while, is done."""
    said: list[str] = []

    def run(_self: object, work: list[object], advance: Callable[..., object]) -> list[str]:
        said.append(capsys.readouterr().err)
        advance(1, len(work), 'lof')
        return []

    monkeypatch.setattr(compiling, 'load', lambda *_, **__: False)
    monkeypatch.setattr(compiling.Processes, 'run', run)
    monkeypatch.setattr(CacheFile, 'allows_portable', CacheFile.allows_portable)
    assert main(['compile', '--chain', 'lof,sor']) == 0
    (before,) = said
    assert before.startswith('compiling, ')
    assert before.endswith(': lof; sor\n')
    assert capsys.readouterr().err.startswith('compiled 1 of 2: lof\n')
