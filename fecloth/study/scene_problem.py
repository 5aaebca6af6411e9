"""A scene that a study refines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

from fecloth.errors import InputError, is_number
from fecloth.integrators import EXPLICIT
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.scene.scene import Scene
from fecloth.scene.shape_tables import GradingTable
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.quantity import Quantity
from fecloth.study import measured_runs
from fecloth.study.common_problem import CommonProblem, quantities_of
from fecloth.study.levels import Level
from fecloth.study.scene_text import digest_of_files, scene_of, text_of
from fecloth.study.setups import Setup, setup_of_scene
from fecloth.study.workload import Workload


@dataclass(frozen=True, eq=False)
class SceneProblem(CommonProblem):
    """A scene to refine."""

    scene: Scene
    name: str

    @cached_property
    def first(self) -> Setup:  # type: ignore[override]  # computed when it is first needed
        built = self.scene.build()
        run = built.system, built.state, built.steps, built.t_end, built.newton, built.linear
        return Setup(*run, built.probes)

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.scene.probes)

    @property
    def h(self) -> float | None:
        """Edge length of the first level [m]."""
        return self.scene.cloth.h

    @property
    def interest(self) -> tuple[Quantity, ...]:
        """The quantities of [interest]."""
        return tuple(self.scene.interest.all) if self.scene.interest else ()

    @property
    def rtol(self) -> float:
        """Tolerance of chosen steps [1/s]; 0 where the error does not choose them."""
        time = self.scene.time
        if self.scene.equilibrium or time.dt != "auto":
            return 0.0
        stable = time.method.type in EXPLICIT and time.rtol is None
        return 0.0 if stable else Adaptive.rtol if time.rtol is None else time.rtol

    @property
    def quantities(self) -> tuple[Quantity, ...]:  # type: ignore[override]  # read only
        """The quantities of [interest]; else the paths or ends of the probes, or displacement."""
        return self.interest or quantities_of(self.probes, static=bool(self.scene.equilibrium))

    def ratio(self, refine: str) -> float:
        """Return the usual ratio of two levels; that of nested meshes is 2."""
        nested = getattr(self.scene.cloth, "pattern", "unstructured") != "unstructured"
        return 2.0 if nested or refine == "dt" else math.sqrt(2)

    def can_refine(self, what: str) -> bool:
        """Whether the scene has an h, or a dt in seconds."""
        if what == "dt" and self.scene.equilibrium:
            return False
        return is_number(self.scene.cloth.h if what == "h" else self.scene.time.dt)

    @cached_property
    def size(self) -> Workload:
        """Predicted size of the first level, without its mesh."""
        return Workload.of(self.scene)

    def workload(self, level: Level) -> Workload:
        """Predict the size of a level, without its mesh."""
        finer = level.dt
        if self.scene.equilibrium:
            finer = 1.0
        elif self.scene.time.dt == "auto":
            finer = level.h * math.sqrt(level.rtol)
        triangles, steps = self.size.triangles * level.h**2, math.ceil(self.size.steps * finer)
        return Workload(triangles, steps, self.size.is_explicit)

    def check(self, refine: str) -> None:
        """Raise `InputError` if it has no h or dt to refine."""
        if refine != "dt" and not self.can_refine("h"):
            remedy = "Give a .geo file and h, or a shape."
            raise InputError("a mesh of one size", "has no cloth.h to refine", self.name, remedy)
        if self.scene.equilibrium:
            if refine != "h":
                raise InputError(f"refine = {refine!r}", "an equilibrium has no dt", self.name)
            return
        explicit = self.scene.time.method.type in EXPLICIT and self.scene.time.rtol is None
        if refine == "dt" and not self.can_refine("dt"):
            raise InputError('dt = "auto"', "cannot be refined", self.name, "Give time.dt.")
        if refine == "both" and not (explicit or self.can_refine("dt")):
            remedy = "Give time.dt; or refine h: the steps follow their tolerance."
            raise InputError('dt = "auto"', "cannot be refined", self.name, remedy)

    def text(self, level: Level) -> str:
        """Return the scene of a level; a refined dt divides the run into equal steps."""
        h, dt, time = self.scene.cloth.h, None, self.scene.time
        if level.dt != 1 and time and time.dt != "auto":
            span = time.t_end - time.t_start
            dt = span / round(math.ceil(span / time.dt - 1e-9) * level.dt)
        finer = None if level.h == 1 or h is None else h / level.h
        rtol = None if level.rtol == 1 else self.rtol / level.rtol
        return text_of(self.scene, finer, dt, level.sharper, rtol)

    def graded(self, gradings: Sequence[Grading]) -> SceneProblem:
        """Return the problem with [[cloth.grading]]; a scene may not have its own already."""
        if self.scene.cloth.grading:
            remedy = "Leave grade or the gradings out."
            raise InputError("grade = True", "the scene has [[cloth.grading]]", self.name, remedy)
        entries = tuple(GradingTable(**asdict(one)) for one in gradings)
        cloth = self.scene.cloth.model_copy(update={"grading": entries})
        return replace(self, scene=self.scene.model_copy(update={"cloth": cloth}))

    runner = staticmethod(measured_runs.run_scene_text)
    is_importable = True

    def setup(self, level: Level) -> Setup:
        """Build the scene of a level."""
        return setup_of_scene(self.text(level), self.scene.trusts_geo)

    def case(self, level: Level, recorded: list[str], modes: int) -> dict[str, object]:
        """Return the arguments of `runner` for a level."""
        text, digest = self.text(level), digest_of_files(self.scene)
        case = {"text": text, "digest": digest, "recorded": recorded, "modes": modes}
        return case | {"trust_geo": self.scene.trusts_geo}

    def cloth_of(self, level: Level, quantity: Quantity) -> Cloth | None:
        """Return the cloth of a level where the quantity needs it."""
        return (
            scene_of(self.text(level), self.scene.trusts_geo).mesh() if quantity.is_field else None
        )
