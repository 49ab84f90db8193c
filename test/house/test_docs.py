# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The pages as readers see them: built as HTML, as rosdoc2 does it."""

from __future__ import annotations

import html
import re
import shutil
import sys
from typing import TYPE_CHECKING

import pytest
from helpers import ROOT
from helpers.browsers import new_tab
from helpers.programs import ended

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.parameters.filter import describe

if TYPE_CHECKING:
    import subprocess
    from pathlib import Path

    from playwright.sync_api import Browser

QUOTES = '\N{LEFT SINGLE QUOTATION MARK}\N{RIGHT SINGLE QUOTATION MARK}'
WRAPPER = """
extensions, html_theme = [], ''
exec(open('doc/__conf.py').read())
"""


def build(source: Path, target: Path) -> subprocess.CompletedProcess[str]:
    """Build the pages; the result has the output of Sphinx."""
    options = ('-W', '--keep-going', '-q')
    return ended(sys.executable, '-m', 'sphinx', *options, source, target, folder=source)


def words(page: Path) -> str:
    """Return what a reader reads, in one line, with plain quotes."""
    text = html.unescape(re.sub(r'<[^>]+>', ' ', page.read_text(encoding='utf-8')))
    quotes = str.maketrans(dict.fromkeys(QUOTES, "'"))
    return ' '.join(text.translate(quotes).split())


@pytest.fixture(scope='module')
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build all pages as rosdoc2 does, every warning being an error.

    It copies them into another folder, with a configuration around it that runs the project's own.
    """
    folder = tmp_path_factory.mktemp('html')
    shutil.copytree(ROOT / 'doc', folder / 'doc')
    (folder / 'doc' / 'conf.py').rename(folder / 'doc' / '__conf.py')
    (folder / 'conf.py').write_text(WRAPPER, encoding='utf-8')
    (folder / 'index.rst').write_text('Package\n=======\n\n.. toctree::\n\n   doc/index\n')
    result = build(folder, folder / 'html')
    assert result.returncode == 0, result.stderr
    return folder / 'html' / 'doc'


@pytest.mark.slow
@pytest.mark.long
def test_every_parameter_is_shown(pages: Path) -> None:
    """With its range and its sentence: on the page of all, and a detector's on its own page."""
    for parameter in describe():
        section = parameter.name.rpartition('.')[0]
        shown = ['parameters'] + [f'detectors/{section}'] * (section in DETECTORS)
        for page in shown:
            text = words(pages / f'{page}.html')
            assert parameter.name in text
            assert parameter.range_text in text
            assert ' '.join(parameter.text.split()) in text


@pytest.mark.slow
@pytest.mark.long
def test_every_detector_is_shown(pages: Path) -> None:
    """With its bit and its sentence, in the table of all."""
    text = words(pages / 'detectors' / 'index.html')
    for name, detector in DETECTORS.items():
        plain = detector.rejects.partition('`')[0].strip()
        assert f'{name} {detector.bit} {plain}' in text


@pytest.mark.slow
@pytest.mark.long
def test_pages_fit_a_phone(pages: Path, browser: Browser) -> None:
    """No page scrolls sideways on a screen of 390 px; wide tables and code scroll by themselves."""
    tab = new_tab(browser, viewport={'width': 390, 'height': 844})
    tab.context.set_offline(True)
    widths = {}
    for page in pages.rglob('*.html'):
        tab.goto(page.as_uri())
        widths[page.name] = tab.evaluate('document.documentElement.scrollWidth')
    tab.context.close()
    assert {name: width for name, width in widths.items() if width > 390} == {}


def test_built_from_an_installed_package(tmp_path: Path) -> None:
    """What lies outside the folder is found beside it, wherever the package is."""
    (tmp_path / 'lidar_outlier_filter').symlink_to(ROOT / 'lidar_outlier_filter')
    program = 'import runpy, sys; print(runpy.run_path(sys.argv[1])["inserted"]())'
    result = ended(sys.executable, '-c', program, ROOT / 'doc' / 'conf.py', folder=tmp_path)
    assert 'CONTRIBUTING.md' in result.stdout, result.stderr


@pytest.mark.slow
@pytest.mark.long
def test_an_unknown_mark_ends_the_build(tmp_path: Path) -> None:
    """A page that asks for what nobody has is no page."""
    shutil.copy(ROOT / 'doc' / 'conf.py', tmp_path)
    (tmp_path / 'index.md').write_text('# Page\n\n<!-- insert: nothing -->\n', encoding='utf-8')
    result = build(tmp_path, tmp_path / 'html')
    assert result.returncode != 0
    assert 'nothing' in result.stderr
