# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How Sphinx builds these pages: ``sphinx-build -W doc FOLDER``, or rosdoc2.

What lies outside this folder is found beside it, or beside the package where rosdoc2 has copied it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import lidar_outlier_filter
from lidar_outlier_filter.core.detectors import registry
from lidar_outlier_filter.core.detectors.boosted_trees.features import (
    CAUSES,
    PROFILE,
    REASON_NAMES,
    SECOND_PASS,
    WINDOW,
)
from lidar_outlier_filter.parameters.filter import describe
from lidar_outlier_filter.parameters.yaml_files import as_yaml

if TYPE_CHECKING:
    from sphinx.application import Sphinx

BESIDE = [Path(__file__).resolve().parents[1], Path(lidar_outlier_filter.__file__).parents[1]]
ROOT = next(folder for folder in BESIDE if (folder / 'CONTRIBUTING.md').is_file())

project = 'lidar_outlier_filter'
author = 'The lidar_outlier_filter authors'
copyright = f'2026, {author}'  # noqa: A001  the name that Sphinx reads
release = version = lidar_outlier_filter.__version__

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.doctest',
    'sphinx.ext.mathjax',
    'sphinx.ext.napoleon',
    'sphinx_rtd_theme',
]
exclude_patterns = ['_build']
myst_enable_extensions = ['attrs_inline', 'colon_fence', 'deflist', 'dollarmath']
myst_heading_anchors = 3

# ROS is not needed to build the pages, and not imported where it is there.
autodoc_mock_imports = ['rclpy', 'diagnostic_msgs', 'nav_msgs', 'rcl_interfaces', 'sensor_msgs']
autodoc_typehints = 'none'  # docstrings name types, shapes and units
autodoc_member_order = 'bysource'
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = 'sphinx_rtd_theme'
html_theme_options = {'navigation_depth': 3, 'collapse_navigation': False}
html_static_path = [str(ROOT / 'doc' / '_static')]
html_css_files = ['pages.css']
html_show_sourcelink = False


def without_title(text: str) -> str:
    """Leave out the title of a page, which the page that takes it in has already."""
    return re.sub(r'\A(#.*\n|\^+\n.*\n\^+\n)\n*', '', text)


def reasons_table() -> str:
    """Return the table of the reasons in ``outlier_reason``."""
    meaning = CAUSES | PROFILE | SECOND_PASS | WINDOW
    rows = [f'| {k} | `{name}` | {meaning[name]} |' for k, name in REASON_NAMES.items()]
    return '\n'.join(['| number | feature | meaning |', '| ---: | --- | --- |', *rows])


def table(section: str | None = None) -> str:
    """Write a table of parameters in Markdown.

    All of them, or those of a section such as ``lof``; '' for those without a section.
    """
    lines = ['| parameter | default | allowed | what it does |', '| --- | --- | --- | --- |']
    for parameter in describe():
        if section not in {None, parameter.name.rpartition('.')[0]}:
            continue
        value = parameter.default
        shown = ', '.join(value) if isinstance(value, tuple) else as_yaml(value)
        mark = ' (start)' if parameter.fixed else ''
        lines.append(
            f'| `{parameter.name}`{mark} | `{shown}` | {parameter.range_text} | {parameter.text} |'
        )
    return '\n'.join(lines) + '\n'


def inserted() -> dict[str, str]:
    """Return what is put where a page says ``<!-- insert: NAME -->``."""
    texts = {
        **{
            name: without_title((ROOT / name).read_text(encoding='utf-8'))
            for name in ('CONTRIBUTING.md', 'QUALITY_DECLARATION.md', 'CHANGELOG.rst')
        },
        'detectors': registry.table(),
        'reasons': reasons_table(),
        'parameters': table(),
    }
    sections = {parameter.name.rpartition('.')[0] for parameter in describe()}
    return texts | {f'parameters: {name}': table(name) for name in sections - {''}}


def fill(_app: Sphinx, _page: str, content: list[str]) -> None:
    """Put in what a page asks for; a name that nobody knows ends the build."""
    texts = inserted()
    content[0] = re.sub(
        r'^(?:<!-- |\.\. )insert: (.*?)(?: -->)?$',
        lambda found: texts[found[1]],
        content[0],
        flags=re.MULTILINE,
    )


def setup(app: Sphinx) -> None:
    """Have every page filled when it is read."""
    app.connect('source-read', fill)
