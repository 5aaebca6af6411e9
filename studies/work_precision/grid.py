"""Cases of the work-precision study: methods, steps, meshes, elements, models and solvers."""

from __future__ import annotations

Rows = list[dict]
IMPLICIT = (
    "BackwardEuler",
    "LinearlyImplicitEuler",
    "BDF2",
    "ImplicitMidpoint",
    "GeneralizedAlpha",
    "Newmark",
    "EnergyMomentum",
)
MODEL = {"trampoline": "StVK", "wave": "StVK", "swing": "StVK + hinges", "stretch": "StVK"}
MESHES = {
    "trampoline": (0.1, 0.05, 0.025, 0.0152, 0.0076),
    "wave": (0.1, 0.05, 0.025, 0.0125),
    "swing": (0.03, 0.02, 0.01, 0.005),
    "stretch": (0.1, 0.05, 0.025, 0.0125),
}
QUADRATIC = {
    "trampoline": (0.2, 0.1, 0.05),
    "wave": (0.25, 0.125, 0.0625),
    "stretch": (0.1, 0.05, 0.025, 0.0125, 0.00625),
}
STABLE = {"trampoline": 8e-3, "wave": 4e-3, "swing": 1.5e-3, "stretch": 6e-3}  # stable dt / h [s/m]
STEPS = {
    "trampoline": (0.02, 0.01, 0.005, 0.0025, 0.00125),
    "wave": (0.01, 0.005, 0.0025, 0.00125, 0.0006),
    "swing": (0.02, 0.01, 0.005, 0.0025),
    "stretch": (0.25, 0.1, 0.05, 0.02),
}
TOLERANCES = dict.fromkeys(MODEL, (0.1, 0.01, 0.001)) | {"wave": (1e-3, 1e-4, 1e-5)}
OTHERS = {  # models in addition to the scene's
    "trampoline": ("NeoHookean", "TensorCondition", "BaraffWitkin", "Springs"),
    "swing": ("StVK + quadratic", "StVK", "Springs + hinges"),
    "stretch": ("NeoHookean", "Springs"),
}


def key(row: dict) -> tuple:
    """Return scene, model, element and mesh, which identify a run with fine steps."""
    return row["scene"], row["model"], row["element"], row["h"]


def case(scene, h, method, step=None, model=None, element="P1", linear="auto") -> dict:
    """Return the settings of one run."""
    return {
        "scene": scene,
        "model": model or MODEL[scene],
        "element": element,
        "h": h,
        "method": method,
        "step": step,
        "linear": linear,
    }


def explicit_method(scene: str, model: str) -> str:
    """Return the fused explicit method if it supports all terms, otherwise the plain one."""
    return (
        "many_steps"
        if scene in ("trampoline", "wave") and model == "StVK"
        else ("CentralDifference")
    )


def fine_runs(quick: bool) -> Rows:
    """List a run with fine steps for each mesh, element and model."""
    cases = []
    for scene in scenes(quick):
        for model in (MODEL[scene], *(() if quick else OTHERS.get(scene, ()))):
            meshes = meshes_of(scene, quick)
            meshes = meshes if model == MODEL[scene] else meshes[1:3]
            cases += [fine_run(scene, h, model, "P1") for h in meshes]
        if not quick:
            cases += [fine_run(scene, h, MODEL[scene], "P2") for h in QUADRATIC.get(scene, ())]
    return [one | {"repeats": 1} for one in cases]


def fine_run(scene: str, h: float, model: str, element: str) -> dict:
    """Return the run with fine steps on one mesh."""
    if scene == "stretch":
        return case(scene, h, "equilibrium", None, model, element)
    if element == "P2":
        part = 16 if scene == "wave" else 2
        return case(scene, h, "ImplicitMidpoint", STEPS[scene][-1] / part, model, element)
    part = 0.8 if scene == "swing" else 0.4  # its steps resolve waves much faster than the fall
    return case(scene, h, explicit_method(scene, model), part * STABLE[scene] * h, model, element)


def scenes(quick: bool) -> tuple[str, ...]:
    return ("trampoline", "wave") if quick else tuple(MODEL)


def meshes_of(scene: str, quick: bool) -> tuple[float, ...]:
    return MESHES[scene][1:3] if quick else MESHES[scene]


def timed_cases(quick: bool) -> Rows:
    """List all timed cases."""
    if quick:
        return [c | {"repeats": 2} for scene in scenes(True) for c in basic_cases(scene, True)]
    cases = []
    for scene in MODEL:
        cases += (
            basic_cases(scene, False)
            + adaptive_cases(scene)
            + solver_cases(scene)
            + quadratic_cases(scene)
        )
        cases += model_cases(scene)
    return cases + static_cases() + failing_cases()


def basic_cases(scene: str, quick: bool) -> Rows:
    """List every method at every step on the middle meshes, some on finer meshes."""
    meshes, cases = meshes_of(scene, quick), []
    methods = IMPLICIT if not quick else ("BackwardEuler", "BDF2", "ImplicitMidpoint")
    steps = STEPS[scene] if not quick else STEPS[scene][-3:]
    for h in meshes[: 1 if quick else 3]:
        cases += [case(scene, h, method, dt) for method in methods for dt in steps]
    if not quick:
        few = ("BDF2", "GeneralizedAlpha", "ImplicitMidpoint")
        cases += [case(scene, meshes[3], method, dt) for method in few for dt in steps[1:3]]
    explicit = explicit_method(scene, MODEL[scene])
    parts = (1.0, 0.5) if quick or explicit == "many_steps" else (1.0,)
    cases += [case(scene, h, explicit, part * STABLE[scene] * h) for h in meshes for part in parts]
    if not quick:
        more = {"CentralDifference", "SymplecticEuler"} - {explicit}
        cases += [case(scene, h, m, STABLE[scene] * h) for m in sorted(more) for h in meshes[:3]]
    return cases


def adaptive_cases(scene: str) -> Rows:
    """List methods that choose their steps; rtol is relative to the size of the cloth."""
    methods = ("Adaptive CentralDifference", "Adaptive GeneralizedAlpha", "Auto")
    return [
        case(scene, h, method, rtol)
        for method in methods
        for h in MESHES[scene][1:3]
        for rtol in TOLERANCES[scene]
    ]


def solver_cases(scene: str) -> Rows:
    """List runs with each linear solver."""
    steps = STEPS[scene][1], STEPS[scene][-1]
    return [
        case(scene, h, "GeneralizedAlpha", dt, linear=linear)
        for linear in ("direct", "pcg")
        for h in MESHES[scene][1:3]
        for dt in steps
    ]


def quadratic_cases(scene: str) -> Rows:
    """List runs with quadratic triangles; the swing refuses them because of its hinges."""
    meshes = QUADRATIC.get(scene, (0.03,))
    methods = ("GeneralizedAlpha", "ImplicitMidpoint") if scene != "stretch" else ("BackwardEuler",)
    return [
        case(scene, h, method, dt, element="P2")
        for method in methods
        for h in meshes[:3]
        for dt in STEPS[scene][1:4]
    ]


def model_cases(scene: str) -> Rows:
    """List runs of other models with fine steps."""
    method, step = ("equilibrium", None) if scene == "stretch" else ("CentralDifference", True)
    return [
        case(scene, h, method, step and STABLE[scene] * h * 0.7, model)
        for model in OTHERS.get(scene, ())
        for h in MESHES[scene][1:3]
    ]


def static_cases() -> Rows:
    """List equilibria of the stretch on all meshes."""
    cases = [case("stretch", h, "equilibrium") for h in MESHES["stretch"]]
    return cases + [
        case("stretch", h, "equilibrium", element="P2") for h in QUADRATIC["stretch"][:4]
    ]


def failing_cases() -> Rows:
    """List explicit runs with steps beyond the stability limit."""
    return [case("trampoline", 0.05, "many_steps", 2e-3), case("wave", 0.05, "many_steps", 6e-4)]
