"""Systems that are made beside another one, and take from it what is the same."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

base: ContextVar[Any] = ContextVar("base", default=None)


@contextmanager
def reusing(system: Any) -> Iterator[None]:
    """Let each `System` that is made in this block take from `system` what is the same.

    Then only the terms are bound again that use what has changed. All results have the same
    bits as without it. It is a block and no argument, because the system may be made by a
    function of the user.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    >>> def make(g):
    ...     return fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Gravity((0, 0, g))])
    >>> earth = make(-9.81)
    >>> with reusing(earth):
    ...     moon = make(-1.62)
    >>> [new is old for new, old in zip(moon.bound, earth.bound)]
    [True, False]
    """
    token = base.set(system)
    try:
        yield
    finally:
        base.reset(token)
