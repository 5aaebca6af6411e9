"""What Newton's iteration knows after a step."""

from dataclasses import dataclass

from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.remedies import Remedy, RemedySearch


@dataclass(frozen=True)
class Pause:
    """A pause after whole steps in vain: iterations that are left of it, and its length."""

    left: int = 0
    length: int = 0


@dataclass(frozen=True, eq=False)
class Progress:
    """What an iteration knows after its last step; each step makes a new record.

    Attributes
    ----------
    number
        Iterations so far.
    point
        Where they led.
    search
        The remedies that they took.
    least_norm
        The least ‖R‖ so far.
    length
        α of the last step; 0 where none was found.
    reason
        Why none was found.
    longest_move
        How far the last step moved the node that it moved most [m].
    stagnates
        Whether the last step hardly moved the cloth and hardly changed the residual.
    cut_short
        Whether its direction is what conjugate gradients had when they met negative curvature.
    slow_steps
        Slow steps in a row.
    short_steps
        Short steps in a row, see `Steps.advance`.
    pause
        After whole steps in vain, see `Steps.explore`.
    """

    number: int
    point: Point
    search: RemedySearch
    least_norm: float
    length: float = 1.0
    reason: str = ""
    longest_move: float = 0.0
    stagnates: bool = False
    cut_short: bool = False
    slow_steps: int = 0
    short_steps: int = 0
    pause: Pause = Pause()

    @property
    def remedy(self) -> Remedy:
        """The remedy of the last step."""
        return self.search.remedy

    @property
    def failed(self) -> bool:
        """Whether no step was found."""
        return self.length == 0.0
