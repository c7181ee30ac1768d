"""The central promise in space: nothing in the null space accelerates the end effector (T4, T14).

Random chains of joints that turn and slide, tasks and worlds; what is expected comes from the matrices J, M,
C and g of the arm.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import vffnull as vff
from strategies import (
    TWO_FORMULATIONS,
    WIDTHS,
    Case,
    SpatialScene,
    assert_passive,
    cases,
    fields,
    obstacles,
    raised,
    random_arm,
    spatial_scenes,
    unit,
    vectors,
    written_in_space,
)

Array = NDArray[np.float64]

tasks = st.sampled_from(list(WIDTHS))
redundant = tasks.flatmap(spatial_scenes)


def rounding(scene: SpatialScene) -> float:
    """What solving with M and with Λ⁻¹ may lose, relative to what is solved for: n rounding errors each,
    enlarged by the condition of the matrix, in each of the few steps that lead to a torque.
    """
    case = scene.case
    conditions = np.linalg.cond(case.arm.mass_matrix(case.q)) + np.linalg.cond(case.mobility(scene.length))
    return float(8 * case.n * np.finfo(float).eps * conditions)


def response(scene: SpatialScene) -> Array:
    """J M⁻¹: how the end effector accelerates per joint torque."""
    case = scene.case
    solved: Array = np.linalg.solve(case.arm.mass_matrix(case.q), case.jacobian().T).T
    return solved


def projected(scene: SpatialScene, terms: vff.Terms) -> float:
    """The size of what is projected into the null space: repulsion, damping, coupling."""
    case = scene.case
    damping = np.max(scene.gains["null_damping"]) * np.linalg.norm(case.arm.mass_matrix(case.q))
    coupling = np.linalg.norm(case.arm.coriolis_matrix(case.q, case.dq))
    return float(np.linalg.norm(terms.tau_vff) + (damping + coupling) * np.linalg.norm(case.dq))


def torques(scene: SpatialScene, terms: vff.Terms) -> float:
    """The size of everything that a torque is the sum of."""
    return float(np.linalg.norm(terms.tau_task) + np.linalg.norm(terms.tau_null)) + projected(scene, terms)


@pytest.mark.parametrize("formulation", TWO_FORMULATIONS)
@given(scene=redundant)
def test_null_torque_does_not_move_the_tool(formulation: str, scene: SpatialScene) -> None:
    """J M⁻¹ τ_null = 0."""
    terms, JM = scene.terms(formulation=formulation), response(scene)
    leak = np.linalg.norm(JM @ terms.tau_null)
    assert leak <= rounding(scene) * np.linalg.norm(JM) * projected(scene, terms)


@pytest.mark.parametrize("formulation", TWO_FORMULATIONS)
@given(scene=redundant)
def test_closed_loop_of_the_task_is_exact(formulation: str, scene: SpatialScene) -> None:
    """The acceleration of the end effector is the commanded one, whatever links, field and null motion do."""
    case, terms = scene.case, scene.terms(formulation=formulation)
    found = case.jacobian() @ case.arm.forward_dynamics(case.q, case.dq, terms.tau) + case.bias()
    expected = scene.commanded()
    size = np.linalg.norm(response(scene)) * torques(scene, terms) + np.linalg.norm(case.bias())
    atol = rounding(scene) * (size + np.linalg.norm(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


@settings(max_examples=60)
@given(scene=redundant)
def test_both_formulations_give_the_same_torque(scene: SpatialScene) -> None:
    a, b = (scene.terms(formulation=formulation) for formulation in TWO_FORMULATIONS)
    for name in ("tau", "tau_task", "tau_null", "tau_vff", "force"):
        difference = np.linalg.norm(getattr(a, name) - getattr(b, name))
        assert difference <= rounding(scene) * torques(scene, a), f"{name} differs by {difference}"
    np.testing.assert_array_equal(a.clearance, b.clearance)


@settings(max_examples=60)
@given(scene=redundant)
def test_projector(scene: SpatialScene) -> None:
    """N² = N, trace N = n − m, J N = 0, J M⁻¹ Nᵀ = 0, and M N = Nᵀ M."""
    case, N = scene.case, scene.terms().N
    J, M, JM = case.jacobian(), case.arm.mass_matrix(case.q), response(scene)
    size, eps = np.linalg.norm(N), rounding(scene)
    assert np.linalg.norm(N @ N - N) <= eps * size**2
    assert np.trace(N) == pytest.approx(case.n - case.m, abs=eps * size)
    assert np.linalg.norm(J @ N) <= eps * np.linalg.norm(J) * size
    assert np.linalg.norm(JM @ N.T) <= eps * np.linalg.norm(JM) * size
    np.testing.assert_allclose(M @ N, N.T @ M, rtol=0, atol=eps * np.linalg.norm(M) * size)


@settings(max_examples=30)
@given(scene=tasks.flatmap(lambda task: spatial_scenes(task, spare=0, most=WIDTHS[task])))
def test_no_null_space_without_redundancy(scene: SpatialScene) -> None:
    """n = m: N = 0, and the null-space torque with it."""
    for formulation in TWO_FORMULATIONS:
        terms = scene.terms(formulation=formulation)
        assert np.linalg.norm(terms.N) <= rounding(scene)
        assert np.linalg.norm(terms.tau_null) <= rounding(scene) * torques(scene, terms)


def test_other_projections_leak() -> None:
    """The measure above sees what leaks: of every arm, and a million times more than of the law."""
    rng = np.random.default_rng(2)
    leaks: dict[str, list[float]] = {"dynamic": [], "kinematic": [], "none": []}
    for k in range(60):
        task = list(WIDTHS)[k % 3]
        arm = vff.Arm._from_dict(random_arm(rng, 9) | {"collision": [ball_on("link 6")]})
        q = rng.uniform(-2.0, 2.0, 9)
        near = arm.link_poses(q)[6][:3, 3] + 0.3 * unit(rng, 3)
        J = arm.jacobian(q)[: 3 if task == "position" else 6]
        JM = np.linalg.solve(arm.mass_matrix(q), J.T).T
        x = np.append(*arm.pose(q))[: 3 if task == "position" else 7]
        for projection, found in leaks.items():
            law = {"projection": projection, "task": task, "field": vff.Field.khatib(1.0, 1.0)}
            solid = vff.Obstacle.sphere(near, 0.1)
            tau = vff.Controller(arm, law).terms(q, np.zeros(9), x, obstacles=[solid]).tau_null
            moved = JM @ tau
            if task == "pointing":  # the turn about the tool's axis is free
                axis = arm.link_poses(q)[-1][:3, :3] @ tool_axis(arm)
                moved[3:] -= (moved[3:] @ axis) * axis
            found.append(float(np.linalg.norm(moved) / (np.linalg.norm(JM) * np.linalg.norm(tau))))
    assert max(leaks["dynamic"]) < 1e-10
    for projection in ("kinematic", "none"):
        assert np.median(leaks[projection]) > 1e-3, projection
        assert min(leaks[projection]) > 1e-6, projection


def ball_on(link: str) -> dict[str, object]:
    return {"link": link, "shape": {"kind": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.05}}


def tool_axis(arm: vff.Arm) -> Array:
    """The z axis of the tool in the frame of the last link."""
    w, x, y, z = arm.to_dict()["tool"]["orientation"]
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


@settings(max_examples=60)
@given(
    scene=tasks.flatmap(lambda task: spatial_scenes(task, uniform=True)),
    seed=st.integers(0, 2**32 - 1),
    shift=vectors(3, -3.0, 3.0),
)
def test_turning_everything_changes_nothing(scene: SpatialScene, seed: int, shift: Array) -> None:
    """Robot, gravity, obstacles and reference together: the same torques, part by part."""
    rotation = unit(np.random.default_rng(seed), 4)
    here, there = scene.terms(), scene.turned(rotation, shift).terms()
    # A distance is a difference of places: what is lost of it, relative to what is left, the field amplifies.
    places = 10 + np.linalg.norm(shift)
    nearest = np.min(np.abs(here.clearance))
    lost = rounding(scene) + 64 * np.finfo(float).eps * places / max(nearest, 1e-12)
    np.testing.assert_allclose(there.clearance, here.clearance, rtol=0, atol=1e-14 * places)
    for name in ("tau", "tau_task", "tau_null", "tau_vff"):
        difference = np.linalg.norm(getattr(there, name) - getattr(here, name))
        assert difference <= lost * torques(scene, here), f"{name} differs by {difference}"


@settings(max_examples=40)
@given(scene=tasks.flatmap(lambda task: spatial_scenes(task, most=9)), data=st.data())
def test_null_space_is_passive(scene: SpatialScene, data: st.DataObject) -> None:
    """d/dt(½νᵀΛ_nν) = −νᵀD_nν + νᵀZᵀ(τ_ext + τ_vff), by differences along the closed loop."""
    case = scene.case
    tau_ext = data.draw(vectors(case.n, -5.0, 5.0))
    assert_passive(scene, tau_ext, lambda q, dq: case.moved(q, dq).jacobian())


def sides(around: list[vff.Obstacle]) -> Iterator[float]:
    """The angles of the axes of capsules and of the sides of boxes, up to quarters of a turn."""
    for solid in around:
        if solid.kind == "capsule":
            x, y = np.subtract(solid.shape["b"], solid.shape["a"])
            yield float(np.arctan2(y, x))
        elif solid.kind == "box":
            yield solid.angle


@settings(max_examples=60)
@given(case=cases(3, 10), data=st.data())
def test_a_planar_arm_in_space_has_the_planar_torque(case: Case, data: st.DataObject) -> None:
    """Across the plane it cannot move, and the task does not pull there; all the rest is the same.

    Unless the axes of a link and an obstacle cross, where space has another way out, or are parallel, where
    many points are equally near.
    """
    case.away_from_singularities()
    flat = vff.Arm(**case.document | {"radius": np.maximum(case.arm.radius, 1e-3)})
    t = data.draw(st.floats(0.0, 3.0))
    around = data.draw(obstacles(case, t, kinds=("circle", "capsule", "box")))
    for side in sides(around):
        assume(np.abs(np.sin(2 * (np.cumsum(case.q) - side))).min() > 0.05)
    field = data.draw(fields()).to_dict()
    K, D = data.draw(vectors(2, 0.0, 100.0)), data.draw(vectors(2, 0.0, 20.0))
    gains = {"null_damping": data.draw(vectors(case.n, 0.0, 8.0)), "field": field}
    x, dx, ddx = (data.draw(vectors(2, -size, size)) for size in (1.0, 1.0, 2.0))
    reference = case.pose() + x, dx, ddx
    planar = vff.Controller(flat, {**gains, "stiffness": K, "damping": D}).terms(
        case.q, case.dq, *reference, obstacles=around, t=t
    )
    assume(planar.clearance.min() > 0.0)
    spatial = vff.Controller(
        vff.Arm._from_dict(written_in_space(flat)),
        {**gains, "stiffness": [*K, 1.0], "damping": [*D, 1.0]},
    ).terms(
        case.q,
        case.dq,
        *(np.append(each, 0.0) for each in reference),
        obstacles=[raised(each.to_dict()) for each in around],
        t=t,
    )
    J, M = case.jacobian(), flat.mass_matrix(case.q)
    conditions = np.linalg.cond(M) + np.linalg.cond(J @ np.linalg.solve(M, J.T))
    nearest = max(np.min(np.abs(planar.clearance)), 1e-12)
    eps = 64 * case.n * np.finfo(float).eps * (conditions + 10 / nearest)
    scale = sum(np.linalg.norm(part) for part in (planar.tau_task, planar.tau_null, planar.tau_vff))
    C = flat.coriolis_matrix(case.q, case.dq)
    scale += (np.linalg.norm(C) + 8 * np.linalg.norm(M)) * np.linalg.norm(case.dq)
    np.testing.assert_allclose(spatial.clearance, planar.clearance, rtol=0, atol=1e-13)
    for name in ("tau", "tau_task", "tau_null", "tau_vff"):
        difference = np.linalg.norm(getattr(spatial, name) - getattr(planar, name))
        assert difference <= eps * scale, f"{name} differs by {difference}"
