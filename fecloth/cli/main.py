"""The command line: one parser of all commands, exit statuses, signals and lost output."""

import os
import re
import signal
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import Any, NoReturn, TextIO

from fecloth import __version__
from fecloth.cli.arguments import add_arguments, call, help_words
from fecloth.cli.commands import COMMANDS, MAY_LOSE_TEXT
from fecloth.errors import FAILED, STOPPED, FeclothError, did_you_mean
from fecloth.runs.interruption import set_handler, stop_at_once


class Tolerant:
    """A text stream that goes to the null device once the system has refused a write."""

    def __init__(self, stream: TextIO):
        self.stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write, or drop the text if the system refuses it."""
        try:
            return self.stream.write(text)
        except OSError as error:
            self._redirect(error)
            return len(text)

    def flush(self) -> None:
        """Flush, or drop what is left if the system refuses it."""
        try:
            self.stream.flush()
        except OSError as error:
            self._redirect(error)

    def _redirect(self, error: OSError) -> None:
        """Keep the first error, and let the file and its buffer go to the null device."""
        self.failure = self.failure or error
        with suppress(OSError, ValueError):  # a stream in memory has no file
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.stream.fileno())
            os.close(null)

    def __getattr__(self, name: str):
        return getattr(self.stream, name)


@contextmanager
def tolerant_streams() -> Iterator[None]:
    """Make sys.stdout and sys.stderr `Tolerant` in the block; afterwards they are as before.

    In both, ``?`` takes the place of a character that their encoding lacks.
    """
    original_streams = sys.stdout, sys.stderr
    for stream in original_streams:
        # stderr writes \u03c1 for ρ by itself; a stream may be closed (None) or of another kind
        if isinstance(stream, TextIOWrapper) and stream.errors != "backslashreplace":
            stream.reconfigure(errors="replace")
    sys.stdout, sys.stderr = (stream and Tolerant(stream) for stream in original_streams)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = original_streams


def lost_output() -> str:
    """Flush both streams; return why standard output is not complete, or "".

    A reader that has gone, as in ``fecloth info | head -1``, has read what it wanted.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream:
            stream.flush()
    failure = getattr(sys.stdout, "failure", None)
    if failure is None or isinstance(failure, BrokenPipeError):
        return ""
    return f"standard output cannot be written ({failure.strerror})"


# The commands and the parser import no numerical package, so that --version and --help answer at
# once, and that signals are handled before NumPy is imported.

STATUS = """exit status:
  0  done
  1  check: a value lies outside its tolerance; tune: not proved
  2  bad input: nothing was run
  3  the simulation failed, or the disk is full; what was written up to then is readable
  4  interrupted; run goes on with --resume, a study with the same command
"""


def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit status (see `STATUS`).

    Without `arguments` it takes the arguments of the process. Then signals are ignored after the
    command until the process ends, so that they do not change its status. With `arguments`, the
    earlier handlers of signals are set again. A command that a signal stops prints "interrupted"
    to standard error.
    """
    earlier_handlers = set_handler(stop_at_once)
    try:
        return _run_command(arguments)
    except (KeyboardInterrupt, RuntimeError) as error:
        # Python 3.11 raises a RuntimeError for what ends a `__set_name__`, as in an import.
        stop: BaseException | None = error
        if isinstance(error, RuntimeError):
            stop = error.__cause__
        if not isinstance(stop, KeyboardInterrupt):
            raise
        set_handler(signal.SIG_IGN)
        # A study says in the exception how it goes on.
        words = f"interrupted {stop}" if stop.args else "interrupted; run it again"
        with suppress(OSError):  # a closed pipe
            print(words, file=sys.stderr)
        return STOPPED
    finally:
        set_handler(signal.SIG_IGN)
        if arguments is not None:
            for number, handler in earlier_handlers.items():
                signal.signal(number, handler)


def _run_command(arguments: list[str] | None) -> int:
    """Run a command and return its exit status; print the line of an error.

    Lost output is a failure where the output is the result of the command.
    """
    with tolerant_streams():
        options = _parser().parse_args(arguments)
        from fecloth.output.atomic_files import ending_of

        try:
            status = call(options.function, vars(options))
        except (FeclothError, OSError, MemoryError) as error:
            status, line = ending_of(error)
            print(line, file=sys.stderr)
        set_handler(signal.SIG_IGN)
        if (why := lost_output()) and options.function not in MAY_LOSE_TEXT:
            print(f"failed: {why}", file=sys.stderr)
            status = status or FAILED
        return status


def _parser() -> ArgumentParser:
    """Return the parser of all commands; what it parses has the `function` of the command."""
    layout: dict[str, Any] = {"epilog": STATUS, "formatter_class": RawDescriptionHelpFormatter}
    parser = SuggestingParser("fecloth", description="A continuum cloth solver.", **layout)
    parser.add_argument("--version", action="version", version=f"fecloth {__version__}")
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", dest="command", required=True
    )
    for function in COMMANDS:
        words = help_words(function)
        sub = commands.add_parser(function.__name__, help=words, description=words, **layout)
        sub.set_defaults(function=function)
        add_arguments(sub, function)
    return parser


class SuggestingParser(ArgumentParser):
    """A parser that suggests the closest choice for a word that is none of the choices."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and the message; exit with status 2."""
        if match := re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message):
            names = re.findall(r"[\w-]+", match[2])
            words = f"{match[1]!r}: must be one of {', '.join(names)}. "
            message = (words + did_you_mean(match[1], names)).strip()
        super().error(message)
