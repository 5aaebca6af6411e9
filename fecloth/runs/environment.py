"""What a run runs on, the memory of this process, and the wall seconds of a run by phase."""

import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

PACKAGES = (
    "numpy",
    "scipy",
    "scikit-fem",
    "gmsh",
    "meshio",
    "numba",
    "rslab",
    "pypardiso",
    "mkl",
)


def versions() -> dict[str, str]:
    """Return the versions of fecloth, Python and installed packages, and the platform."""
    known = {"python": platform.python_version(), "platform": platform.platform()}
    for name in ("fecloth", *PACKAGES):
        try:
            known[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return known


def peak_memory() -> float | None:
    """Return the peak memory of this process so far [MB = 10⁶ bytes]; None on Windows."""
    status = Path("/proc/self/status")
    # On Linux getrusage would count the memory of the parent process; the line VmHWM [KiB] has
    # the "high water mark" of this process alone.
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes: macOS counts bytes, others KiB
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


@dataclass
class Watch:
    """Seconds by phase, each the time spent in its `phase` blocks."""

    begin: float = field(default_factory=time.perf_counter)
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the seconds of a block to the phase of a name."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.add({name: time.perf_counter() - begin})

    def add(self, seconds: dict[str, float]) -> None:
        """Add seconds to phases, by their names."""
        for name, spent in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + spent

    @property
    def total(self) -> float:
        """The seconds since the watch was made."""
        return time.perf_counter() - self.begin
