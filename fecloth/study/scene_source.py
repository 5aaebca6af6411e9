"""A scene that a study changes and refines."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from fecloth.errors import InputError, errors_of
from fecloth.integrators import EXPLICIT
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.runs.first_calls import compile_kernels
from fecloth.scene.scene import Scene, scene_of
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.setup import Setup
from fecloth.study.change import Change, Level
from fecloth.study.problem import CommonProblem, quantities_of
from fecloth.study.setups import table_of_grading
from fecloth.study.workload import Workload

# Tables that change no result of a run: what it is called, and what is done with its results.
WITHOUT_EFFECT = ("title", "expect", "interest", "output", "uncertain", "measured")


@dataclass(frozen=True, eq=False)
class SceneProblem(CommonProblem):
    """A scene to change and refine.

    Attributes
    ----------
    scene
        The scene.
    name
        Its title, or the name of its file.
    source
        What errors name: the name of the file, if there is one.
    """

    scene: Scene
    name: str
    source: str = "the scene"
    is_importable = True  # other processes can read its tables

    @cached_property
    def tables(self) -> dict:
        """The tables of the scene, with all defaults and absolute paths."""
        return self.scene.to_tables()

    @cached_property
    def first(self) -> Setup:  # type: ignore[override]  # computed when it is needed
        """The setup of the first level."""
        return self._build()

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes."""
        return tuple(probe.name for probe in self.scene.probes)

    @property
    def h(self) -> float | None:  # type: ignore[override]  # read only
        """Edge length [m]."""
        return self.scene.cloth.h

    @property
    def dt(self) -> float | None:  # type: ignore[override]  # read only
        """Fixed step [s]; None where there is none."""
        if self.scene.equilibrium or self.scene.time.dt == "auto":
            return None
        return self.scene.time.dt

    @property
    def span(self) -> float | None:  # type: ignore[override]  # read only
        """Length of the run [s]; None for an equilibrium."""
        time = self.scene.time
        if self.scene.equilibrium:
            return None
        return time.t_end - time.t_start

    @property
    def interest(self) -> tuple[Quantity, ...]:
        """The quantities of [interest]."""
        if self.scene.interest:
            return tuple(self.scene.interest.all)
        return ()

    @property
    def rtol(self) -> float:
        """Tolerance of steps that their error chooses [1/s]; 0 if it does not choose them."""
        time = self.scene.time
        if self.scene.equilibrium or time.dt != "auto":
            return 0.0
        if time.rtol is not None:
            return time.rtol
        if time.method.type in EXPLICIT:  # without rtol it takes its stable step
            return 0.0
        return Adaptive.rtol

    @property
    def quantities(self) -> tuple[Quantity, ...]:  # type: ignore[override]  # read only
        """The quantities of [interest]; else paths or ends of the probes, or displacement."""
        return self.interest or quantities_of(self.probes, static=bool(self.scene.equilibrium))

    def ratio(self, refine: str) -> float:
        """Return the usual ratio of two levels; for nested meshes it is 2."""
        nested = getattr(self.scene.cloth, "pattern", "unstructured") != "unstructured"
        if nested or refine == "dt":
            return 2.0
        return math.sqrt(2)

    @cached_property
    def size(self) -> Workload:
        """Predicted size of the first level, without its mesh."""
        return Workload.of(self.scene)

    def workload(self, level: Level) -> Workload:
        """Predict the size of a level from the size of the first one, without its mesh.

        With dt = "auto" the number of steps is taken in proportion to 1/h and 1/√rtol.
        """
        steps_ratio = level.dt
        if self.scene.equilibrium:
            steps_ratio = 1.0
        elif self.scene.time.dt == "auto":
            steps_ratio = level.h * math.sqrt(level.rtol)
        triangles = self.size.triangles * level.h**2
        steps = math.ceil(self.size.steps * steps_ratio)
        return replace(self.size, triangles=triangles, steps=steps)

    def check(self, refine: str) -> None:
        """Raise `InputError` if there is no h or fixed dt to refine.

        `refine` is "h", "dt" or "both". An explicit method with its stable step needs no dt for
        "both": the step falls with h.
        """
        if refine != "dt" and not self.can_refine("h"):
            remedy = "Give a .geo file and h, or a shape."
            if self.tables["cloth"].get("shape") == "join":
                remedy = "Each of [cloths.NAME] has its own h: open a function of h in Python."
            allowed = "has no cloth.h to refine"
            raise InputError("a mesh of one size", allowed, self.source, remedy)
        if self.scene.equilibrium:
            if refine != "h":
                raise InputError(f"refine = {refine!r}", "an equilibrium has no dt", self.source)
            return
        time = self.scene.time
        has_stable_step = time.method.type in EXPLICIT and time.rtol is None
        if refine == "dt" and not self.can_refine("dt"):
            raise InputError('dt = "auto"', "cannot be refined", self.source, "Give time.dt.")
        if refine == "both" and not (has_stable_step or self.can_refine("dt")):
            remedy = "Give time.dt; or refine h: the steps follow their tolerance."
            raise InputError('dt = "auto"', "cannot be refined", self.source, remedy)

    def changed(self, change: Change) -> "SceneProblem":
        """Return the problem with a change; if it is refused, `InputError` names the change."""
        where = self.source
        if change.name:
            where = f"{self.source} with {change.name}"
        with errors_of(where):
            tables = change.apply(self._tables_for(change))
            return replace(self, scene=scene_of(tables, self.scene.trusts_geo))

    def _tables_for(self, change: Change) -> dict:
        """Return the tables to which the change is applied.

        They are the tables of the scene with all defaults. But a term that changes its type has
        only the keys that the user wrote, because all others are defaults of its old type.
        """
        if not self.scene.terms:
            return self.tables
        keys = [key.replace(" ", "") for key in change.values]  # "terms . 0 . type" is allowed
        terms = []
        for i, term in enumerate(self.scene.terms):
            table = self.tables["terms"][i]
            if f"terms.{i}.type" in keys:
                table = {key: table[key] for key in table if key in term.model_fields_set}
            terms.append(table)
        return self.tables | {"terms": terms}

    def refined(self, level: Level) -> "SceneProblem":
        """Return a level of the problem; a refined dt divides the run into equal steps.

        The level divides h, dt, rtol and the tolerance of the solver; its edits change the
        terms. A level that changes nothing is the problem itself.
        """
        scene = self.scene
        values = dict[str, object]()
        if level.h != 1 and self.h is not None:
            values["cloth.h"] = self.h / level.h
        if level.dt != 1 and self.span is not None and self.dt is not None:
            steps = math.ceil(self.span / self.dt - 1e-9)  # 1e-9 against round-off
            values["time.dt"] = self.span / round(steps * level.dt)
        if level.rtol != 1:
            values["time.rtol"] = self.rtol / level.rtol
        if level.sharper is not None and scene.equilibrium:
            # the tolerance "auto" of an equilibrium is as exact as the answer needs
            if scene.equilibrium.tolerance != "auto":
                values["equilibrium.tolerance"] = scene.equilibrium.tolerance / level.sharper
        elif level.sharper is not None:
            # the tolerance "auto" of steps may leave larger errors than levels differ by
            values["solver.tolerance"] = scene.solver.make().residual / level.sharper
        if values or level.edits:
            return self.changed(Change(values=values, edits=level.edits))
        return self

    def graded(self, gradings: Sequence[Grading]) -> "SceneProblem":
        """Return the problem with [[cloth.grading]]; a scene may not have its own already."""
        if self.scene.cloth.grading:
            allowed = "the scene has [[cloth.grading]]"
            remedy = "Leave grade or the gradings out."
            raise InputError("grade = True", allowed, self.source, remedy)
        tables = [table_of_grading(grading) for grading in gradings]
        return self.changed(Change(values={"cloth.grading": tables}))

    def setup(self, cloth: Cloth | None = None) -> Setup:
        """Build the scene, on the cloth if it is given, and compile what its run needs."""
        setup = self._build(cloth)
        if cloth is None:
            compile_kernels(setup)
        return setup

    def _build(self, cloth: Cloth | None = None) -> Setup:
        """Return the setup of the scene, on the cloth if it is given.

        It has no frames of [output], so that no step has to end at the time of a frame.
        """
        built = self.scene.build(cloth)
        return Setup(
            system=built.system,
            start=built.start,
            steps=built.steps,
            t_end=built.t_end,
            newton=built.newton,
            linear=built.linear,
            probes=built.probes,
        )

    def case(self) -> dict[str, object]:
        """Return all that determines a run, as JSON values.

        It is the key of the stored results, and `of_case` makes the problem from it again.
        """
        tables = {key: value for key, value in self.tables.items() if key not in WITHOUT_EFFECT}
        if "fabric" in tables:
            tables["fabric"] = _constants(tables["fabric"])
        if "fabrics" in tables:
            fabrics = tables["fabrics"].items()
            tables["fabrics"] = {name: _constants(fabric) for name, fabric in fabrics}
        return {
            "tables": tables,
            "digest": digest_of_files(self.scene),
            "trust_geo": self.scene.trusts_geo,
        }

    @classmethod
    def of_case(cls, tables: dict, digest: str, trust_geo: bool) -> "SceneProblem":
        """Return the problem of a case, as `case` has written it.

        `digest` is not used here: it is in the case so that an edited file that the scene reads
        makes another case.
        """
        return cls(scene_of(tables, trust_geo), "scene")

    def cloth_for(self, quantity: Quantity) -> Cloth | None:
        """Return the cloth that a field needs; None for other quantities."""
        if quantity.is_field:
            return self.scene.mesh()
        return None


def _constants(fabric: dict) -> dict:
    """Return the table of a fabric without its uncertainty, which changes no result."""
    return {key: value for key, value in fabric.items() if key != "uncertainty"}


def digest_of_files(scene: Scene) -> str:
    """Return a hash of the contents of the files that the scene reads.

    These are the mesh, the start and tables of terms. So an edited file makes another case.
    """
    digest = hashlib.sha256()
    paths = [getattr(scene.cloth, "path", None), scene.start.frame]
    paths += [dict(term).get("path") for term in scene.terms]
    paths += getattr(scene.cloth, "paths", ())
    for path in paths:
        digest.update(Path(path).read_bytes() if path else b"-")  # "-": no file in this place
    return digest.hexdigest()[:12]
