# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the package refuses, in one sentence form: what, must be, got.

A sentence is written where it is raised. Any function may raise these errors;
docstrings name them where a caller handles them.
"""

from __future__ import annotations

import struct
import traceback
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

# Errors of a program that comes upon what it did not expect.
_OF_THE_READER = (
    LookupError,
    TypeError,
    ArithmeticError,
    AttributeError,
    AssertionError,
    BufferError,
    EOFError,
    RecursionError,
    UnicodeError,
    struct.error,
)
MAX_CHARACTERS = 1000  # characters of each part of a sentence: what is quoted may be a megabyte


def short(text: str) -> str:
    """Leave out the middle of a text longer than ``MAX_CHARACTERS``."""
    half = MAX_CHARACTERS // 2
    return text if len(text) <= MAX_CHARACTERS else f'{text[:half]}…{text[-half:]}'


def printable(text: str) -> str:
    """Escape characters that are not printable: names in a file may be any bytes.

    So a sentence stays on its line, and a terminal obeys nothing in it.
    """
    if text.isprintable():
        return text
    return ''.join(
        one if one.isprintable() else one.encode('unicode_escape').decode() for one in text
    )


class FilterError(Exception):
    """Something was refused: ``<what> must be <must_be>, got <got>``.

    Examples
    --------
    >>> from lidar_outlier_filter import FilterError, detect_outliers
    >>> try:
    ...     detect_outliers([[0, 0, 0]], chain=['sor'], parameters={'sor.k': 0})
    ... except FilterError as error:
    ...     print(error)
    sor.k must be from 1 to 1000, got 0

    """

    def __init__(self, what: str, must_be: str, got: object) -> None:
        """Keep ``what`` apart, so that refusals can be counted by it."""
        what, must_be, got = short(what), short(must_be), short(str(got))
        super().__init__(printable(f'{what} must be {must_be}, got {got}'))
        self.what = printable(what)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the finished sentence, to go from a worker to the process that asked."""
        return _again, (type(self), *self.args), self.__dict__


def _again(kind: type[FilterError], *sentence: str) -> FilterError:
    return kind.__new__(kind, *sentence)


class ParameterError(FilterError):
    """A parameter, or a set of them, that makes no sense."""


class CloudError(FilterError):
    """A cloud that cannot be read, or has impossible values."""


class JudgingError(CloudError):
    """A cloud that could not be judged, because a detector raised an error.

    Attributes
    ----------
    place : file and line where it was raised
    trace : the traceback

    """

    def __init__(self, error: Exception) -> None:
        """Describe ``error``, and let go of it: its traceback holds the points."""
        text = ' '.join(f'{type(error).__name__}: {error}'.split())
        super().__init__('detection', 'free of errors', text)
        frames = traceback.extract_tb(error.__traceback__)
        self.place = f'{frames[-1].filename}:{frames[-1].lineno}' if frames else ''
        self.trace = ''.join(traceback.format_exception(error))


def quote_error(error: BaseException) -> str:
    """Quote a library's error on one line, if it says something of the file.

    Others, such as ``list index out of range``, are about the reading code: they only show that
    the file breaks its format.
    """
    text = str((isinstance(error, OSError) and error.strerror) or error)
    if isinstance(error, _OF_THE_READER) or not text.strip():
        text = 'bytes that its format does not allow'
    return '"' + printable(' '.join(text.split())) + '"'


@contextmanager
def refusing(
    kind: type[FilterError],
    what: str,
    must_be: str,
    caught: type[Exception] = Exception,
    passed: type[Exception] = FilterError,
) -> Iterator[None]:
    """Turn an error of a library, or of the system, into a refusal of this kind."""
    try:
        yield
    except (FilterError, passed):
        raise
    except caught as err:  # readers of damaged files, and stores, raise anything
        raise kind(what, must_be, quote_error(err)) from err


class PoseError(FilterError):
    """A pose with impossible values."""


class RecordingError(FilterError):
    """A recording that cannot be read or written.

    Attributes
    ----------
    is_damage : whether reading failed, but a part of the recording may be readable

    """

    is_damage = False


class NoCloudsError(RecordingError):
    """A recording without a topic of clouds."""


class SchedulerError(FilterError):
    """A scheduler that does not respond, or whose workers run another version."""


def refused_for(counts: Mapping[str, int], sentences: Mapping[str, str]) -> str:
    """Say why clouds were refused: the first sentence for each reason, and how many there were."""
    return '; '.join(f'{sentences.get(what, what)} ({count})' for what, count in counts.items())
