"""What a user changes so that a run takes shorter steps."""

from fecloth.integrators.protocol import StepChoice
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.stability_limited import StabilityLimited


def name_shorter_steps(steps: StepChoice) -> str:
    """Return what makes the steps of a run shorter, as "a smaller dt", for a remedy.

    Whoever has given a tolerance has no dt in their hands.
    """
    if isinstance(steps, Adaptive):
        return f"a smaller {'rtol' if steps.rtol else 'atol'}"
    if isinstance(steps, StabilityLimited):
        return "a dt below the largest stable one"
    if isinstance(steps, LoadSteps):
        return "more load_steps"
    return "a smaller dt"


def key_of_step(steps: StepChoice) -> str:
    """Return what bounds the steps of a run: "longest" where their error chooses them, or "dt"."""
    return "longest" if isinstance(steps, Adaptive) else "dt"
