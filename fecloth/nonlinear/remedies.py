"""The remedies for a matrix that fails in Newton's iteration, and in which order they are tried.

A matrix fails where it is not positive definite, or where its direction is no improvement. A
remedy replaces it by one with clamped tangents, or adds σ M to it, or both.
"""

from typing import NamedTuple, Self

# Iterations of a step that may try clamped tangents before they add mass. Clamping relieves the
# compression of a first guess in one iteration. In a cloth that stays in compression a clamped
# tangent lacks what the solution has.
MOST_CLAMPED_ITERATIONS = 4

# What is tried after what. A row is the kind of the remedy that the last iteration took. It names
# the groups of remedies to try next, in this order; `RemedySearch.numbers` has their numbers.
TRIED_AFTER = {
    "exact": ("first", "clamped", "others"),
    "clamped": ("first", "clamped", "others"),
    "mass": ("one weaker and all stronger",),
    "mass and clamped": ("first", "clamped", "others"),
}


class Remedy(NamedTuple):
    """σ [of the matrix's mass M] to add to the matrix as σ M, and whether to clamp tangents."""

    shift: float
    definite: bool

    @property
    def kind(self) -> str:
        """The row of `TRIED_AFTER`."""
        if self.shift:
            return "mass and clamped" if self.definite else "mass"
        return "clamped" if self.definite else "exact"


class Remedies(NamedTuple):
    """The remedies of an equation.

    Attributes
    ----------
    order
        All of them, weaker ones first. The first is the exact matrix, if that may be taken.
    second
        Number of the remedy to go on with where the first one fails for the first time.
    clamped
        Number of the remedy to try between these two, in at most four iterations; None for none.
    """

    order: tuple[Remedy, ...]
    second: int = 1
    clamped: int | None = None


class RemedySearch(NamedTuple):
    """What the iterations so far tell about the remedies to try in the next one.

    Attributes
    ----------
    remedies
        Those of the equation.
    resume
        Number of the remedy with which the search goes on where the first one fails.
    last
        Number of the remedy that the last iteration took.
    clamps
        How many iterations took the remedy `Remedies.clamped`.
    """

    remedies: Remedies
    resume: int
    last: int = 0
    clamps: int = 0

    @classmethod
    def begin(cls, remedies: Remedies) -> Self:
        """The search of an iteration that took no remedy yet."""
        return cls(remedies, remedies.second)

    @property
    def remedy(self) -> Remedy:
        """The remedy that the last iteration took."""
        return self.remedies.order[self.last]

    @property
    def has_clamped_enough(self) -> bool:
        """Whether no further iteration should try clamped tangents before mass."""
        return self.clamps >= MOST_CLAMPED_ITERATIONS

    def to_try(self) -> list[int]:
        """Numbers of the remedies to try now, in order."""
        groups = TRIED_AFTER[self.remedy.kind]
        return [number for group in groups for number in self.numbers(group)]

    def numbers(self, group: str) -> list[int]:
        """Numbers of the remedies in a group of `TRIED_AFTER`, in the order of trying.

        "first" is the exact matrix, "clamped" the remedy `Remedies.clamped` while its number of
        iterations lasts, and "others" are all from `resume` on. The last group has the remedy
        before that of the last iteration, which is weaker, and all after it.
        """
        count = len(self.remedies.order)
        match group:
            case "first":
                return [0]
            case "clamped":
                clamped = self.remedies.clamped
                if clamped is None or self.has_clamped_enough:
                    return []
                return [clamped]
            case "others":
                return list(range(self.resume, count))
        return list(range(self.last - 1, count))  # one weaker and all stronger

    def take(self, number: int) -> Self:
        """The search after an iteration that took a remedy.

        The search resumes one before a remedy that helped, so that the next iteration may do
        with a weaker one.
        """
        if number == 0:
            return self._replace(last=number)
        if number == self.remedies.clamped:
            return self._replace(last=number, clamps=self.clamps + 1)
        return self._replace(last=number, resume=max(number - 1, 1))
