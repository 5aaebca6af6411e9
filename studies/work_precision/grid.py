"""Which cases speed_accuracy.py runs: methods, steps, meshes, elements, models, linear solvers."""

from __future__ import annotations

from pathlib import Path

from fecloth.scene.scene import load

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
STABLE = {"trampoline": 8e-3, "wave": 4e-3, "swing": 1.5e-3, "stretch": 6e-3}  # of dt / h [s/m]
STEPS = {
    "trampoline": (0.02, 0.01, 0.005, 0.0025, 0.00125),
    "wave": (0.01, 0.005, 0.0025, 0.00125, 0.0006),
    "swing": (0.02, 0.01, 0.005, 0.0025),
    "stretch": (0.25, 0.1, 0.05, 0.02),
}
TOLERANCES = dict.fromkeys(MODEL, (0.1, 0.01, 0.001)) | {"wave": (1e-3, 1e-4, 1e-5)}
OTHERS = {  # models beside the scene's own
    "trampoline": ("NeoHookean", "TensorCondition", "BaraffWitkin", "Springs"),
    "swing": ("StVK + quadratic", "StVK", "Springs + hinges"),
    "stretch": ("NeoHookean", "Springs"),
}


def key(row: dict) -> tuple:
    """Scene, model, element and mesh: what a run of fine steps belongs to."""
    return row["scene"], row["model"], row["element"], row["h"]


def case(scene, h, method, step=None, model=None, element="P1", linear="auto") -> dict:
    """The settings of one run."""
    return {
        "scene": scene,
        "model": model or MODEL[scene],
        "element": element,
        "h": h,
        "method": method,
        "step": step,
        "linear": linear,
    }


def explicit_of(scene: str, model: str) -> str:
    """Compiled calls where these know all terms, the loop over time elsewhere."""
    return (
        "many_steps"
        if scene in ("trampoline", "wave") and model == "StVK"
        else ("CentralDifference")
    )


def fine_runs(quick: bool) -> Rows:
    """A run of fine steps for each mesh, element and model; the static solution of the stretch."""
    found = []
    for scene in scenes(quick):
        for model in (MODEL[scene], *(() if quick else OTHERS.get(scene, ()))):
            meshes = meshes_of(scene, quick)
            meshes = meshes if model == MODEL[scene] else meshes[1:3]
            found += [fine(scene, h, model, "P1") for h in meshes]
        if not quick:
            found += [fine(scene, h, MODEL[scene], "P2") for h in QUADRATIC.get(scene, ())]
    return [one | {"repeats": 1} for one in found]


def fine(scene: str, h: float, model: str, element: str) -> dict:
    """The fine run of one mesh."""
    if scene == "stretch":
        return case(scene, h, "equilibrium", None, model, element)
    if element == "P2":
        part = 16 if scene == "wave" else 2
        return case(scene, h, "ImplicitMidpoint", STEPS[scene][-1] / part, model, element)
    part = 0.8 if scene == "swing" else 0.4  # whose steps resolve waves far faster than its fall
    return case(scene, h, explicit_of(scene, model), part * STABLE[scene] * h, model, element)


def scenes(quick: bool) -> tuple[str, ...]:
    return ("trampoline", "wave") if quick else tuple(MODEL)


def meshes_of(scene: str, quick: bool) -> tuple[float, ...]:
    return MESHES[scene][1:3] if quick else MESHES[scene]


def asked(quick: bool) -> Rows:
    """All timed cases."""
    if quick:
        return [c for scene in scenes(True) for c in plain(scene, True)]
    found = []
    for scene in MODEL:
        found += plain(scene, False) + chosen(scene) + solved(scene) + quadratic(scene)
        found += modelled(scene)
    return found + static() + failing()


def plain(scene: str, quick: bool) -> Rows:
    """Every method at every step on the middle meshes, some on the finer ones."""
    meshes, found = meshes_of(scene, quick), []
    methods = IMPLICIT if not quick else ("BackwardEuler", "BDF2", "ImplicitMidpoint")
    steps = STEPS[scene] if not quick else STEPS[scene][-3:]
    for h in meshes if quick else meshes[:3]:
        some = steps[:2] if quick and h < meshes[0] else steps
        found += [case(scene, h, method, dt) for method in methods for dt in some]
    if not quick:
        few = ("BDF2", "GeneralizedAlpha", "ImplicitMidpoint")
        found += [case(scene, meshes[3], method, dt) for method in few for dt in steps[1:3]]
    explicit = explicit_of(scene, MODEL[scene])
    parts = (1.0, 0.5) if quick or explicit == "many_steps" else (1.0,)
    found += [case(scene, h, explicit, part * STABLE[scene] * h) for h in meshes for part in parts]
    if not quick:
        more = {"CentralDifference", "SymplecticEuler"} - {explicit}
        found += [case(scene, h, m, STABLE[scene] * h) for m in sorted(more) for h in meshes[:3]]
    return found


def chosen(scene: str) -> Rows:
    """Methods that choose their steps; rtol is of the extent, far above the wave's amplitude."""
    methods = ("Adaptive CentralDifference", "Adaptive GeneralizedAlpha", "Auto")
    return [
        case(scene, h, method, rtol)
        for method in methods
        for h in MESHES[scene][1:3]
        for rtol in TOLERANCES[scene]
    ]


def solved(scene: str) -> Rows:
    """The linear solvers by name."""
    steps = STEPS[scene][1], STEPS[scene][-1]
    return [
        case(scene, h, "GeneralizedAlpha", dt, linear=linear)
        for linear in ("direct", "pcg")
        for h in MESHES[scene][1:3]
        for dt in steps
    ]


def quadratic(scene: str) -> Rows:
    """Quadratic triangles; on the swing, whose hinges they do not know, to be refused."""
    meshes = QUADRATIC.get(scene, (0.03,))
    methods = ("GeneralizedAlpha", "ImplicitMidpoint") if scene != "stretch" else ("BackwardEuler",)
    return [
        case(scene, h, method, dt, element="P2")
        for method in methods
        for h in meshes[:3]
        for dt in STEPS[scene][1:4]
    ]


def modelled(scene: str) -> Rows:
    """Other models, as the scene's own is marched cheapest at fine steps."""
    method, step = ("equilibrium", None) if scene == "stretch" else ("CentralDifference", True)
    return [
        case(scene, h, method, step and STABLE[scene] * h * 0.7, model)
        for model in OTHERS.get(scene, ())
        for h in MESHES[scene][1:3]
    ]


def static() -> Rows:
    """The equilibrium of the stretch, and its linear solvers."""
    found = [case("stretch", h, "equilibrium") for h in MESHES["stretch"]]
    return found + [
        case("stretch", h, "equilibrium", element="P2") for h in QUADRATIC["stretch"][:4]
    ]


def failing() -> Rows:
    """Steps beyond the limit, by methods that do not look ahead."""
    return [case("trampoline", 0.05, "many_steps", 2e-3), case("wave", 0.05, "many_steps", 6e-4)]


def asked_of(path: Path, quick: bool) -> Rows:
    """A user's scene: its own method at fine steps first, then the others."""
    built = load(path).build()
    span = built.t_end - built.state.t
    dt = built.dt or span / 200
    if built.dt is None:
        found = [{"method": "Adaptive GeneralizedAlpha", "step": 1e-4}]
    else:
        found = [{"method": "own", "step": dt / 16}]
    methods = ("BackwardEuler", "LinearlyImplicitEuler", "BDF2", "ImplicitMidpoint")
    found += [
        {"method": method, "step": dt * factor}
        for method in (*methods, "GeneralizedAlpha", *(("own",) if built.dt else ()))
        for factor in ((2, 1) if quick else (4, 2, 1, 0.5))
    ]
    found += [{"method": "CentralDifference", "step": None}]
    return found + [{"method": "Auto", "step": rtol} for rtol in (0.1, 0.01)]
