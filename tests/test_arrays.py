"""Arrays as arguments: however their numbers lie in memory, the result is that of the plain array."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from vffnull import _core
from vffnull.errors import InputError, InputTypeError, ScenarioError

Floats = NDArray[np.float64]

N = 4
SCENE: dict[str, Any] = {
    "duration": 1.0,
    "q0": [0.3, 0.4, -0.5, 0.2],
    "arm": {"lengths": [1.0] * N, "masses": 1.0, "gravity": 9.81},
    "reference": {"kind": "setpoint", "point": [2.0, 1.0]},
}
ARM = vff.Arm.uniform(N, gravity=9.81)
Q, DQ, A = (
    np.array([0.3, 0.4, -0.5, 0.25]),
    np.array([0.5, -0.25, 1.0, 0.75]),
    np.array([1.0, 2.0, -1.0, 0.5]),
)
X = np.array([2.0, 1.5])
ROWS = np.stack([Q, DQ, A])
DISC = {"shape": {"kind": "circle", "radius": 0.5}, "position": [2.5, 1.0]}


def _controller(name: str) -> Callable[[Any], Floats]:
    given: dict[str, Any] = {"q": Q, "dq": DQ, "x_ref": X, "dx_ref": X, "ddx_ref": X}
    return lambda value: vff.Controller(ARM).torque(**(given | {name: value}), obstacles=[DISC])


def _episodes(actions: Any) -> Floats:
    observations = _core.Episodes(SCENE, {}, 3, 1, 0).step(actions)[0]
    return np.asarray(observations)


# Every argument that is an array of numbers, with a plain value of it.
ARGUMENTS: dict[str, tuple[Callable[[Any], Any], Floats]] = {
    "forward_kinematics": (ARM.forward_kinematics, Q),
    "forward_kinematics of rows": (ARM.forward_kinematics, ROWS),
    "jacobian": (ARM.jacobian, Q),
    "jacobian_dot": (lambda v: ARM.jacobian_dot(Q, v), DQ),
    "mass_matrix": (ARM.mass_matrix, Q),
    "coriolis_matrix": (lambda v: ARM.coriolis_matrix(Q, v), DQ),
    "gravity_torque": (ARM.gravity_torque, Q),
    "inverse_dynamics": (lambda v: ARM.inverse_dynamics(Q, DQ, v), A),
    "forward_dynamics": (lambda v: ARM.forward_dynamics(Q, DQ, v), A),
    "kinetic_energy": (lambda v: ARM.kinetic_energy(Q, v), DQ),
    "potential_energy": (ARM.potential_energy, Q),
    "extended_jacobian": (lambda v: ARM.extended_jacobian(v, DQ).mu, Q),
    "torque q": (_controller("q"), Q),
    "torque dq": (_controller("dq"), DQ),
    "torque x_ref": (_controller("x_ref"), X),
    "torque dx_ref": (_controller("dx_ref"), X),
    "torque ddx_ref": (_controller("ddx_ref"), X),
    "terms": (lambda v: vff.Controller(ARM).terms(v, DQ, X).tau_task, Q),
    "stable_period": (lambda v: np.array(vff.Controller(ARM).stable_period(v, [DISC])), Q),
    "distances q": (lambda v: vff.distances(ARM, v, DQ, [DISC]).gradient, Q),
    "distances dq": (lambda v: vff.distances(ARM, Q, v, [DISC]).rate, DQ),
    "distances of rows": (lambda v: vff.distances(ARM, v, ROWS, [DISC]).bias, ROWS),
    "distances t": (lambda v: vff.distances(ARM, ROWS, ROWS, [DISC], v).distance, np.array([0.0, 1.0, 2.0])),
    "Simulation.step": (lambda v: vff.Simulation(SCENE).step(v).q, A),
    "Episodes.step": (_episodes, 0.1 * ROWS),
    "Arm lengths": (lambda v: vff.Arm(v, 1.0).forward_kinematics(Q), np.array([1.0, 0.5, 0.75, 2.0])),
    "Arm com": (
        lambda v: vff.Arm([1.0] * 3, 1.0, v).com,
        np.array([[0.5, 0.25], [0.25, 0.0], [0.125, -0.5]]),
    ),
}


def _unaligned(value: Floats) -> Floats:
    """A field of a packed record: strides of 9 bytes, from an odd address."""
    packed = np.zeros(value.shape, np.dtype([("odd", "u1"), ("value", "f8")]))
    packed["value"] = value
    field = packed["value"]
    assert not field.flags.aligned and field.strides[-1] == 9
    return field


def _shifted(value: Floats) -> Floats:
    """In one piece, but from an odd address."""
    room = np.zeros(value.nbytes + 1, np.uint8)[1:].view(np.float64).reshape(value.shape)
    room[...] = value
    return room


def _strided(value: Floats) -> Floats:
    wide = np.full((*value.shape[:-1], 3 * value.shape[-1]), np.nan)
    wide[..., ::3] = value
    return wide[..., ::3]


def _read_only(value: Floats) -> Floats:
    copy = value.copy()
    copy.flags.writeable = False
    return copy


LAYOUTS: dict[str, Callable[[Floats], Any]] = {
    "unaligned": _unaligned,
    "shifted": _shifted,
    "strided": _strided,
    "reversed": lambda value: np.ascontiguousarray(value[..., ::-1])[..., ::-1],
    "column by column": np.asfortranarray,
    "big-endian": lambda value: value.astype(">f8"),
    "float32": lambda value: value.astype(np.float32),
    "read-only": _read_only,
    "objects": lambda value: value.astype(object),
    "list": lambda value: value.tolist(),
    "tuple": lambda value: tuple(value.tolist()),
    "decimals": lambda value: np.vectorize(lambda x: Decimal(float(x)), otypes=[object])(value),
    "matrix": lambda value: value.view(type("Mine", (np.ndarray,), {})),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("argument", ARGUMENTS)
def test_layouts(argument: str, layout: str) -> None:
    """Bit for bit the result of the plain array."""
    call, value = ARGUMENTS[argument]
    if argument.startswith("Arm") and layout in ("objects", "decimals"):
        pytest.skip("a document, which has numbers of its own")
    given = LAYOUTS[layout](value)
    # What float32 does not hold is another number.
    plain = np.asarray(given, dtype=float).copy() if layout == "float32" else value
    np.testing.assert_array_equal(np.asarray(call(given)), np.asarray(call(plain)))


def _masked(value: Floats) -> Any:
    return np.ma.masked_array(value, mask=np.arange(value.size).reshape(value.shape) == 1)


REFUSED: dict[str, Callable[[Floats], Any]] = {
    "complex": lambda value: value + 1j,
    "a list with a complex number": lambda value: [1j, *value.tolist()[1:]],
    "dates": lambda value: np.full(value.shape, np.datetime64("2020-01-01")),
    "days": lambda value: np.full(value.shape, date(2020, 1, 1), dtype=object),
    "durations": lambda value: np.full(value.shape, np.timedelta64(3, "s")),
    "masked": _masked,
    "set": lambda value: set(value.ravel().tolist()),
    "text": lambda value: np.full(value.shape, "1.5"),
    "list of text": lambda value: np.full(value.shape, "1.5").tolist(),
    "record": lambda value: np.zeros(value.shape, np.dtype([("a", "f8")])),
    "nothing": lambda value: None,
    "dict": lambda value: dict(enumerate(value.ravel().tolist())),
}


@pytest.mark.parametrize("kind", REFUSED)
@pytest.mark.parametrize("argument", [name for name in ARGUMENTS if not name.startswith("Arm")])
def test_what_is_no_array_of_numbers_is_refused(argument: str, kind: str) -> None:
    """By an error that names the argument, never by taking a part of it. None is a default in places."""
    call, value = ARGUMENTS[argument]
    optional = kind == "nothing" and argument.split()[-1] in ("dx_ref", "ddx_ref", "t", "Simulation.step")
    if optional:
        call(None)
        return
    with pytest.raises(
        (InputTypeError, InputError), match=r"^(q|dq|ddq|tau|t|x_ref|dx_ref|ddx_ref|action)\b"
    ):
        call(REFUSED[kind](value))


def test_exceptions_of_values_pass() -> None:
    """What a value raises while it is read is the caller's, unless it says that it is no number."""

    class MineError(Exception):
        pass

    class Rude:
        def __float__(self) -> float:
            raise MineError

        def __array__(self, *_: object, **__: object) -> Floats:
            raise MineError

        def __index__(self) -> int:
            raise MineError

    for call in (
        lambda: ARM.jacobian(Rude()),  # type: ignore[arg-type]
        lambda: ARM.jacobian([Rude()] * N),  # type: ignore[list-item]
        lambda: vff.Arm.uniform(Rude()),  # type: ignore[arg-type]
        lambda: vff.Arm.uniform(3, Rude()),  # type: ignore[arg-type]
        lambda: vff.Controller(ARM).torque(Q, DQ, X, t=Rude()),  # type: ignore[arg-type]
    ):
        with pytest.raises(MineError):
            call()


@pytest.mark.parametrize("digits", [20, 100, 5000])
def test_huge_whole_numbers_are_named(digits: int) -> None:
    """By their digits, or where these are too many to be written, by their bits."""
    huge = 10**digits
    expected = str(huge) if digits < 70 else "bits"
    with pytest.raises(InputError, match=f"duration: .*{expected}.* does not fit into 64 bits"):
        _core.check("scenario", SCENE | {"duration": huge})
    with pytest.raises(InputError, match=r"n: .* does not fit into 64 bits"):
        vff.Arm.uniform(huge)


def test_half_a_character_is_refused() -> None:
    """A lone surrogate, in a key or in a value."""
    for document in (SCENE | {"name": "a\udc80"}, SCENE | {"a\udc80": 1}):
        with pytest.raises(InputError, match="half a character"):
            _core.check("scenario", document)
    with pytest.raises(InputError, match="half a character"):
        _core.parse_toml("name = '\udc80'", "x")


def test_messages_cut_what_they_quote() -> None:
    """A key or a value of 10⁶ characters is not a message."""
    long = "x" * 10**6
    for document in (
        SCENE | {long: 1},
        SCENE | {"reference": {"kind": long}},
        SCENE | {"name": {long: {long: object()}}},
        SCENE | {"duration": long},
        SCENE | {"q0": [1e300] * 10**5},
        SCENE | {"q0": [0.1] * 10**5 + [float("nan")]},
    ):
        with pytest.raises(Exception) as error:
            _core.check("scenario", document)
        assert len(str(error.value)) < 2000, str(error.value)[:300]


def test_seeds_threads_and_counts_out_of_range() -> None:
    """Are said to be, by an error of ours."""
    for seed, count, threads in ((-1, 2, 1), (2**64, 2, 1), (0, -1, 1), (0, 2, -3), (0, 0, 1), (0, 2, 0)):
        with pytest.raises(InputError):
            _core.Episodes(SCENE, {}, count, threads, seed)
    episodes = _core.Episodes(SCENE, {}, 2, 1, 0)
    with pytest.raises(InputError, match=r"seeds\[1\]"):
        episodes.reset([1, -1])


def test_episodes_take_every_form_of_a_scenario(tmp_path: Path) -> None:
    """A bundled name, a path, a document and a Scenario begin the same episodes."""
    scenario = vff.Scenario.load("sweep-through")
    path = tmp_path / "mine.toml"
    scenario.save(path)
    first, *others = (
        _core.Episodes(given, {}, 2, 1, 0).reset([1, 2])[0]
        for given in ("sweep-through", path, str(path), scenario, scenario.to_dict())
    )
    assert first.shape[0] == 2 and all(np.array_equal(first, each) for each in others)
    with pytest.raises(ScenarioError, match="sweep-through"):
        _core.Episodes("sweep-trough", {}, 2, 1, 0)


def test_extremes_are_told() -> None:
    """A torque that is not finite is marked, raises on request, and spoils nothing that comes later."""
    settings = {"tank": {"capacity": 5.0}, "damping": 8.0}
    controller, fresh = vff.Controller(ARM, settings), vff.Controller(ARM, settings)
    for dq, x_ref in ((np.full(N, 1e154), X), (DQ, [1e308, -1e308])):
        terms = controller.terms(Q, dq, x_ref)
        assert not terms.finite and "not finite" in repr(terms)
        with pytest.raises(InputError, match="not finite"):
            vff.Controller(ARM, settings, strict=True).torque(Q, dq, x_ref)
    np.testing.assert_array_equal(controller.torque(Q, DQ, X), fresh.torque(Q, DQ, X))
    assert fresh.terms(Q, DQ, X).finite


def test_reprs_say_what_things_are() -> None:
    """Nothing shows itself as an address."""
    simulation = vff.Simulation("sweep-through")
    shown = [
        vff.Controller(ARM),
        vff.Controller(ARM).terms(Q, DQ, X),
        vff.distances(ARM, ROWS, ROWS, [DISC]),
        simulation,
        simulation.state,
        ARM,
    ]
    for thing in shown:
        assert "0x" not in repr(thing) and any(c.isdigit() for c in repr(thing)), repr(thing)


@pytest.mark.parametrize(
    "call", ["mass", "coriolis", "terms", "extended", "cbf", "explicit", "distances", "episodes"]
)
def test_memory_is_limited(call: str) -> None:
    """What would take more memory than is allowed is refused before it is allocated."""
    n = 40_000
    arm, q = vff.Arm.uniform(n, length=1e-3), np.zeros(n)
    calls: dict[str, Callable[[], Any]] = {
        "mass": lambda: arm.mass_matrix(q),
        "coriolis": lambda: arm.coriolis_matrix(q, q),
        "terms": lambda: vff.Controller(arm).terms(q, q, X),
        "extended": lambda: vff.Arm.uniform(30_000).extended_jacobian(q[:30_000], q[:30_000]),
        "cbf": lambda: vff.Controller(arm, {"avoidance": "cbf"}),
        "explicit": lambda: vff.Controller(arm, {"formulation": "extended_jacobian"}),
        "distances": lambda: vff.distances(ARM, np.zeros((10**6, N)), np.zeros((10**6, N)), [DISC] * 100),
        "episodes": lambda: _core.Episodes(SCENE, {}, 10**8, 1, 0),
    }
    with pytest.raises(vff.VffNullError, match=r"GB, more than the 8 GB allowed"):
        calls[call]()


def test_a_long_arm_runs() -> None:
    """10⁵ joints: a run of a few steps needs no matrix."""
    n = 100_000
    scene = SCENE | {"q0": [0.0] * n, "arm": {"lengths": [1e-4] * n, "masses": 1e-4}, "duration": 2e-3}
    scene["reference"] = {"kind": "setpoint", "point": [9.0, 0.0]}
    disc = {"shape": {"kind": "circle", "radius": 0.1}, "position": [5.0, 0.5]}
    result = _core.run(scene | {"obstacles": [disc]})
    assert result["record"]["q"].shape == (3, n)
