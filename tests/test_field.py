"""The force fields (docs/theory.md, section 7): gradients of a potential, over all pairs, of all shapes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

import oracle
import vffnull as vff
from strategies import KINDS, Case, Scene, between, cases, fields, obstacles, scenes

FIELDS = [vff.Field.khatib(0.7, 0.9), vff.Field.cubic(0.7, 0.9), vff.Field.bounded(0.7, 0.9)]
names = pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.kind)


def sense(
    case: Case, q: np.ndarray, around: list[Any], field: vff.Field, t: float = 0.0, dq: Any = None
) -> vff.Terms:
    """What the field does to an arm; null_damping and task do not matter for it."""
    velocity = np.zeros(case.n) if dq is None else dq
    return vff.Controller(case.arm, {"field": field}).terms(q, velocity, case.pose(), obstacles=around, t=t)


def potential(field: vff.Field, d: float) -> float:
    """U(d) by (T27) of docs/theory.md, continued below the floor by its second-order Taylor polynomial."""
    if d >= field.influence:
        return 0.0
    if field.kind == "bounded":
        return field.gain * field.influence / 3 * (1 - max(d, 0.0) / field.influence) ** 3 + field.gain * max(
            -d, 0.0
        )
    floor = field.influence / 10 if field.floor is None else field.floor
    at = max(d, floor)
    u = 1 / at - 1 / field.influence
    if field.kind == "khatib":
        U, F = u * u / 2, u / at**2
        k = 3 / at**4 - 2 / (field.influence * at**3)
    else:
        U, F = u**3 / 3, u * u / at**2
        k = 2 * u / at**4 + 2 * u * u / at**3
    depth = at - d
    return field.gain * (U + F * depth + k * depth**2 / 2)


def lone(field: vff.Field, d: float, n: int = 1) -> vff.Terms:
    """A straight arm of n links of 1 m along x, and a disc at the distance d above the middle of the last."""
    arm = vff.Arm.uniform(n)
    disc = vff.Obstacle.circle([n - 0.5, 0.5 + d], 0.5)
    return vff.Controller(arm, {"field": field}).terms([0.0] * n, [0.0] * n, [0.5, 0.0], obstacles=[disc])


# -------------------------------------------------------------------------------------- force and potential


@names
@pytest.mark.parametrize("d", [-0.3, -0.05, 0.02, 0.0899, 0.0901, 0.3, 0.7, 0.8999])
def test_force_is_the_slope_of_the_potential(field: vff.Field, d: float) -> None:
    """F(d) = −dU/dd, in penetration and below the floor too (§4: continue linearly, defined for d < 0)."""
    h = 1e-5
    slope = (potential(field, d - h) - potential(field, d + h)) / (2 * h)
    assert lone(field, d).force[0] == pytest.approx(slope, rel=1e-5, abs=1e-9)
    assert lone(field, d).clearance[0] == pytest.approx(d, abs=1e-15)


@names
def test_no_force_from_the_influence_distance_on(field: vff.Field) -> None:
    """Fact 9: F(d_s) = 0, and the force is continuous there."""
    assert lone(field, 0.9 + 1e-12).force[0] == 0
    assert lone(field, 2.0).force[0] == 0
    assert 0 < lone(field, 0.9 - 1e-6).force[0] < 1e-5


def test_khatib_near_contact() -> None:
    """Fact 9: d³F/η → 1 as d → 0."""
    field = vff.Field.khatib(0.7, 0.9, floor=1e-7)
    errors = [abs(d**3 * lone(field, d).force[0] / 0.7 - 1) for d in (1e-2, 1e-3, 1e-4, 1e-5)]
    assert errors[-1] < 2e-5
    assert errors == sorted(errors, reverse=True)  # the limit, not a coincidence


@pytest.mark.parametrize("make", [vff.Field.khatib, vff.Field.cubic])
@given(floor=between(0.05, 0.5))
def test_floor_is_smooth(make: Callable[..., vff.Field], floor: float) -> None:
    """§4: below d_f the force is F(d_f) + k(d_f)(d_f − d): C¹ at the floor and straight below it."""
    field, h = make(0.7, 0.9, floor), 1e-6
    F = [float(lone(field, floor + step).force[0]) for step in (-2 * h, -h, 0.0, h, 2 * h)]
    assert (F[2] - F[1]) / (F[3] - F[2]) == pytest.approx(1.0, abs=1e-3)
    below = [float(lone(field, d).force[0]) for d in (floor - 0.1, floor - 0.2, floor - 0.3)]
    assert below[2] - below[1] == pytest.approx(below[1] - below[0], rel=1e-9)


@given(d=between(-0.19, 2.0))
def test_bounded_field_is_bounded(d: float) -> None:
    """F = F_max (1 − d/d_s)² never exceeds F_max, however deep the contact."""
    assert 0 <= lone(vff.Field.bounded(3.0, 0.9), d).force[0] <= 3.0


@names
def test_force_falls_with_distance(field: vff.Field) -> None:
    forces = [lone(field, d).force[0] for d in np.linspace(-0.15, 0.95, 60)]
    assert all(near >= far for near, far in itertools.pairwise(forces))


def test_default_floor_is_a_tenth_of_the_influence() -> None:
    for make in (vff.Field.khatib, vff.Field.cubic):
        given = lone(make(0.7, 0.9, floor=0.09), 0.01).force[0]
        assert lone(make(0.7, 0.9), 0.01).force[0] == pytest.approx(given, rel=1e-12)


# ------------------------------------------------------------------------------- the torque is its gradient


@pytest.mark.parametrize("kind", KINDS)
@given(case=cases(2, 6), data=st.data(), field=fields(approach=False))
def test_torque_is_minus_the_gradient(kind: str, case: Case, data: st.DataObject, field: vff.Field) -> None:
    """Fact 9: Σ J_cᵀF = −∂U/∂q, U summed over all pairs with the distances that the library reports.

    Distances have kinks where another edge becomes nearest; a case is discarded if the two one-sided
    slopes of U differ by a fifth of the tolerance, which the differences could not resolve.
    """
    around = data.draw(obstacles(case, kinds=(kind,), moving=False, most=2))

    def U(q: np.ndarray) -> float:
        return sum(potential(field, d) for o in around for d in sense(case, q, [o], field).clearance)

    tau = sense(case, case.q, around, field).tau_vff
    h, here = 1e-6, U(case.q)
    for i, unit in enumerate(np.eye(case.n)):
        ahead, behind = U(case.q + h * unit), U(case.q - h * unit)
        right, left = (ahead - here) / h, (here - behind) / h
        assume(abs(right - left) <= 2e-4 * (1 + abs(right) + abs(left)))
        assert tau[i] == pytest.approx(-(ahead - behind) / (2 * h), rel=1e-3, abs=1e-3)


@given(case=cases(2, 8), data=st.data(), field=fields(approach=False))
def test_discs_exactly(case: Case, data: st.DataObject, field: vff.Field) -> None:
    """For discs the distance has a formula: torque, force and clearance as in the prototype, to rounding."""
    around = data.draw(obstacles(case, kinds=("circle",), moving=False))
    document = field.to_dict()
    solids = [o.to_dict() for o in around]
    centers, radii = oracle.obstacle_centers(solids, 0.0), np.array([o["shape"]["radius"] for o in solids])
    s = oracle.posture(case.model, case.q, case.dq)
    touch = oracle.contacts(case.model, s, centers, radii)
    F = oracle.Field(**document).force(touch.distance)[:, :, None] * touch.normal
    lever = touch.point[:, :, None] - s.p[None, None, :-1]
    expected = np.einsum("ij,ikjd,ikd->j", np.tri(case.n), oracle.perp(lever), F)
    found = sense(case, case.q, around, field)
    scale = np.linalg.norm(F) * case.arm.lengths.sum()
    np.testing.assert_allclose(found.tau_vff, expected, rtol=0, atol=1e-9 * (1 + scale))
    np.testing.assert_allclose(found.clearance, touch.distance.min(axis=1), rtol=0, atol=1e-13)
    resultant = np.linalg.norm(F.sum(axis=1), axis=1)
    np.testing.assert_allclose(found.force, resultant, rtol=0, atol=1e-9 * (1 + scale))


@given(case=cases(2, 6), data=st.data(), field=fields())
def test_all_pairs_add_up(case: Case, data: st.DataObject, field: vff.Field) -> None:
    """§4: the sum over all pairs, never the nearest only: many obstacles act as each of them alone, added."""
    around = data.draw(obstacles(case))
    whole = sense(case, case.q, around, field, dq=case.dq)
    alone = [sense(case, case.q, [o], field, dq=case.dq) for o in around]
    scale = 1 + sum(np.linalg.norm(part.tau_vff) for part in alone)
    np.testing.assert_allclose(whole.tau_vff, sum(p.tau_vff for p in alone), rtol=0, atol=1e-11 * scale)
    np.testing.assert_array_equal(whole.clearance, np.min([part.clearance for part in alone], axis=0))


def test_two_links_at_one_joint_push_twice_without_a_jump() -> None:
    """§4: as a disc moves past a joint, the torque of both links is continuous: its largest step halves with
    the step of the disc."""
    arm, field = vff.Arm.uniform(2), vff.Field.khatib(1.0, 1.0)
    controller = vff.Controller(arm, {"field": field})

    def largest_step(bend: float, number: int) -> float:
        torques = [
            controller.terms(
                [0.0, bend], [0.0, 0.0], [1.0, 1.0], obstacles=[vff.Obstacle.circle([x, 0.7], 0.2)]
            ).tau_vff
            for x in np.linspace(0.6, 1.4, number + 1)
        ]
        return float(np.abs(np.diff(torques, axis=0)).max())

    for bend in (-0.4, 0.0, 0.4):
        assert largest_step(bend, 200) / largest_step(bend, 400) == pytest.approx(2.0, rel=0.05)


@names
def test_a_gain_of_zero_switches_the_field_off(field: vff.Field) -> None:
    """The public interface."""
    off = vff.Field(field.kind, 0.0, field.influence)
    terms = lone(off, 0.05, n=3)
    np.testing.assert_array_equal(terms.tau_vff, 0)
    np.testing.assert_array_equal(terms.force, 0)


@names
def test_force_points_away_from_the_obstacle(field: vff.Field) -> None:
    """A disc above the link presses it down: negative torque about the base."""
    assert lone(field, 0.1).tau_vff[0] < 0


@names
def test_work_between_two_distances(field: vff.Field) -> None:
    """∫F dd over a path is the difference of U: 0.1 m to d_s, by quadrature of the reported force."""
    work = quad(lambda d: float(lone(field, d).force[0]), 0.1, 0.9, limit=200)[0]
    assert work == pytest.approx(potential(field, 0.1), rel=1e-7)


# -------------------------------------------------------------------------------------- motion of obstacles


def approaching(speed: float, damping: float, dq: float = 0.0) -> vff.Terms:
    """Three links along x, a disc above the middle of the second that rises with `speed`."""
    disc = vff.Obstacle.circle([1.5, 0.6], 0.2, vff.Motion.linear([0.0, speed]))
    field = vff.Field.khatib(1.0, 1.0, approach_damping=damping)
    arm = vff.Arm.uniform(3)
    return vff.Controller(arm, {"field": field}).terms(
        [0.0, 0.3, -0.5], [dq, 0.0, 0.0], [2.0, 1.0], obstacles=[disc]
    )


def test_approach_damping_acts_only_on_approach() -> None:
    """§4: F_d = c max(0, −ḋ): more force against an obstacle that comes, none against one that goes."""
    still = approaching(0.0, 1.0).force
    np.testing.assert_array_equal(still, approaching(0.0, 0.0).force)
    np.testing.assert_array_equal(approaching(0.7, 1.0).force, still)
    assert np.all(approaching(-0.7, 1.0).force[:2] > still[:2])
    np.testing.assert_array_equal(approaching(-0.7, 0.0).force, still)


def test_approach_damping_is_proportional_to_closing_speed() -> None:
    still, slow, fast = (approaching(-v, 1.0).force[1] for v in (0.0, 0.3, 0.6))
    assert fast - still == pytest.approx(2 * (slow - still), rel=1e-12)


def test_approach_counts_the_motion_of_both() -> None:
    """ḋ = n̂ᵀ(J_c q̇ − v_o): an arm that runs away from the disc as fast as it comes sees no approach."""
    arm, field = vff.Arm.uniform(1), vff.Field.khatib(1.0, 1.0, approach_damping=1.0)

    def force(v: float, w: float) -> float:
        disc = vff.Obstacle.circle([0.5, 0.6], 0.2, vff.Motion.linear([0.0, v]))
        return float(
            vff.Controller(arm, {"field": field}).terms([0.0], [w], [1.0, 0.0], obstacles=[disc]).force[0]
        )

    # The middle of the link moves with w/2.
    assert force(-0.5, -1.0) == pytest.approx(force(0.0, 0.0), rel=1e-12)
    assert force(0.0, 1.0) == pytest.approx(force(-0.5, 0.0), rel=1e-12)
    assert force(-0.5, 0.0) > force(0.0, 0.0)


@given(scene=scenes(most=6))
def test_forces_are_finite_and_push(scene: Scene) -> None:
    """No contact, wherever it is on the arm, gives anything but a finite force."""
    terms = scene.terms()
    for name in ("tau", "tau_vff", "force", "clearance"):
        assert np.all(np.isfinite(getattr(terms, name))), name


def test_approach_at_the_base_is_finite() -> None:
    """The base cannot give way: 1/m_n = 0 there, and the damping must not become infinite."""
    disc = vff.Obstacle.circle([-0.39, 0.1425], 0.25, vff.Motion.linear([1.0, 0.0]))
    settings = {"field": vff.Field.khatib(1.0, 1.0, approach_damping=1.0)}
    terms = vff.Controller(vff.Arm.uniform(5), settings).terms(
        [0.0, 2, -1, -1, -1], [0.0] * 5, [2, 1], obstacles=[disc]
    )
    assert np.all(np.isfinite(terms.tau_vff)) and np.all(np.isfinite(terms.force))


# --------------------------------------------------------------------------------------- shapes and motions


@pytest.mark.parametrize(
    ("obstacle", "distance"),
    [
        (vff.Obstacle.circle([0.5, 1.0], 0.3), 0.7),
        (vff.Obstacle.capsule([0.2, 1.0], [0.8, 1.4], 0.1), 0.9),
        (vff.Obstacle.box([0.5, 1.0], [0.4, 0.6]), 0.7),
        (vff.Obstacle.box([0.5, 1.0], [1.0, 1.0], np.pi / 4), 1.0 - np.sqrt(0.5)),
        (vff.Obstacle.polygon([[0.3, 0.4], [0.9, 0.9], [0.1, 1.2]]), 0.4),
        (vff.Obstacle.polygon([[0.1, 1.2], [0.9, 0.9], [0.3, 0.4]]), 0.4),  # clockwise
        (vff.Obstacle.circle([1.3, 0.4], 0.1), 0.4),  # past the tip: nearest to the end point
        (vff.Obstacle.circle([0.5, 0.1], 0.3), -0.2),
        (vff.Obstacle.box([0.5, 0.1], [0.2, 0.6]), -0.2),
    ],
)
def test_clearance_of_each_shape(obstacle: vff.Obstacle, distance: float) -> None:
    """Distances by hand, to a link along x from 0 to 1; negative in contact, by the shortest way out."""
    terms = vff.Controller(vff.Arm.uniform(1), {}).terms([0.0], [0.0], [1.0, 0.0], obstacles=[obstacle])
    assert terms.clearance[0] == pytest.approx(distance, abs=1e-14)
    thick = vff.Controller(vff.Arm.uniform(1, radius=0.05), {})
    found = thick.terms([0.0], [0.0], [1.0, 0.0], obstacles=[obstacle]).clearance[0]
    assert found == pytest.approx(distance - 0.05, abs=1e-14)


@pytest.mark.parametrize(
    ("motion", "place"),
    [
        (vff.Motion.static(), lambda t: [0.0, 0.0]),
        (vff.Motion.linear([0.3, -0.2]), lambda t: [0.3 * t, -0.2 * t]),
        (vff.Motion.sinusoid([0.0, -0.5], 0.5, 0.2), lambda t: [0.0, -0.5 * np.sin(0.5 * t + 0.2)]),
    ],
    ids=["static", "linear", "sinusoid"],
)
@pytest.mark.parametrize("t", [0.0, 0.7, 3.1])
def test_obstacle_is_where_its_motion_says(motion: vff.Motion, place: Any, t: float) -> None:
    disc = vff.Obstacle.circle([0.5, 3.0], 0.3, motion)
    terms = vff.Controller(vff.Arm.uniform(1), {}).terms([0.0], [0.0], [1.0, 0.0], obstacles=[disc], t=t)
    at = np.array([0.5, 3.0]) + place(t)
    away = np.linalg.norm(at - [np.clip(at[0], 0, 1), 0.0])
    assert terms.clearance[0] == pytest.approx(away - 0.3, abs=1e-14)


def test_waypoints_pass_their_points() -> None:
    points = [[0.5, 3.0], [0.5, 2.0], [0.5, 4.0]]
    disc = vff.Obstacle.circle(points[0], 0.3, vff.Motion.waypoints([0.5, 1.0, 3.0], points))
    controller = vff.Controller(vff.Arm.uniform(1), {})
    for t, y in [(0.0, 3.0), (0.5, 3.0), (1.0, 2.0), (3.0, 4.0), (9.0, 4.0)]:
        clearance = controller.terms([0.0], [0.0], [1.0, 0.0], obstacles=[disc], t=t).clearance[0]
        assert clearance == pytest.approx(y - 0.3, abs=1e-14)


@pytest.mark.parametrize(
    "motion",
    [
        vff.Motion.linear([0.1, -0.4]),
        vff.Motion.sinusoid([0.2, -0.5], 1.3, 0.2),
        vff.Motion.waypoints([0.0, 2.0], [[1.5, 1.4], [1.5, 0.4]]),
    ],
    ids=lambda motion: motion.kind,
)
def test_approach_damping_sees_the_exact_velocity(motion: vff.Motion) -> None:
    """The velocity that the field uses is the derivative of the position, for every motion.

    One link: the damping is a linear function of the closing speed, so a disc with a constant velocity of the
    right value, at the same place, must give the same force.
    """
    arm, t, h = vff.Arm.uniform(3), 0.8, 1e-4
    field = vff.Field.khatib(1.0, 1.5, approach_damping=1.0)
    disc = vff.Obstacle.circle([1.5, 1.4], 0.2, motion)
    scenario = vff.Scenario(
        arm=arm,
        q0=[0.0, 0.3, -0.5],
        duration=2.0,
        reference={"kind": "setpoint", "point": [2.0, 0.5]},
        obstacles=[disc],
        simulation={"dt": h},
    )
    places = vff.simulate(scenario).obstacles[:, 0]
    k = round(t / h)
    velocity = (places[k + 1] - places[k - 1]) / (2 * h)
    twin = vff.Obstacle.circle(places[k] - t * velocity, 0.2, vff.Motion.linear(velocity))
    controller = vff.Controller(arm, {"field": field})
    a, b = (
        controller.terms([0.0, 0.3, -0.5], [0.0] * 3, [2.0, 0.5], obstacles=[o], t=t).force
        for o in (disc, twin)
    )
    assert (
        b[1]
        > vff.Controller(arm, {"field": vff.Field.khatib(1.0, 1.5)})
        .terms([0.0, 0.3, -0.5], [0.0] * 3, [2.0, 0.5], obstacles=[disc], t=t)
        .force[1]
    )
    np.testing.assert_allclose(a, b, rtol=1e-6)
