"""Standard output and error that do not end a command: any encoding, closed pipes, full disks."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import TextIO


class Tolerant:
    """A text stream that goes to the null device from the first write that the system refuses."""

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
        """Keep the first error, and lead the file to the null device with what it still holds."""
        self.failure = self.failure or error
        with suppress(OSError, ValueError):  # a stream in memory has no file
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.stream.fileno())
            os.close(null)

    def __getattr__(self, name: str):
        return getattr(self.stream, name)


@contextmanager
def tolerant_streams() -> Iterator[None]:
    """Make sys.stdout and sys.stderr tolerant; characters that an encoding lacks become ``?``."""
    before = sys.stdout, sys.stderr
    for stream in before:
        # stderr writes \u03c1 for ρ by itself; a stream may be closed (None) or of another kind
        if isinstance(stream, TextIOWrapper) and stream.errors != "backslashreplace":
            stream.reconfigure(errors="replace")
    sys.stdout, sys.stderr = (stream and Tolerant(stream) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def lost_output() -> str:
    """Flush both streams; return why standard output is not complete, or ""."""
    # A reader that has gone, as in ``fecloth info | head -1``, has read what it wanted.
    for stream in (sys.stdout, sys.stderr):
        if stream:
            stream.flush()
    failure = getattr(sys.stdout, "failure", None)
    if failure is None or isinstance(failure, BrokenPipeError):
        return ""
    return f"standard output cannot be written ({failure.strerror})"
