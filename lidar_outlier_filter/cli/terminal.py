# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What commands share: sentences, progress bars, signals, and parameters from the command line.

Each function imports what is heavy when it runs, so that help is instant.
"""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

import signal
import sys
import threading
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

from lidar_outlier_filter.errors import FilterError, ParameterError, printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from types import FrameType

    from rich.table import Table

LINE_PERIOD = 5.0  # seconds between two lines of progress, where there is no terminal
# Exit statuses; argparse itself exits with 2.
DONE, REFUSED, INCOMPLETE, IMPLAUSIBLE, INTERRUPTED = 0, 1, 3, 4, 130
SIGNALS = (signal.SIGINT, signal.SIGTERM)
EXTRAS = {'matplotlib': 'lab', 'PIL': 'lab', 'sklearn': 'lab', 'open3d': 'bench'}
MESSAGES = ('diagnostic_msgs', 'nav_msgs', 'rcl_interfaces', 'sensor_msgs', 'std_msgs', 'std_srvs')
EXTRAS |= dict.fromkeys(('rclpy', *MESSAGES), 'ros')


class Advance(Protocol):
    """Moves a bar."""

    def __call__(self, done: int, total: int, text: str = '', /) -> object:
        """Show that so many of so many are done, and of what."""


def say(sentence: str) -> None:
    """Write a sentence to stderr, on one line."""
    from rich.console import Console

    Console(stderr=True).print(printable(sentence), markup=False, highlight=False, soft_wrap=True)


def show(*parts: Any) -> None:
    """Print lines, each as it is, and tables; where no column wraps, a wide one is not cut."""
    from rich.console import Console

    console = Console(emoji=False)
    for part in parts:
        if isinstance(part, str):
            console.print(printable(part), markup=False, highlight=False, soft_wrap=True)
        else:
            _quote_cells(part)
            if all(column.no_wrap for column in part.columns):
                console.width = max(console.width, Console(width=999).measure(part).maximum)
            console.print(part)


def _quote_cells(table: Table) -> None:
    """Have a table print its texts as they are: names in a file may be markup, or any bytes."""
    from rich.text import Text

    def quoted(cell: Any) -> Any:
        lines = cell.split('\n') if isinstance(cell, str) else []
        return Text('\n'.join(map(printable, lines))) if lines else cell

    for column in table.columns:
        column.header = quoted(column.header)
        column._cells = [quoted(cell) for cell in column.cells]  # noqa: SLF001  nothing sets them


def numbers(first: str, *others: str, texts: int = 1, **style: Any) -> Table:
    """Make a table of numbers, with ``texts`` columns of names before them."""
    from rich.table import Table

    made = Table(first, *others, **style)
    for column in made.columns[:texts]:
        column.overflow = 'fold'  # a name is never cut
    for column in made.columns[texts:]:
        column.justify, column.no_wrap = 'right', True
    return made


def missing_module(err: ModuleNotFoundError) -> FilterError:
    """Say which extra installs a module that a command needs; raise other errors again."""
    module = (err.name or '').partition('.')[0]
    if module == 'rosbags':  # of what the commands need, Ubuntu packages all but this
        where = 'installed for recordings (the page on installation has the line)'
        return FilterError('the module rosbags', where, 'none')
    if module not in EXTRAS:
        raise err
    extra = EXTRAS[module]
    source = 'source ROS 2, or ' if extra == 'ros' else ''
    must_be = f"installed for this command: {source}pip install '.[{extra}]' in the project"
    return FilterError(f'the module {module}', must_be, 'none')


def can_draw() -> bool:
    """Return whether matplotlib is installed; say so if it is not."""
    try:
        import_module('matplotlib')
    except ModuleNotFoundError as err:
        say(f'{missing_module(err)}; no picture is drawn')
        return False
    return True


def ignore() -> None:
    """Ignore both signals once all is written: the exit status reports success."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def stopping() -> Iterator[Callable[[], None]]:
    """Give a function to call where work may stop; it leaves if SIGINT or SIGTERM was received.

    An exception raised by the handler could come up anywhere: inside a compiled kernel or the
    middleware, which swallow or replace it. A second signal ends the process at once. Once the work
    is done, both are ignored.
    """
    received: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        received.append(number)
        for one in SIGNALS:
            signal.signal(one, signal.SIG_DFL)

    def leave_if_asked() -> None:
        if signal.SIGINT in received:
            raise KeyboardInterrupt
        if received:
            sys.exit(128 + received[0])

    before = {number: _once(number, note) for number in SIGNALS}
    try:
        yield leave_if_asked
    except BaseException:
        for number, handler in before.items():
            signal.signal(number, handler)
        raise
    ignore()


def _once(number: int, handler: Callable[[int, FrameType | None], None]) -> signal._HANDLER:
    """Set a handler for one signal only: the next one ends the process. Return the handler before.

    Python runs a handler between two of its steps, which may be hours apart. So the system puts the
    default back, where it has a function for that.
    """
    before = signal.signal(number, handler)
    import ctypes

    system = ctypes.CDLL(None)
    if hasattr(system, 'sysv_signal'):
        system.sysv_signal.restype = ctypes.c_void_p
        system.sysv_signal.argtypes = (ctypes.c_int, ctypes.c_void_p)
        python = system.sysv_signal(number, None)
        system.sysv_signal(number, python)
    return before


@contextmanager
def handlers_kept() -> Iterator[None]:
    """Put the handlers of both signals back at the end, for whoever called."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def saying_how_far(how_far: Callable[[], str]) -> Iterator[None]:
    """Say what is done, and how to go on, where SIGINT or SIGTERM ends the work within."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        say(f'interrupted: {how_far()}')
        raise


@contextmanager
def progress_bar(text: str, *, lines: bool = False) -> Iterator[Advance]:
    """Show a bar on stderr if that is a terminal; else lines, where they are asked for."""
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress

    console, due = Console(stderr=True), monotonic() + LINE_PERIOD
    if not console.is_terminal:

        def line(done: int, total: int, what: str = '') -> None:
            nonlocal due
            if lines and monotonic() >= due:
                due = monotonic() + LINE_PERIOD
                say(f'{text}: {what}, {100 * done / max(total, 1):.0f} %')

        yield line
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(escape(printable(text)), total=None)

        def advance(done: int, total: int, what: str = '') -> None:
            description = f'{text}: {what}' if what else text
            description = escape(printable(description))
            bar.update(task, completed=done, total=total, description=description)

        yield advance


@contextmanager
def stoppable_bar(text: str, *, lines: bool = False) -> Iterator[Advance]:
    """Show a bar, as :func:`progress_bar`; each step leaves if SIGINT or SIGTERM has come."""
    with stopping() as leave_if_asked, progress_bar(text, lines=lines) as show:

        def advance(done: int, total: int, what: str = '') -> None:
            leave_if_asked()
            show(done, total, what)

        yield advance


def beside(recording: Path, ending: str) -> Path:
    """Name an output after a recording, a file or a folder, beside it."""
    path = recording.resolve()
    name = path.name if path.is_dir() else path.stem
    return path.with_name(name + ending)


def refuse_inside(folder: Any, root: Any) -> None:
    """Refuse a folder of outputs that is searched for inputs."""
    inside = str(folder.resolve() if isinstance(folder, Path) else folder)
    if f'{inside}/'.startswith(f'{root}/'):
        raise FilterError('the output', f'outside of {root}, which is searched', folder)


def say_unread(count: int) -> None:
    """Say how many messages a recording lacks, if any."""
    if count:
        say(f'{count} messages of its own count are missing in the recording')


def names_in(text: str) -> tuple[str, ...]:
    """Read names with commas between."""
    return tuple(name.strip() for name in text.split(',') if name.strip())


def split_setting(option: str, text: str, must_be: str) -> tuple[str, str]:
    """Split the text of an option at its first equals sign."""
    name, equals, value = text.partition('=')
    if not equals:
        raise ParameterError(option, must_be, repr(text))
    return name, value


def parse_value(name: str, text: str) -> object:
    """Read the value of a parameter as in YAML."""
    import yaml

    from lidar_outlier_filter.parameters.yaml_files import parse

    try:
        return parse(text)
    except yaml.YAMLError as err:
        raise ParameterError(f'the value of {name}', 'YAML', repr(text)) from err


def _check_list(name: str, value: object) -> None:
    """Show how a list is written to who gives names with commas between, as to --chain."""
    from lidar_outlier_filter.parameters.filter import describe

    lists = {one.name for one in describe() if isinstance(one.default, tuple)}
    if name in lists and isinstance(value, str):
        must_be = f'a list, as in {name}=[{value}]'
        raise ParameterError(f'the value of {name}', must_be, repr(value))


def read_parameters(
    files: Iterable[Path], settings: Iterable[str], chain: str | None = None
) -> dict[str, object]:
    """Take parameters from files, in their order, single ones from NAME=VALUE, then a chain."""
    values: dict[str, object] = {}
    for file in files:
        from lidar_outlier_filter.parameters.yaml_files import config_folder, read_yaml

        # As the pages name those of the package, whose folder is elsewhere without its sources.
        installed = config_folder().parent / file
        if not file.exists() and file.parts[0] == 'config' and installed.is_file():
            say(f'{file} is that of the package, {installed}')
            file = installed  # noqa: PLW2901
        values.update(read_yaml(file))
    for setting in settings:
        name, text = split_setting('--set', setting, 'NAME=VALUE')
        values[name] = parse_value(name, text)
        _check_list(name, values[name])
    if chain is not None:
        values['chain'] = names_in(chain)
    return values
