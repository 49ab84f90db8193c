# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The README and the pages of ``doc/`` name what exists, and nothing else."""

import argparse
import ast
import re
from dataclasses import fields
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.detectors import BITS

from lidar_outlier_filter.cli.main import commands_for
from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import parse, read_yaml

README = ROOT / 'README.md'
TABLES = ROOT / 'doc' / 'results'  # written by commands, and tested there
PAGES = sorted({README, *(ROOT / 'doc').rglob('*.md')} - {*TABLES.rglob('*.md')})
EACH_PAGE = pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
PARAMETERS = {parameter.name: parameter for parameter in describe()}
NAMES = set(PARAMETERS)
SECTIONS = {name.rpartition('.')[0] for name in NAMES} - {''}
LINK = re.compile(r'\]\((?!http)([^)#\s]*)(?:#([\w-]+))?\)')
# Words of the same form that are no parameters: files, topics, arrays, modules
OTHERS = re.compile(r'\.(md|rst|yaml|xml|json|rviz|py|laz|mcap|db3|bag|label|dim\[1\]\.label)$')


BLOCK = re.compile(r'^```(\w+)\n(.*?)^```', re.DOTALL | re.MULTILINE)


def blocks(page: Path, language: str) -> list[str]:
    """List the code of a page in a language; continued lines are one."""
    found = BLOCK.findall(page.read_text(encoding='utf-8'))
    return [code.replace('\\\n', ' ') for name, code in found if name == language]


def quoted(page: Path) -> list[str]:
    """List what a page has between back quotes, beside its blocks."""
    return re.findall(r'`([^`\n]+)`', BLOCK.sub('', page.read_text(encoding='utf-8')))


def anchors(page: Path) -> set[str]:
    """Names of the headings of a page, as links have them."""
    titles = re.findall(r'^#+ (.*)$', page.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w -]', '', title.lower()).replace(' ', '-') for title in titles}


def commands() -> dict[str, argparse.ArgumentParser]:
    """Parsers of the commands of ``lidar-outlier-filter``."""
    parsers = argparse.ArgumentParser().add_subparsers()
    for add in commands_for([]):
        add(parsers)
    return parsers.choices


def test_readme_is_short() -> None:
    """At most 120 lines; what is longer belongs to a page."""
    assert len(README.read_text(encoding='utf-8').splitlines()) <= 120


@EACH_PAGE
def test_links_lead_somewhere(page: Path) -> None:
    """Every link within the project names an existing file, and a heading of it."""
    for target, anchor in LINK.findall(page.read_text(encoding='utf-8')):
        file = (page.parent / target) if target else page
        assert file.is_file(), target
        assert not anchor or anchor in anchors(file), f'{target}#{anchor}'


@EACH_PAGE
def test_files_are_there(page: Path) -> None:
    """Every file and folder of the project that a page names is there."""
    text = page.read_text(encoding='utf-8')
    named = set(re.findall(r'\b(?:config|scripts|doc|benchmarks|launch|test)/[\w./]*\w', text))
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


@EACH_PAGE
def test_commands_are_there(page: Path) -> None:
    """Every command line of a page names commands and options that exist."""
    parsers = commands()
    code = '\n'.join(blocks(page, 'bash') + quoted(page))
    for line in code.splitlines():
        words = line.partition('#')[0].split()
        if 'lidar-outlier-filter' not in words:
            continue
        words = words[words.index('lidar-outlier-filter') + 1 :]
        if not words or words[0] == '--help':
            continue
        assert words[0] in parsers, line
        known = {text for action in parsers[words[0]]._actions for text in action.option_strings}
        assert {word for word in words if word.startswith('--')} <= known, line


@pytest.mark.parametrize(('command', 'page'), [('replay', 'bags.md'), ('clean', 'files.md')])
def test_options_are_listed(command: str, page: str) -> None:
    """The pages of bags and of files have a row for each option of their commands."""
    text = (ROOT / 'doc' / page).read_text(encoding='utf-8')
    known = {text for action in commands()[command]._actions for text in action.option_strings}
    listed = set(re.findall(r'^\| `(--\w[\w-]*)', text, re.MULTILINE))
    assert listed == known - {'-h', '--help'}


@EACH_PAGE
def test_launch_arguments_are_there(page: Path) -> None:
    """Every argument that a page gives to the launch file is declared there."""
    source = (ROOT / 'launch' / 'filter.launch.py').read_text(encoding='utf-8')
    declared = {
        ast.literal_eval(node.args[0])
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == 'DeclareLaunchArgument'
    }
    code = '\n'.join(blocks(page, 'bash'))
    lines = [line for line in code.splitlines() if 'filter.launch.py' in line]
    lines += [text for text in quoted(page) if re.match(r'\w+:=', text)]
    given = {name for line in lines for name in re.findall(r'(\w+):=', line)}
    assert given <= declared | {'sigterm_timeout'}  # which is launch's own


@EACH_PAGE
def test_parameters_are_there(page: Path) -> None:
    """Every parameter that a page names or sets exists, and its value is allowed."""
    for text in quoted(page):
        name, colon, value = text.partition(': ')
        if name.partition('.')[0] in SECTIONS and '.' in name and not OTHERS.search(name):
            assert name in NAMES | {f'{section}.…' for section in SECTIONS}, text
        if colon and name in NAMES:
            PARAMETERS[name].check(parse(value))
    for code in blocks(page, 'bash'):
        for name, value in re.findall(r"--set '?([\w.]+)=([^'\s]+)'?", code):
            FilterParameters().changed({name: parse(value)})
        for name in re.findall(r'ros2 param set \S+ (\S+)', code):
            assert name in NAMES


@EACH_PAGE
def test_parameter_files_are_accepted(page: Path, tmp_path: Path) -> None:
    """Every parameter file that a page shows is one that the node takes."""
    for code in blocks(page, 'yaml'):
        file = tmp_path / 'shown.yaml'
        file.write_text(code, encoding='utf-8')
        FilterParameters().changed(read_yaml(file))


def test_troubleshooting_quotes_the_code() -> None:
    """What the page of symptoms says that is logged, or published in the diagnostics, is."""
    files = sorted((ROOT / 'lidar_outlier_filter').rglob('*.py'))
    text = '\n'.join(path.read_text(encoding='utf-8') for path in files)
    said = re.sub(r"'\n\s*f?'", '', text)  # strings that go on in the next line
    page = (ROOT / 'doc' / 'troubleshooting.md').read_text(encoding='utf-8')
    cells = re.findall(r'^\| (.*?) \|', page, re.MULTILINE)
    phrases = [
        part.strip()
        for cell in cells
        for text in re.findall(r'`([^`]+ [^`]+)`', cell)
        for part in text.removeprefix('boosted_trees').split('…')
        if part
    ]
    assert len(phrases) > 20
    assert [one for one in phrases if one not in said] == []


def test_every_detector_has_a_page() -> None:
    """With its formula and its reference, beside the table of all."""
    folder = ROOT / 'doc' / 'detectors'
    assert {page.stem for page in folder.glob('*.md')} == {*BITS, 'index'}
    assert '<!-- insert: detectors -->' in (folder / 'index.md').read_text(encoding='utf-8')
    for name in BITS:
        text = (folder / f'{name}.md').read_text(encoding='utf-8')
        assert '$' in text.partition('## Formula')[2].partition('## ')[0]
        assert re.search(r'^## References?$', text, re.MULTILINE)
        assert f'<!-- insert: parameters: {name} -->' in text


def test_every_family_has_a_page() -> None:
    """Each of them shows the file of its family, and names the fields that the file names."""
    folder = ROOT / 'doc' / 'quickstart'
    families = {page.stem for page in folder.glob('*.md')} - {'index'}
    assert families == {'velodyne', 'ouster', 'hesai', 'robosense', 'livox', 'profile_scanner'}
    for family in families:
        page = (folder / f'{family}.md').read_text(encoding='utf-8')
        assert f'config/{family}.yaml' in page
        values = read_yaml(ROOT / 'config' / f'{family}.yaml')
        for field in {'time_field', 'line_field'} & {*values}:
            assert f'`{values[field]}`' in page


def test_contributing_quotes_the_example() -> None:
    """CONTRIBUTING shows the example as it is, and names every field of a declaration."""
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    example = ROOT / 'doc/examples/new_detector/isolated.py'
    code = example.read_text(encoding='utf-8').split('\n', 2)[2]
    assert f'```python\n{code}```\n' in text
    for item in fields(Detector):
        assert f'| `{item.name}` |' in text
