"""Amplification of a damped oscillator by one step of a method, computed from that step."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, floats
from fecloth.fabric.fabric import Fabric
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.integrators.protocol import is_method
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.direct import SuperLU
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms import Tether


def amplification(method, omega_dt, zeta=0.0) -> np.ndarray | float:
    """Return the spectral radius of one step on the oscillator x'' + 2ζω x' + ω² x = 0.

    Above 1 the motion grows. In the long run, each step multiplies its energy by the square of
    the radius.

    The method's own `step` gives the columns of its matrix. For this a `Tether` with damping
    draws the nodes of a single triangle to the origin: nine uncoupled oscillators. Each starts
    from another unit vector of x, dt v and the memory of the method. The error is about 1e-12,
    and about 1e-6 where two eigenvalues are equal, as at ζ = 1.

    Parameters
    ----------
    method
        A method, its class, or its name.
    omega_dt, zeta
        ω dt > 0 and ζ ≥ 0: numbers or arrays, which are broadcast.

    Returns
    -------
    float or numpy.ndarray
        The radius, of the shape of the arguments.

    Raises
    ------
    InputError
        For what is no method of one step size, ω dt <= 0, ζ < 0, shapes that do not go together,
        or a method that remembers more than seven arrays.
    """
    method = resolve_method(method)
    omega_dt = _check_numbers("omega_dt", omega_dt, positive=True)
    zeta = _check_numbers("zeta", zeta, positive=False)
    try:
        omega_dt, zeta = np.broadcast_arrays(omega_dt, zeta)
    except ValueError:
        what = f"omega_dt of shape {omega_dt.shape}, zeta of shape {zeta.shape}"
        raise InputError(what, "must go together (broadcast)", "amplification") from None
    radius = np.empty(omega_dt.shape)
    for at in np.ndindex(radius.shape):
        radius[at] = abs(np.linalg.eigvals(step_matrix(method, omega_dt[at], zeta[at]))).max()
    if radius.ndim == 0:
        return float(radius)
    return radius


def step_matrix(method, omega_dt: float, zeta: float) -> np.ndarray:
    """The matrix that takes (x, v, memory) before a step of dt = 1 to (x, v, memory) after it.

    It is (size, size), with size = 2 + the number of arrays in the memory. The memory is every
    array (n, 3) that a step hands on to the next one, in a fixed order; of each array one
    component counts. For a method that takes the memory as a first guess only, its columns are
    zero. `omega_dt` is ω dt and `zeta` is ζ. Raises `InputError` for a memory of more than seven
    arrays.
    """
    system = _oscillators(omega_dt, zeta)
    linear = SuperLU(system.symmetric and method.traits.symmetric)
    J = BlockMatrix.zeros(system.pattern, system.team)
    solver = SolverContext(linear, J, Newton(tolerance=1e-13))
    start = State(0.0, *np.zeros((2, 3, 3)))
    memory = method.step(system, start, 1.0, solver, None).memory
    size = 2 + len(_arrays(memory))
    if size > start.x.size:  # there are nine oscillators, one for each column
        raise InputError(f"method = {method!r}", "remembers too many arrays", "amplification")
    units = np.eye(size, start.x.size).reshape(size, 3, 3)  # oscillator i starts from unit i
    start = State(0.0, units[0], units[1])
    step = method.step(system, start, 1.0, solver, _with_arrays(memory, iter(units[2:])))
    after = [step.state.x, step.state.v, *_arrays(step.memory)]
    return np.array([y.ravel()[:size] for y in after])


def resolve_method(method):
    """Return a method object from a method, its class or its name in a scene.

    Raises `InputError` for anything else, and for a choice of steps.
    """
    methods = {**METHODS, **EXPLICIT}
    if isinstance(method, str):
        validation.known(f"method = {method!r}", method, methods, "stability")
        method = methods[method]
    given = method
    if isinstance(method, type):
        method = method()
    if not is_method(method):
        allowed = "must be a method of one step size such as BDF2(), its class or its name"
        raise InputError(f"method = {given!r}", allowed, "stability")
    return method


def _check_numbers(name: str, value, positive: bool) -> np.ndarray:
    """Return the values as an array of floats.

    Raises `InputError` unless all are finite and > 0 if `positive`, otherwise >= 0.
    """
    value = floats(name, value, "amplification")
    if positive:
        sign = "> 0"
        is_allowed = np.isfinite(value) & (value > 0)
    else:
        sign = ">= 0"
        is_allowed = np.isfinite(value) & (value >= 0)
    if not is_allowed.all():
        wrong = value[~is_allowed].flat[0]
        raise InputError(f"{name} = {wrong:g}", f"must be finite and {sign}", "amplification")
    return value


def _oscillators(omega: float, zeta: float) -> System:
    """Three nodes of 1 kg on springs of no length to the origin, each with ω [1/s] and ζ."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cloth = Cloth.from_arrays(corners, np.array([[0, 1, 2]]))
    fabric = Fabric(areal_density=3 / cloth.area, tensile_stiffness=1.0)
    spring = Tether([0, 1, 2], (0.0, 0.0, 0.0), float(omega**2), float(2 * zeta * omega))
    return System(cloth, fabric, [spring])


def _arrays(record) -> list[np.ndarray]:
    """All arrays in a record and in the records that it contains, in order."""
    if isinstance(record, np.ndarray):
        return [record]
    if not is_dataclass(record):
        return []
    return [a for field in fields(record) for a in _arrays(getattr(record, field.name))]


def _with_arrays(record, arrays: Iterator[np.ndarray]):
    """Return the record with its arrays replaced by the next `arrays`, in the order of `_arrays`.

    Records inside it are replaced, too; anything else stays.
    """
    if isinstance(record, np.ndarray):
        return next(arrays)
    if not is_dataclass(record) or isinstance(record, type):
        return record
    changed = {
        field.name: _with_arrays(getattr(record, field.name), arrays) for field in fields(record)
    }
    return replace(record, **changed)
