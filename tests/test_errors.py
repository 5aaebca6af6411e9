"""Messages and attributes of the exceptions."""

import pickle

import pytest

import fecloth as fc
from fecloth.errors import closest


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("h = 0 m",), "h = 0 m"),
        (("h = 0 m", "must be > 0"), "h = 0 m: must be > 0"),
        (("h = 0 m", "must be > 0", "a.toml, cloth.h"), "a.toml, cloth.h: h = 0 m: must be > 0"),
        (("h = 0 m", "", "disk"), "disk: h = 0 m"),
        (("h = 0 m", "", "", "Give h."), "h = 0 m. Give h."),
        (
            ("h = 0 m", "must be > 0", "disk", "Give h."),
            "disk: h = 0 m: must be > 0. Give h.",
        ),
    ],
)
@pytest.mark.parametrize("kind", [fc.InputError, fc.MeshError, fc.SceneError])
def test_input_error_message_has_value_limit_place_and_remedy(kind, arguments, text):
    error = kind(*arguments)
    assert str(error) == text


@pytest.mark.parametrize("kind", [fc.SolveFailed, fc.IndefiniteMatrix])
def test_solve_failed_states_its_residual(kind):
    error = kind("CG stopped after 30 iterations", 2.5e-3, 1e-6)
    assert str(error) == (
        "CG stopped after 30 iterations (relative residual 2.50e-03, required 1.00e-06)"
    )
    assert str(kind("not positive definite")) == "not positive definite"  # no residual, no "nan"


def failed(**change):
    known = {"step": 12, "t": 0.11, "dt": 0.01, "residual": 3.4e-2, "stretch": 0.031}
    known |= {"triangle": 77, "state": "the last good one", "remedy": "Take a smaller dt."}
    return fc.StepFailed("Newton did not converge", **(known | change))


def test_step_failed_states_step_residual_and_stretch():
    assert str(failed()) == (
        "step 12 from t = 0.11 s with dt = 0.01 s failed: Newton did not converge "
        "(relative residual 3.40e-02; most deformed triangle 77 with a principal stretch of "
        "0.031). Take a smaller dt."
    )
    known = {"reason": "Newton did not converge", "state": "the last good one", "triangle": 77}
    assert known.items() <= vars(failed()).items()


def test_step_failed_of_a_static_scene_has_parts_of_the_loads():
    message = str(failed(t=0.5, dt=0.25, unit=" of the loads"))
    assert message.startswith("load step 12, from 0.5 to 0.75 of the loads, failed: Newton did not")


def test_step_failed_without_residual_does_not_mention_it():
    message = str(failed(residual=float("nan")))
    assert "residual" not in message
    assert "(most deformed triangle 77" in message
    assert str(fc.StepFailed("no step was taken")) == "no step was taken"


@pytest.mark.parametrize(
    "error",
    [
        fc.MeshError("h = 0 m", "must be > 0", "disk", "Give h."),
        fc.IndefiniteMatrix("not positive definite", 0.5, 1e-6),
        failed(),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_can_be_pickled(error):
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)


def test_a_wrong_name_of_the_package_suggests_the_right_one():
    for wrong, right in {"Stvk": "StVK", "cloth": "Cloth", "HingeBend": "HingeBending"}.items():
        with pytest.raises(AttributeError, match=f"no attribute '{wrong}'. Did you mean '{right}'"):
            getattr(fc, wrong)
    with pytest.raises(AttributeError, match="no attribute 'qqqq'\\.$"):
        fc.qqqq  # noqa: B018
    assert not hasattr(fc, "__wrapped__")


def test_the_nearest_name_of_all_is_suggested_not_the_longest_beginning():
    assert closest("tipp.z", ["tip", "tip.x", "tip.z"]) == "tip.z"
    assert closest("cosine", ["sin", "cos", "cosh"]) == "cos"
    with pytest.raises(AttributeError, match="Did you mean 'run'"):
        _ = fc.simulate
