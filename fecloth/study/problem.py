"""What a study runs: a problem, which is a set-up for each choice of numbers and words by name."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.nonlinear.options import Newton
from fecloth.scene.scene import Scene, load_scene
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.probes import Probe
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.setup import Setup
from fecloth.study.function_source import FunctionSource, table_of_grading
from fecloth.study.orders import quantities_of, space_order
from fecloth.study.scene_source import SceneSource
from fecloth.study.work import CHOSEN_STEPS, LOAD_STEP, Work
from fecloth.system.reuse import reusing
from fecloth.terms.traits import has_kind

Asked = str | Callable[..., float] | Quantity
Source = SceneSource | FunctionSource
SOURCES = {source.kind: source for source in (SceneSource, FunctionSource)}


@dataclass(frozen=True, eq=False)
class StudyProblem:
    """A problem of a study: numbers and words by name make a set-up.

    A scene is one, and a user's function of h and dt is one. What they differ in is in their
    `source`; no study asks which of both it is.

    Attributes
    ----------
    source
        Makes the set-up from values: a scene, or a function with its arguments.
    sharper
        Divides the tolerance of the solver in steps of time; None leaves the solver as it is.
        With 1 the tolerance "auto", which may leave larger errors than levels of refinement
        differ by, becomes the number that Newton's iteration has for it.
    root
        The problem that this one was made of, by which its size is estimated without its mesh.
    """

    source: Source
    sharper: float | None = None
    root: "StudyProblem | None" = None

    @classmethod
    def of(
        cls,
        problem: Any,
        h: float | None = None,
        dt: float | None = None,
        t_end: float | None = None,
        probes: Sequence[Probe] = (),
        arguments: Mapping[str, object] | None = None,
    ) -> "StudyProblem":
        """Return the problem of a scene, its path, or a function.

        The other arguments are for a function, see `fecloth.study.of`. Raise `InputError` for
        any of them beside a scene, for an argument that the function does not take, and for what
        is neither a scene nor a function.
        """
        if isinstance(problem, Scene | str | Path):
            named = {"h": h, "dt": dt, "t_end": t_end, "probes": probes or None}
            for name, value in {**named, **(arguments or {})}.items():
                if value is not None:
                    remedy = "Change the scene."
                    what = f"{name} = …"
                    raise InputError(what, "is for a function's problem", "problem", remedy)
            scene = problem if isinstance(problem, Scene) else load_scene(problem)
            file = Path(scene.source.partition(" with ")[0])  # "drape.toml with fabric.density=0.2"
            return cls(SceneSource(scene, name=scene.title or file.stem, where=file.name))
        if not callable(problem):
            allowed = "must be a scene, its path, or a function of h and dt"
            raise InputError(f"problem = {problem!r}", allowed)
        for name, value in (("h", h), ("dt", dt)):
            if value is not None:
                validation.number(name, value, 0.0, "problem")
        source = FunctionSource(problem, t_end=t_end, placed=tuple(probes))
        sizes = {name: size for name, size in (("h", h), ("dt", dt)) if size is not None}
        return cls(source.changed({**(arguments or {}), **sizes}))

    # --- what it is ---------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """Name of the problem."""
        return self.source.name

    @property
    def where(self) -> str:
        """What errors name: the file of a scene, or the function."""
        return self.source.where

    @property
    def tables(self) -> dict:
        """The values as nested tables.

        The tables of a function have only the values that a study reads.
        """
        return self.source.tables

    @property
    def h(self) -> float | None:
        """Edge length [m]; None where there is none to refine."""
        return self.source.h

    @property
    def dt(self) -> float | None:
        """Fixed step [s]; None where there is none."""
        return self.source.dt

    @property
    def rtol(self) -> float:
        """Tolerance of steps that their error chooses [1/s]; 0 if it does not choose them."""
        time = self.tables.get("time")
        if "rtol" not in self.source.keys or time is None or time["dt"] != "auto":
            return 0.0
        if self.source.has_stable_steps:
            return 0.0
        return time.get("rtol", Adaptive.rtol)

    @property
    def span(self) -> float | None:
        """Length of the run [s]; None for an equilibrium."""
        return self.source.span

    @property
    def is_static(self) -> bool:
        """Whether it has no steps in time."""
        return self.span is None

    @cached_property
    def first(self) -> Setup:
        """The set-up, which is made once."""
        return self._make(None)

    @property
    def is_explicit(self) -> bool:
        """Whether its steps solve no equations."""
        return self.source.is_explicit

    @cached_property
    def has_contact(self) -> bool:
        """Whether a term has a gap."""
        return has_kind(self.first.system.terms, "contact")

    @cached_property
    def doubts(self) -> tuple[Doubt, ...]:
        """Likely mistakes in the set-up, as before a run."""
        return tuple(self.first.doubts())

    # --- other values -------------------------------------------------------------------------

    def at(self, values: Mapping[str, Any], name: str = "") -> "StudyProblem":
        """Return the problem with other values by name.

        The names of a scene are its keys, written as for --set; the names of a function are its
        arguments. Both have numbers (from 0) for the items of lists: "terms.0.gap". None removes
        a key of a scene, and a term. Raise `InputError` for values that the problem refuses;
        `name` names the change in its message.
        """
        if not values:
            return self
        return replace(self, source=self.source.changed(values, name), root=self.root or self)

    def completed(self, values: Mapping[str, Any]) -> "StudyProblem":
        """Return the problem with those of the values without which it has no set-up.

        These are values of arguments without a default, which a function was not given.
        """
        values = {name: value for name, value in values.items() if name in self.source.missing}
        return replace(self.at(values), root=None) if values else self

    def choose(self, name: str = "", **choice: Any) -> "StudyProblem":
        """Return the problem with another h, dt, rtol, method, element, pattern, terms or grading.

        What goes with a choice is chosen, too: an explicit method takes its stable step and a
        lumped mass. Raise `InputError` for what the problem does not have, and for values that it
        refuses.
        """
        chosen = self.at(self.source.values_of(choice), name)
        return replace(chosen, root=None) if "method" in choice else chosen

    def finer(
        self,
        h: float = 1.0,
        dt: float = 1.0,
        rtol: float = 1.0,
        gap: float = 1.0,
        sharper: float | None = None,
    ) -> "StudyProblem":
        """Return the problem with sizes and tolerances that are divided by these numbers.

        `sharper` is as for the attribute; None leaves the solver as it is. See `finer_values`.
        """
        finer = self.at(self.finer_values(h, dt, rtol, gap))
        if sharper is not None:
            finer = replace(finer, sharper=sharper, root=self.root or self)
        return finer

    def finer_values(
        self, h: float = 1.0, dt: float = 1.0, rtol: float = 1.0, gap: float = 1.0
    ) -> dict[str, Any]:
        """Return the values by name of sizes and tolerances that are divided by these numbers.

        A fixed step still divides the run into equal steps. What the problem does not have stays
        out.
        """
        values = dict[str, Any]()
        keys = self.source.keys
        if h != 1 and self.h is not None:
            values[keys["h"]] = self.h / h
        if dt != 1 and self.dt is not None and self.span is not None:
            steps = math.ceil(self.span / self.dt - 1e-9)  # 1e-9 against round-off
            values[keys["dt"]] = self.span / max(round(steps * dt), 1)
        if rtol != 1 and self.rtol:
            values[keys["rtol"]] = self.rtol / rtol
        if gap != 1:
            for i, term in enumerate(self.tables.get("terms", ())):
                if "gap" in term:
                    values[f"terms.{i}.gap"] = term["gap"] / gap
        return values

    def interested_in(self, quantities: Sequence[Quantity]) -> "StudyProblem":
        """Return the problem with these quantities as its own, as far as it names its own."""
        texts = [quantity.text for quantity in quantities]
        return replace(self, source=self.source.interested_in(texts))

    def graded(self, gradings: Sequence[Grading]) -> "StudyProblem":
        """Return the problem with smaller triangles at places; it may not have its own already."""
        if self.tables["cloth"].get("grading"):
            remedy = "Leave grade or the gradings out."
            raise InputError("grade = True", "the scene has [[cloth.grading]]", self.where, remedy)
        if "grading" not in self.source.keys:
            remedy = "Pass it on, as in fc.Cloth.rectangle(1.0, 1.0, h, grading=grading)."
            needed = "needs a function with the argument grading"
            raise InputError("grade = True", needed, self.where, remedy)
        return self.choose(grading=[table_of_grading(grading) for grading in gradings])

    def can_refine(self, size: str) -> bool:
        """Whether there is an h, or a fixed dt; `size` is "h" or "dt"."""
        return (self.h if size == "h" else self.dt) is not None

    def check_refining(self, refine: str) -> None:
        """Raise `InputError` if there is no h or dt to refine.

        `refine` is "h", "dt" or "both". Chosen steps can be repeated in halves with "dt". For
        "both" a fixed dt is needed, but for an explicit method with its stable step, which falls
        with h.
        """
        if refine != "dt" and not self.can_refine("h"):
            self.source.refuse_refining("h")
        follows = refine == "both" and not self.is_static and self.source.has_stable_steps
        can_refine = self.can_refine("dt") or follows or (refine == "dt" and self.span is not None)
        if refine != "h" and (self.is_static or not can_refine):
            self.source.refuse_refining("dt")

    def on(self, values: Mapping[str, float], base: Setup) -> Setup:
        """Return the set-up with other values, on the same triangles as `base`.

        A scene is built on the cloth of `base`; a function makes its own cloth. All that does not
        depend on the values is taken from `base`. Raise `InputError` if the values are refused,
        or change the triangles or the held nodes: then the positions of both runs cannot be
        compared node by node.
        """
        parameter = f"parameter {' and '.join(values)}"
        try:
            with reusing(base.system):
                setup = self.source.setup_on(values, base)
        except InputError as error:
            # its own value is allowed, so this one lies beyond an end of what is allowed
            allowed = "needs values on both sides of its own: " + str(error)
            raise InputError(parameter, allowed, "sensitivity") from None
        has_same_mesh = np.array_equal(setup.cloth.triangles, base.cloth.triangles)
        held, held_in_base = setup.system.constraints.nodes, base.system.constraints.nodes
        if not (has_same_mesh and np.array_equal(held, held_in_base)):
            remedy = "Move the nodes of the same triangles, and hold the same nodes."
            raise InputError(parameter, "changes the mesh or the held nodes", "sensitivity", remedy)
        return setup

    # --- set-ups and cases --------------------------------------------------------------------

    def setup(self) -> Setup:
        """Make a set-up, with nothing of an earlier one."""
        return self._make(None)

    def _make(self, cloth: Cloth | None) -> Setup:
        """Return the set-up, on the cloth if it is given, with the solver's tolerance."""
        setup = self.source.setup(cloth)
        if self.sharper is None or setup.is_static:
            return setup
        newton = setup.newton or Newton()
        return replace(setup, newton=replace(newton, tolerance=newton.residual / self.sharper))

    def case(self) -> dict[str, object]:
        """Return all that determines a run, as JSON values: the key of its stored result."""
        return {
            "kind": self.source.kind,
            "source": self.source.case(),
            "sharper": self.sharper,
        }

    @classmethod
    def of_case(cls, kind: str, source: Mapping[str, Any], sharper: float | None) -> "StudyProblem":
        """Return the problem of a case, as `case` has written it."""
        return cls(SOURCES[kind].of_case(**source), sharper)

    @cached_property
    def work(self) -> Work:
        """The estimated size of a run, without its mesh where its root tells enough."""
        root = self.root or self
        source: Any = self.source
        if root is not self and source.has_shape_of(root.source):
            triangles = root.work.triangles
            if root.h and self.h:
                triangles *= (root.h / self.h) ** 2
        else:
            triangles = self.source.count_triangles()
        # the method of a function is known only from a set-up
        known = self.source if self.source.tells_method else root.source
        if self.is_static:
            load_steps = known.tables["equilibrium"].get("load_steps", 1)
            return Work(triangles, LOAD_STEP * load_steps, "static")
        assert self.span is not None
        steps = float(CHOSEN_STEPS)
        if self.dt is not None:
            steps = math.ceil(self.span / self.dt - 1e-9)
        elif known.has_stable_steps:
            steps = known.count_stable_steps(triangles)
        kind = "implicit"
        if known.is_explicit:
            kind = "explicit"
        elif any("gap" in term for term in known.tables.get("terms", ())):
            kind = "with contact"
        return Work(triangles, steps, kind)

    # --- quantities ---------------------------------------------------------------------------

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The quantities that are studied if none is asked for.

        They are the quantities of [interest]; else paths or ends of the probes, or displacement.
        """
        return self.source.interest or quantities_of(self.source.probes, self.is_static)

    def orders(self, quantity: Quantity) -> tuple[float, float]:
        """Return the theoretical orders in h and in dt."""
        time_order = 1.0
        if not self.is_static:
            time_order = float(self.first.steps.traits.order or 1)
        return space_order(quantity, self.first), time_order

    def choose_quantities(self, asked: Asked | Sequence[Asked] | None) -> tuple[Quantity, ...]:
        """Return the quantities that are asked for, or the problem's own if `asked` is None.

        Raise `InputError` for a quantity that the run does not have, and for natural frequencies
        beside other quantities of a run in time.
        """
        quantities_to_read: Any = asked
        if asked is None:
            quantities_to_read = self.quantities
        elif isinstance(asked, str) or not isinstance(asked, Sequence):
            quantities_to_read = [asked]
        quantities = tuple(map(parse_quantity, quantities_to_read))
        for quantity in quantities:
            self.check_quantity(quantity)
        are_modes = {quantity.how == "mode" for quantity in quantities}
        # modes of a problem in time are modes about its start, for which nothing runs
        if len(are_modes) > 1 and not self.is_static:
            allowed = "needs a study of its own: a scene in time is not run for its modes"
            raise InputError("frequency(k) beside other quantities", allowed, self.where)
        return quantities

    def choose_quantity(self, asked: Asked | None) -> Quantity:
        """Return the quantity that is asked for, or the first of the problem's own."""
        if asked is None:
            return self.choose_quantities(self.quantities[:1])[0]
        return self.choose_quantities(asked)[0]

    def check_quantity(self, quantity: Quantity) -> None:
        """Raise `InputError` for a quantity that the run does not have."""
        names = self.first.recording([quantity.column]).row().keys()
        quantity.require_known(sorted(names - {"t"}))

    def cloth_for(self, quantity: Quantity) -> Cloth | None:
        """Return the cloth that a field needs; None for other quantities."""
        if quantity.is_field:
            return self.source.cloth
        return None


def refuse_methods(problem: StudyProblem, methods: Sequence[str] | None, study: str) -> None:
    """Raise `InputError` for methods of an equilibrium."""
    if methods and problem.is_static:
        allowed = "an equilibrium has no method"
        raise InputError(f"methods = {methods!r}", allowed, study, "Leave the methods out.")
