"""Clouds of points in space: what they do to the arm, and how they are replaced, written and drawn."""

from __future__ import annotations

import copy
import threading
from pathlib import Path
from typing import Any

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings

import vffnull as vff
from vffnull.draw.figures.render import Balls, trace
from vffnull.draw.primitives import Cloud
from vffnull.draw.scene import Scene
from vffnull.engines.export import to_mjcf
from vffnull.errors import InputError, InputTypeError, ScenarioError

mpl.use("Agg")

ARM = vff.Arm.named("panda")
Q = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
DQ = [0.1, 0.0, -0.2, 0.1, 0.0, 0.3, 0.0]
TARGET = [0.4, 0.0, 0.5]
FIELD, OFF = (vff.Field.bounded(gain=gain, influence=0.3) for gain in (20.0, 0.0))
BESIDE = np.array(
    [[-0.05, -0.2, 0.62], [-0.05, -0.22, 0.6], [0.3, -0.3, 0.6], [3.0, 0.0, 0.0], [0.0, 0.3, 0.3]]
)

clouds = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 40), st.just(3)),
    elements=st.floats(-1.0, 1.0, allow_subnormal=False),
)


def controller(avoidance: str = "null_space", field: vff.Field = FIELD) -> vff.Controller:
    return vff.Controller(ARM, vff.ControlSettings(field=field, avoidance=avoidance))  # type: ignore[arg-type]


def terms(law: vff.Controller, obstacles: list[vff.Obstacle], t: float = 0.0) -> Any:
    return law.terms(Q, DQ, TARGET, obstacles=obstacles, t=t)


def same(a: Any, b: Any) -> None:
    for name in ("tau", "tau_vff", "force", "clearance", "energy"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), name)
    assert a.slack == b.slack


@pytest.mark.parametrize("avoidance", ["null_space", "priority", "cbf"])
@given(cloud=clouds, radius=st.floats(0.001, 0.1), shift=hnp.arrays(float, 3, elements=st.floats(-1.0, 1.0)))
@settings(max_examples=40, deadline=None)
def test_a_cloud_is_the_spheres_at_its_points(
    avoidance: str, cloud: np.ndarray, radius: float, shift: np.ndarray
) -> None:
    """To the last bit, wherever it stands, but for the push of the field."""
    one = [vff.Obstacle.points(cloud, radius, position=shift)]
    many = [vff.Obstacle.sphere(point + shift, radius) for point in cloud]
    same(terms(controller(avoidance, OFF), one), terms(controller(avoidance, OFF), many))


@given(cloud=clouds, radius=st.floats(0.001, 0.1))
@settings(max_examples=60, deadline=None)
def test_all_points_push_a_link_together(cloud: np.ndarray, radius: float) -> None:
    """With the norm of their potentials (T192), by distances of spheres; one point pushes as a sphere."""
    near = cloud * [0.6, 0.6, 0.6] + [0.0, 0.0, 0.4]
    spheres = [vff.Obstacle.sphere(point, radius) for point in near]
    found = vff.distances(ARM, Q, DQ, spheres)
    d = found.distance.reshape(-1, len(near))
    inside = np.clip(1.0 - np.maximum(d, 0.0) / 0.3, 0.0, None)
    potential = 20.0 * 0.3 / 3.0 * inside**3 + 20.0 * np.maximum(-d, 0.0)
    joined = (potential**8).sum(axis=1) ** (1 / 8)
    share = potential / np.where(joined > 0.0, joined, 1.0)[:, None]
    force = (share**7 * 20.0 * inside**2).ravel()
    law = terms(controller(), [vff.Obstacle.points(near, radius)])
    np.testing.assert_allclose(law.tau_vff, force @ found.gradient, rtol=1e-9, atol=1e-9)
    without = terms(controller(field=OFF), [vff.Obstacle.points(near, radius)])
    stored = law.energy[2] - without.energy[2]
    assert stored == pytest.approx(joined.sum(), rel=1e-9, abs=1e-12)
    alone = vff.Obstacle.points(near[:1], radius)
    same(terms(controller(), [alone]), terms(controller(), spheres[:1]))


@given(cloud=clouds, v=hnp.arrays(float, 3, elements=st.floats(-1.0, 1.0)), t=st.floats(0.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_a_cloud_moves_as_its_spheres_do(cloud: np.ndarray, v: np.ndarray, t: float) -> None:
    motion = vff.Motion.linear(v)
    one = [vff.Obstacle.points(cloud, 0.02, motion)]
    many = [vff.Obstacle.sphere(point, 0.02, motion) for point in cloud]
    same(terms(controller(field=OFF), one, t), terms(controller(field=OFF), many, t))


def test_a_cloud_turns() -> None:
    """A quarter turn, with the velocity of points that go round."""
    cloud = vff.Obstacle.points([[0.3, 0.0, 0.6]], 0.02, angular_velocity=[0.0, 0.0, np.pi / 2])
    found = vff.distances(ARM, Q, [0.0] * 7, [cloud], t=1.0)
    still = vff.distances(ARM, Q, [0.0] * 7, [vff.Obstacle.sphere([0.0, 0.3, 0.6], 0.02)])
    np.testing.assert_allclose(found.distance, still.distance, atol=1e-14)
    velocity = np.array([-np.pi / 2 * 0.3, 0.0, 0.0])
    np.testing.assert_allclose(found.rate, -found.normal @ velocity, atol=0.1)
    assert np.abs(found.rate).max() > 0.1


def test_distances_are_those_of_the_nearest_point() -> None:
    """One row per body and obstacle, whose index is that of the cloud."""
    ball = vff.Obstacle.sphere([1.0, 1.0, 1.0], 0.1)
    found = vff.distances(ARM, Q, DQ, [ball, vff.Obstacle.points(BESIDE, 0.02)])
    alone = vff.distances(ARM, Q, DQ, [vff.Obstacle.sphere(point, 0.02) for point in BESIDE])
    bodies = len(found.link) // 2  # the base has a shape, too, which is not one of them
    np.testing.assert_array_equal(found.obstacle, [0, 1] * bodies)
    distances = alone.distance.reshape(bodies, len(BESIDE))
    nearest = distances.argmin(axis=1)
    np.testing.assert_array_equal(found.distance[1::2], distances.min(axis=1))
    rows = np.arange(bodies) * len(BESIDE) + nearest
    for name in ("gradient", "rate", "bias", "normal", "point", "witness"):
        np.testing.assert_array_equal(getattr(found, name)[1::2], getattr(alone, name)[rows])


def test_nothing_is_infinitely_far() -> None:
    nothing = vff.Obstacle.points(np.empty((0, 3)), 0.02)
    found = vff.distances(ARM, Q, DQ, [nothing])
    assert np.isposinf(found.distance).all()
    assert all(np.isfinite(getattr(found, name)).all() for name in ("gradient", "rate", "bias", "normal"))
    alone = terms(controller(), [])
    np.testing.assert_array_equal(terms(controller(), [nothing]).tau, alone.tau)


@pytest.mark.parametrize("count", [1, 7])
def test_clouds_of_nothing_change_nothing(count: int) -> None:
    """Cameras that see nothing yet: what pushes together does so beside them, and look-ahead goes on."""
    nothing = [vff.Obstacle.points(np.empty((0, 3)), 0.01)] * count
    cloud = vff.Obstacle.points(BESIDE, 0.02)
    field = {"field": vff.Field.bounded(gain=80.0, influence=0.3)}
    alone, beside = (terms(controller(**field), [cloud, *more]) for more in ([], nothing))
    assert np.abs(alone.tau_vff).max() > 1.0
    np.testing.assert_array_equal(beside.tau, alone.tau)
    crowd = vff.Scenario.load("iiwa-crowd").replace(duration=0.4)
    few = [*crowd.to_dict()["obstacles"][:1], *(each.to_dict() for each in nothing)]
    found, expected = (vff.simulate(crowd.replace(obstacles=given)) for given in (few, few[:1]))
    np.testing.assert_array_equal(found.q, expected.q)


@pytest.mark.parametrize("avoidance", ["null_space", "cbf"])
@given(old=clouds, new=clouds)
@settings(max_examples=20, deadline=None)
def test_replaced_points_are_those_of_a_new_controller(
    avoidance: str, old: np.ndarray, new: np.ndarray
) -> None:
    place: dict[str, Any] = {"position": [0.1, 0.2, 0.3], "orientation": [0.6, 0.0, 0.8, 0.0]}
    ball = vff.Obstacle.sphere([0.5, 0.0, 0.2], 0.05)
    law = controller(avoidance)
    obstacles = [ball, vff.Obstacle.points(old, 0.03, **place)]
    before = terms(law, obstacles)
    law.update_points(new, obstacle=1)
    same(terms(law, obstacles), terms(controller(avoidance), [ball, vff.Obstacle.points(new, 0.03, **place)]))
    law.update_points(old, obstacle=1)
    same(terms(law, obstacles), before)


@pytest.mark.parametrize("avoidance", ["null_space", "priority", "cbf"])
@given(cloud=clouds, data=st.data(), t=st.floats(0.0, 1.0))
@settings(max_examples=20, deadline=None)
def test_points_that_move_are_spheres_that_do(
    avoidance: str, cloud: np.ndarray, data: st.DataObject, t: float
) -> None:
    """To the last bit, each at a velocity of its own."""
    velocities = data.draw(hnp.arrays(float, cloud.shape, elements=st.floats(-1.0, 1.0)))
    law, one = controller(avoidance, OFF), [vff.Obstacle.points(cloud, 0.02)]
    terms(law, one)
    law.update_points(cloud, velocities=velocities, t=0.0)
    many = [
        vff.Obstacle.sphere(point, 0.02, vff.Motion.linear(v))
        for point, v in zip(cloud, velocities, strict=True)
    ]
    same(terms(law, one, t), terms(controller(avoidance, OFF), many, t))
    law.update_points(cloud)
    same(terms(law, one, t), terms(controller(avoidance, OFF), one, t))


def on_a_sphere(centre: Any, radius: float, count: int) -> np.ndarray:
    """Points that are spread evenly over it (a spiral of golden angles)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - z * z)
    unit = np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
    return np.asarray(centre + radius * unit)


def test_a_cloud_that_samples_a_moving_sphere_does_what_it_does() -> None:
    """Clearance within what lies between the points, and the torque of `cbf` within a few percent."""
    start, velocity = ARM.forward_kinematics(Q)[-1] - [0.0, 0.5, 0.0], np.array([0.1, 0.9, 0.0])
    radius, ball = 0.06, 0.01
    cloud = on_a_sphere(start, radius - ball, 800)
    # Without a field, which sums over points.
    settings = vff.ControlSettings(avoidance="cbf", field=vff.Field.bounded(gain=0.0, influence=0.3))
    for t in (0.0, 0.35, 0.4):
        law, one = vff.Controller(ARM, settings), [vff.Obstacle.points(cloud, ball)]
        law.torque(Q, [0.0] * 7, TARGET, obstacles=one, t=t)
        law.update_points(cloud, velocities=np.tile(velocity, (len(cloud), 1)), t=0.0)
        whole = [vff.Obstacle.sphere(start, radius, vff.Motion.linear(velocity))]
        found = law.terms(Q, [0.0] * 7, TARGET, obstacles=one, t=t)
        expected = vff.Controller(ARM, settings).terms(Q, [0.0] * 7, TARGET, obstacles=whole, t=t)
        np.testing.assert_allclose(found.clearance, expected.clearance, atol=2e-3)
        free = vff.Controller(ARM, settings).torque(Q, [0.0] * 7, TARGET)
        avoids = np.linalg.norm(expected.tau - free)
        assert np.linalg.norm(found.tau - expected.tau) < 0.05 * avoids + 0.05, t
    assert avoids > 1.0, "at the end it is in the way"


def reach_at(velocities: bool, way: np.ndarray) -> float:
    """How near a ball comes that a camera sees every 33 ms, without or with its velocity [m]."""
    settings = vff.ControlSettings(
        stiffness=100.0, damping=20.0, null_damping=4.0, avoidance="cbf",
        field=vff.Field.bounded(gain=0.0, influence=0.3),
    )  # fmt: skip
    law, one = vff.Controller(ARM, settings), [vff.Obstacle.points(np.empty((0, 3)), 0.01)]
    tip = ARM.forward_kinematics(Q)[-1]
    radius, begin = 0.06, tip - 0.8 * way / np.linalg.norm(way)
    ball = vff.Obstacle.sphere(begin, radius, vff.Motion.linear(way))
    q, dq, dt, least = np.array(Q), np.zeros(7), 0.002, np.inf
    rates = np.tile(way, (200, 1)) if velocities else None
    for k in range(round(1.6 / np.linalg.norm(way) / dt)):
        t = k * dt
        if k % 16 == 1:
            law.update_points(on_a_sphere(begin + way * t, radius - 0.01, 200), velocities=rates, t=t)
        tau = law.torque(q, dq, tip, obstacles=one, t=t)
        dq = dq + dt * ARM.forward_dynamics(q, dq, tau)
        q = q + dt * dq
        least = min(least, vff.distances(ARM, q, dq, [ball], t=t).distance.min())
    return float(least)


def test_velocities_avoid_what_points_at_rest_do_not() -> None:
    """Balls that come from all sides at 1 m/s towards the hand of an arm that holds it where it is."""
    ways = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [-0.7, 0.7, 0.0], [0.0, 0.7, -0.7]])
    least = np.array([[reach_at(moving, way) for moving in (False, True)] for way in ways])
    hit = (least < 0.0).sum(axis=0)
    assert hit.tolist() == [5, 0], least


REFUSED: list[tuple[Any, int, type[Exception], str]] = [
    (np.zeros((3, 2)), 0, InputError, r"cloud: expected shape \(k, 3\), got \(3, 2\)"),
    (np.zeros(3), 0, InputError, r"cloud: expected shape \(k, 3\), got \(3,\)"),
    ([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]], 0, InputError, r"cloud\[1\]\[1\] must be finite"),
    (np.zeros((50_001, 3)), 0, InputError, "at most 50000 points, got 50001"),
    ("points", 0, InputTypeError, "cloud: expected numbers"),
    ([[0.0, 0.0], [1.0]], 0, InputTypeError, "cloud: expected numbers"),
    (BESIDE, 1, InputError, "obstacle 1 is not a cloud"),
    (BESIDE, 2, InputError, "there is no obstacle 2, there are 2, 0 to 1"),
    (BESIDE, -1, InputError, "obstacle: must be 0 or more"),
]


@pytest.mark.parametrize(("cloud", "obstacle", "error", "sentence"), REFUSED)
def test_unusable_points_change_nothing(
    cloud: Any, obstacle: int, error: type[Exception], sentence: str
) -> None:
    law, simulation = controller(), vff.Simulation(SCENARIO)
    obstacles = [vff.Obstacle.points(BESIDE, 0.02), vff.Obstacle.sphere([1.0, 1.0, 1.0], 0.1)]
    before = terms(law, obstacles)
    for each in (law, simulation):
        with pytest.raises(error, match=sentence):
            each.update_points(cloud, obstacle=obstacle)
    same(terms(law, obstacles), before)
    fresh = vff.Simulation(SCENARIO)
    np.testing.assert_array_equal(simulation.step().q, fresh.step().q)


@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"velocities": np.zeros((4, 3))}, r"velocities: expected shape \(5, 3\), like cloud, got \(4, 3\)"),
        ({"velocities": np.zeros(3)}, r"velocities: expected shape \(k, 3\), got \(3,\)"),
        ({"velocities": np.full((5, 3), np.inf)}, r"velocities\[0\]\[0\] must be finite"),
        ({"velocities": np.zeros((5, 3)), "t": np.nan}, "t must be finite"),
    ],
)
def test_unusable_velocities_change_nothing(keywords: dict[str, Any], sentence: str) -> None:
    law, obstacles = controller(), [vff.Obstacle.points(BESIDE, 0.02)]
    before = terms(law, obstacles)
    for each in (law, vff.Simulation(SCENARIO)):
        with pytest.raises(InputError, match=sentence):
            each.update_points(BESIDE + 0.1, **keywords)
    same(terms(law, obstacles), before)


def test_what_has_no_points() -> None:
    with pytest.raises(InputError, match="there is none yet"):
        controller().update_points(BESIDE)
    with pytest.raises(InputError, match="clouds of points are in space"):
        vff.Controller(vff.Arm.uniform(3)).update_points(BESIDE)
    law = controller()
    law.torque(Q, DQ, TARGET, obstacles=[vff.Obstacle.points(BESIDE, 0.02).to_dict()])
    with pytest.raises(InputError, match="give an Obstacle"):
        law.update_points(BESIDE)


SCENARIO: dict[str, Any] = {
    "duration": 0.2,
    "q0": Q,
    "arm": {"model": "panda"},
    "reference": {"kind": "setpoint"},
    "controller": {"field": FIELD.to_dict()},
    "obstacles": [
        vff.Obstacle.points(BESIDE, 0.02, angular_velocity=[0.0, 0.0, 0.4]).to_dict(),
        vff.Obstacle.sphere([1.0, 1.0, 1.0], 0.1).to_dict(),
    ],
}


def with_points(points: Any) -> dict[str, Any]:
    document = copy.deepcopy(SCENARIO)
    document["obstacles"][0]["shape"]["points"] = np.asarray(points).tolist()
    return document


def test_a_simulation_goes_on_among_other_points() -> None:
    """As one that began with them, and back to its own from the start."""
    changed, other = vff.Simulation(SCENARIO), vff.Simulation(with_points(BESIDE + 0.05))
    state = changed.update_points(BESIDE + 0.05)
    np.testing.assert_array_equal(state.clearance, other.state.clearance)
    while not changed.done:
        np.testing.assert_array_equal(changed.step().q, other.step().q)
    assert changed.status == other.status
    again, fresh = changed.reset(), vff.Simulation(SCENARIO).state
    np.testing.assert_array_equal(again.clearance, fresh.clearance)
    assert changed.update_points([ARM.forward_kinematics(Q)[4]]).clearance.min() < 0.0
    assert changed.status == "collided"


def test_points_of_a_simulation_go_on() -> None:
    """As those of a cloud that moves as a whole."""
    velocity = [0.2, 0.3, -0.1]
    moving = with_points(BESIDE)
    moving["obstacles"][0] |= {"angular_velocity": [0.0] * 3, "motion": vff.Motion.linear(velocity).to_dict()}
    still = with_points([[9.0, 9.0, 9.0]])
    still["obstacles"][0] |= {"angular_velocity": [0.0] * 3}
    points, whole = vff.Simulation(still), vff.Simulation(moving)
    points.update_points(BESIDE, velocities=np.tile(velocity, (len(BESIDE), 1)))
    while not points.done:
        found, expected = points.step(), whole.step()
        np.testing.assert_allclose(found.q, expected.q, atol=1e-12)
        np.testing.assert_allclose(found.clearance, expected.clearance, atol=1e-12)


def test_a_loop_goes_on_while_points_are_replaced() -> None:
    """Threads that share a controller: every torque is that among one cloud or the other."""
    rng = np.random.default_rng(0)
    far = rng.uniform(1.5, 3.0, (20_000, 3))
    sets = [np.vstack([far, BESIDE]), np.vstack([far, BESIDE + 0.03])]
    obstacles = [vff.Obstacle.points(sets[0], 0.02)]
    expected = [terms(controller(), [vff.Obstacle.points(each, 0.02)]).tau for each in sets]
    law, faults, met = controller(), [], set()
    law.torque(Q, DQ, TARGET, obstacles=obstacles)
    over = threading.Event()

    def loop() -> None:
        while not over.is_set():
            tau = law.torque(Q, DQ, TARGET, obstacles=obstacles)
            which = [i for i, each in enumerate(expected) if np.array_equal(tau, each)]
            met.update(which)
            if not which:
                faults.append(tau)

    thread = threading.Thread(target=loop)
    thread.start()
    rounds = 0
    while (len(met) < 2 or rounds < 10) and rounds < 1000:
        rounds += 1
        law.update_points(sets[rounds % 2])
    over.set()
    thread.join()
    assert not faults and met == {0, 1}


def test_documents(tmp_path: Path) -> None:
    cloud = vff.Obstacle.points(BESIDE.astype(np.float32), 0.0, position=[0.1, 0.0, 0.0])
    assert cloud.shape == {"kind": "points", "points": BESIDE.astype(np.float32).tolist(), "radius": 0.0}
    assert cloud == vff.Obstacle.points(BESIDE.astype(np.float32).tolist(), 0.0, position=[0.1, 0.0, 0.0])
    assert len({cloud, vff.Obstacle.points([], 0.0)}) == 2
    scenario = vff.Scenario.from_dict(SCENARIO)
    scenario.save(tmp_path / "cloud.toml")
    assert vff.Scenario.load(tmp_path / "cloud.toml") == scenario
    assert "<1000 points>" in repr(vff.Obstacle.points(np.zeros((1000, 3)), 0.1))
    many = vff.Obstacle.points(np.random.default_rng(1).uniform(-1, 1, (50_000, 3)), 0.01)
    assert len(many.shape["points"]) == 50_000


@pytest.mark.parametrize(
    ("points", "radius", "path"),
    [
        ([[0.0, 0.0]], 0.1, "shape.points[0]"),
        ([[0.0, 0.0, 0.0], [0.0, 0.0, np.inf]], 0.1, "shape.points[1][2]"),
        (np.zeros((50_001, 3)), 0.1, "shape.points"),
        ([[0.0, 0.0, 0.0]], -0.1, "shape.radius"),
    ],
)
def test_unusable_clouds_are_refused(points: Any, radius: float, path: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        vff.Obstacle.points(points, radius)
    assert caught.value.path == path


def test_there_are_none_in_the_plane() -> None:
    shape = {"kind": "points", "points": [], "radius": 0.1}
    with pytest.raises(ScenarioError, match="that is a shape of obstacles in space"):
        vff.Controller(vff.Arm.uniform(3)).torque(
            [0.1] * 3, [0.0] * 3, [1.0, 1.0], obstacles=[{"shape": shape, "position": [0.0, 0.0]}]
        )


def test_mujoco_has_a_geom_for_each_point() -> None:
    mujoco = pytest.importorskip("mujoco")
    text = to_mjcf(ARM, obstacles=SCENARIO["obstacles"])
    model = mujoco.MjModel.from_xml_string(text)
    names = [model.geom(i).name for i in range(model.ngeom)]
    assert [name for name in names if name.startswith("obstacle_1")] == [
        "obstacle_1",
        *(f"obstacle_1_{i}" for i in range(2, 6)),
    ]
    np.testing.assert_array_equal(model.geom("obstacle_1_3").pos, BESIDE[2])
    with pytest.raises(ScenarioError, match=r"obstacles\[1\].shape.points: 1001 points are too many"):
        to_mjcf(ARM, obstacles=[SCENARIO["obstacles"][1], vff.Obstacle.points(np.zeros((1001, 3)), 0.1)])


@pytest.fixture(scope="module")
def result() -> vff.Result:
    rng = np.random.default_rng(0)
    room = rng.uniform(-1.5, 1.5, (3000, 3))
    room[:, 0] = 1.5
    document = with_points(np.vstack([BESIDE, room]))
    document["obstacles"].append(vff.Obstacle.points([], 0.1).to_dict())
    document["obstacles"].append(vff.Obstacle.points([[0.0, -0.5, 0.9]], 0.0).to_dict())
    document["simulation"] = {"record_every": 10}
    return vff.simulate(document)


def test_scenes(result: vff.Result) -> None:
    scene = Scene.of_result(result)
    drawn = [each for each in scene.at(3, ["obstacle"]) if isinstance(each, Cloud)]
    assert [len(each.points) for each in drawn] == [3005, 0, 1]
    angle = 0.4 * scene.t[3]
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    np.testing.assert_allclose(drawn[0].points[:5], BESIDE @ turn.T, atol=1e-12)
    assert not [each for each in scene.at(3, ["influence"]) if isinstance(each, Cloud)]
    points, forces = scene.pushes
    pushed = np.linalg.norm(forces, axis=-1)
    np.testing.assert_allclose(pushed, scene.strength, atol=1e-12)
    assert pushed.max() > 0.0 and np.isfinite(points).all()
    # Away from the ball of the cloud that is nearest to the link.
    row, link = np.unravel_index(int(pushed.argmax()), pushed.shape)
    way = points[row, link] - drawn[0].points[:5]
    away = way[np.linalg.norm(way, axis=1).argmin()]
    cosine = away @ forces[row, link] / np.linalg.norm(away) / pushed.max()
    assert cosine == pytest.approx(1.0, abs=0.02)


def test_balls_are_drawn_where_they_are() -> None:
    axes, xs = np.eye(3), np.linspace(-1.0, 1.0, 201)
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.3], [0.5, -0.5, 0.1], [9.0, 0.0, 0.0]])
    colours, depths = trace([Balls(points, 0.1, np.array([0.5, 0.2, 0.1]))], axes, xs, xs)
    assert depths[100, 100] == pytest.approx(0.4) and depths[50, 150] == pytest.approx(0.2)
    seen = np.isfinite(depths)
    assert seen.sum() == pytest.approx(2 * np.pi * 0.1**2 / 0.01**2, rel=0.05)
    assert (colours[seen] < 0.9).all() and (colours[~seen] == 1.0).all()


def test_pictures_and_pages(result: vff.Result, tmp_path: Any) -> None:
    assert result.plot(tmp_path)
    result.animate(tmp_path / "run.gif")
    assert (tmp_path / "run.gif").stat().st_size > 1000
    result.report(tmp_path / "run.html")
    assert result._repr_html_()
    assert result.scenario._repr_html_()


def test_rerun(result: vff.Result, tmp_path: Any) -> None:
    pytest.importorskip("rerun")
    result.save(tmp_path / "run.rrd")
    assert (tmp_path / "run.rrd").stat().st_size > 1000


def ball_of_points(radius: float, count: int) -> dict[str, Any]:
    """A ball as a cloud: small balls evenly over its surface."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle, ring, small = 2.399963 * np.arange(count), np.sqrt(1.0 - height**2), 0.01
    points = (radius - small) * np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    return {"kind": "points", "points": points.tolist(), "radius": small}


@pytest.mark.parametrize("way", ["cbf", "priority"])
@pytest.mark.filterwarnings("ignore:the torque chatters")
@pytest.mark.parametrize("count", [1, 60, 200])
@pytest.mark.parametrize("command", [{"tip_speed": 0.15}, {"tip_speed": 0.15, "torque_rate": 1000.0}])
def test_many_points_that_pass_through_an_arm_break_no_limit(
    way: str, count: int, command: dict[str, float]
) -> None:
    """A ball at 0.8 m/s comes at an iiwa whose hand may move at 0.15 m/s: it is hit, by one body as by the
    points of a cloud of it, and neither a joint nor the hand is faster than it may be.
    """
    shape = {"kind": "sphere", "radius": 0.1} if count == 1 else ball_of_points(0.1, count)
    result = vff.simulate(
        {
            "duration": 1.5,
            "q0": [0.0, 0.6, 0.0, -1.4, 0.0, 1.0, 0.0],
            "arm": {"model": "iiwa14"},
            "reference": {"kind": "setpoint"},
            "controller": {
                "task": "position",
                "stiffness": 100.0,
                "damping": 20.0,
                "avoidance": way,
                "command": command,
                "field": {"kind": "bounded", "gain": 40.0, "influence": 0.2},
            },
            "obstacles": [
                {
                    "shape": shape,
                    "position": [0.3, -0.55, 0.6],
                    "motion": {"kind": "linear", "velocity": [0.0, 0.8, 0.0]},
                }
            ],
            "simulation": {"dt": 1e-3, "control": "hold"},
        }
    )
    metrics = result.metrics
    assert metrics["velocity_limit_ratio"] < 1.02 and metrics["torque_limit_ratio"] < 1.001, metrics
    assert metrics["tip_speed_ratio"] < 1.1, metrics["tip_speed_ratio"]  # torque limits come first
    if count == 60:  # more than the program has room for
        assert metrics["programs_cut"] > 0
