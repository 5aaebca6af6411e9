"""What the last stage of a step leaves for the next one: joined calls and kept tangents."""

from dataclasses import dataclass

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.joined_stage import JoinedStage
from fecloth.nonlinear.stage import Stage
from fecloth.system.system import System

# Iterations of a step that a kept tangent serves.
MOST_USES = 3


@dataclass(eq=False)
class KeptTangents:
    """The tangents that several iterations of a step share.

    A term that `keeps_tangent`, such as a plate, has a tangent that is expensive and changes
    little within a step. So it serves `MOST_USES` iterations, and is evaluated anew in the first
    iteration of each step.

    Attributes
    ----------
    matrix
        wv D + wx K of these terms.
    definite
        Whether it is definite.
    uses
        The number of iterations that it has served; 0 where it must be evaluated anew.
    """

    matrix: BlockMatrix
    definite: bool = False
    uses: int = 0

    def must_renew(self, definite: bool) -> bool:
        """Whether the next iteration needs it anew; counts that iteration."""
        renew = self.uses in (0, MOST_USES) or definite != self.definite
        self.uses = 1 if renew else self.uses + 1
        self.definite = definite
        return renew


@dataclass(eq=False)
class LastStage:
    """What the last stage of a step leaves for the next one.

    Attributes
    ----------
    joined
        The joined calls; None where a term has no such calls.
    kept
        The tangents that several iterations share; None before the first stage.
    refused
        The classes of the terms that have no joined calls.
    """

    joined: JoinedStage | None = None
    kept: KeptTangents | None = None
    refused: tuple[type, ...] = ()

    def begin(self, system: System, stage: Stage, matrix: BlockMatrix) -> None:
        """Begin a stage of a step: join its calls if its terms have such calls."""
        self.kept = self._kept_tangents(system, matrix)
        self.joined = self._join(system, matrix)
        if self.joined is not None:
            self.joined.begin(system, stage)

    def _kept_tangents(self, system: System, matrix: BlockMatrix) -> KeptTangents | None:
        """The tangents that iterations share, to be evaluated anew; None without any."""
        if not (system.is_whole and any(term.keeps_tangent for term in system.bound)):
            return None
        if self.kept is None or self.kept.matrix.pattern is not matrix.pattern:
            return KeptTangents(BlockMatrix.zeros(matrix.pattern, matrix.team))
        return KeptTangents(self.kept.matrix)

    def _join(self, system: System, matrix: BlockMatrix) -> JoinedStage | None:
        """The calls of the last stage if they serve this one too; else new ones, or None."""
        kept = None if self.kept is None else self.kept.matrix
        if self.joined is not None and self.joined.serves(system, matrix, kept):
            return self.joined
        classes = tuple(type(term) for term in system.bound)
        if classes == self.refused:
            return None
        joined = JoinedStage.of(system, matrix, kept)
        if joined is None:
            self.refused = classes
        return joined
