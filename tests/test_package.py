"""The package as it is installed: names, types, stubs, and how little an import loads."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

import vffnull as vff

CONTRACT = {
    vff: (
        "simulate",
        "simulate_many",
        "metrics_table",
        "realtime",
        "scenarios",
        "compare",
        "StreamRecorder",
        "Arm",
        "Obstacle",
        "Motion",
        "Field",
        "ControlSettings",
        "Controller",
        "Distances",
        "distances",
        "Simulation",
        "Result",
        "Scenario",
        "Status",
        "VffNullError",
        "__version__",
    ),
    vff.Arm: (
        "uniform",
        "n",
        "forward_kinematics",
        "jacobian",
        "jacobian_dot",
        "mass_matrix",
        "coriolis_matrix",
        "gravity_torque",
        "inverse_dynamics",
        "forward_dynamics",
        "extended_jacobian",
    ),
    vff.ExtendedJacobian: ("Z", "N_M", "J_e", "J_e_inv", "E_e", "mu", "Lambda_x", "Lambda_n"),
    vff.Obstacle: ("circle", "capsule", "box", "polygon"),
    vff.Motion: ("linear", "sinusoid", "waypoints"),
    vff.Field: ("khatib", "cubic", "bounded"),
    vff.Controller: ("torque", "terms"),
    vff.Terms: ("tau", "tau_task", "tau_null", "tau_vff", "force", "clearance", "N"),
    vff.Simulation: ("step", "state", "reset"),
    vff.Scenario: ("load", "from_dict", "to_dict", "save", "replace"),
    vff.RealTimeReport: ("verdict", "held", "plot", "to_dict"),
    vff.Result: ("plot", "animate", "report", "save", "load", "to_pandas", "to_xarray", "to_arrow"),
}


@pytest.mark.parametrize("owner", CONTRACT, ids=lambda owner: getattr(owner, "__name__", "?"))
def test_names_of_the_contract(owner: object) -> None:
    """The public interface: names that other people's scripts call."""
    assert [name for name in CONTRACT[owner] if not hasattr(owner, name)] == []  # type: ignore[index]


def test_the_contracts_own_calls() -> None:
    """The calls that the README and the stubs show, in one go."""
    arm = vff.Arm.uniform(6, length=1.0, mass=1.0)
    lengths, masses = [1.0] * 6, [1.0] * 6
    assert (
        vff.Arm(
            lengths,
            masses,
            com=None,
            inertias=None,
            radius=0.0,
            gravity=0.0,
            joint_limits=None,
            torque_limits=None,
        ).n
        == arm.n
        == 6
    )
    settings = vff.ControlSettings(
        stiffness=16.0,
        damping=8.0,
        null_damping=2.0,
        field=vff.Field.khatib(5.0, 1.2),
        formulation="recursive",
        projection="dynamic",
        avoidance="null_space",
    )
    controller = vff.Controller(arm, settings)
    q, dq = [0.0, 0.25, 0.12, 0.30, 0.20, 0.15], [0.0] * 6
    assert controller.torque(q, dq, [2.8, 1.6], dx_ref=None, ddx_ref=None, obstacles=(), t=0.0).shape == (6,)
    assert controller.terms(q, dq, [2.8, 1.6]).N.shape == (6, 6)
    assert arm.forward_kinematics(q).shape == (7, 2) and arm.jacobian(q).shape == arm.jacobian_dot(
        q, dq
    ).shape == (2, 6)
    assert arm.forward_kinematics([q, q, q]).shape == (3, 7, 2)


def test_every_public_name_is_documented() -> None:
    """Every name in `__all__` exists and has a docstring, and so have its public methods."""
    for name in vff.__all__:
        thing = getattr(vff, name)
        if name == "__version__":
            continue
        assert thing.__doc__, name
    for method in ("save", "load", "plot", "animate", "to_pandas", "to_xarray"):
        assert getattr(vff.Result, method).__doc__


def test_the_installed_package_is_tested() -> None:
    """Not the source tree: what a user gets."""
    assert "site-packages" in vff.__file__
    installed = Path(vff.__file__).parent
    assert (installed / "py.typed").is_file() and (installed / "_core.pyi").is_file()
    assert {path.stem for path in (installed / "scenarios").glob("*.toml")} == set(vff.scenarios())


def test_version() -> None:
    assert importlib.metadata.version("vffnull") == vff.__version__ == vff._core.__version__


def test_stubs_match_the_compiled_module() -> None:
    """mypy's stubtest: every name, signature and property of `_core.pyi` exists as written."""
    command = [sys.executable, "-m", "mypy.stubtest", "vffnull._core"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=170)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]


HEAVY = ("numpy", "bokeh", "matplotlib", "pandas", "xarray", "tqdm", "PIL", "scipy", "mujoco", "pyarrow")


@pytest.mark.parametrize(
    ("code", "heavy", "most"),
    [
        ("import vffnull", (*HEAVY, "click"), 50),
        ("import vffnull.cli; vffnull.cli._commands(['--help'], standalone_mode=False)", HEAVY, 110),
    ],
    ids=["import vffnull", "vffnull --help"],
)
def test_start_is_light(code: str, heavy: tuple[str, ...], most: int) -> None:
    """NumPy, matplotlib and the like are loaded when used, and few modules beside (ARCHITECTURE.md).

    Counted, because times differ between machines. 36 and 67 modules are what it takes; they cost 20 and
    40 ms more than Python alone, where NumPy would cost another 110 ms.
    """
    script = (
        "import sys; before = set(sys.modules)\n"
        f"{code}\n"
        "new = set(sys.modules) - before\n"
        f"print([name for name in {heavy} if name in new], len(new), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    found, count = done.stderr.strip().rsplit(maxsplit=1)
    assert found == "[]" and int(count) <= most, done.stderr


def test_a_run_is_light_too() -> None:
    """A simulation without plots needs NumPy alone."""
    code = (
        "import sys, vffnull; vffnull.simulate('paper-1', {'duration': 0.1}); "
        "print([m for m in ('matplotlib', 'pandas', 'tqdm') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_missing_extra_is_named() -> None:
    """Without pandas the error says which extra brings it."""
    code = (
        "import sys; sys.modules['pandas'] = None; import vffnull\n"
        "try: vffnull.simulate('paper-1', {'duration': 0.1}).to_pandas()\n"
        "except ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "vffnull[io]" in done.stdout, done.stdout + done.stderr


def test_errors_form_one_tree() -> None:
    from vffnull import errors

    leaves = (errors.ScenarioError, errors.InputError, errors.InputTypeError)
    assert all(issubclass(leaf, vff.VffNullError) for leaf in leaves)
    assert issubclass(errors.ScenarioError, ValueError) and issubclass(errors.InputError, ValueError)
    assert issubclass(errors.InputTypeError, TypeError) and issubclass(errors.ScenarioWarning, UserWarning)
