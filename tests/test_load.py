"""What the hand carries: the law weighs it, and every distance counts it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioError
from vffnull.evaluation.geometry.arm import rotation
from vffnull.model.arm import frame
from vffnull.robots import emulated
from vffnull.robots.simulated import SimulatedRobot
from vffnull.run.emulate import emulate
from waiting import HANG

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
PANDA = vff.Arm.named("panda")
TURNED = [0.9238795325112867, 0.0, 0.3826834323650898, 0.0]  # 45° about y
TRAY: dict[str, Any] = {"kind": "box", "size": [0.3, 0.2, 0.02], "center": [0.0, 0.0, 0.03]}
SHAPES: list[dict[str, Any]] = [
    TRAY,
    {"kind": "box", "size": [0.1, 0.05, 0.2], "center": [0.1, 0.0, 0.1], "orientation": TURNED},
    {"kind": "capsule", "a": [0.0, 0.0, 0.05], "b": [0.05, 0.1, 0.25], "radius": 0.03},
    {"kind": "sphere", "center": [-0.1, 0.05, 0.1], "radius": 0.04},
    {"kind": "convex", "vertices": [[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3], [0.1, 0.1, 0.1]]},
]
SCENE: dict[str, Any] = {
    "duration": 2.0,
    "q0": READY,
    "arm": {"model": "panda"},
    "controller": {"task": "pose", "stiffness": 400.0, "damping": 40.0, "avoidance": "cbf"},
    "reference": {"kind": "setpoint"},
    "simulation": {"dt": 1e-3, "control": "hold", "integrator": "semi_implicit_euler"},
}


def in_mujoco(shape: dict[str, Any], place: Any, turn: Any, ball: Any, rod: Any = None) -> Any:
    """The same solid on a body of 1 kg in another engine, and a ball of 2 cm beside it."""
    mujoco = pytest.importorskip("mujoco")

    def text(*values: Any) -> str:
        return " ".join(f"{x:.17g}" for x in np.concatenate([np.ravel(v) for v in values]))

    asset, kind = "", shape["kind"]
    match kind:
        case "box":
            geom = f'type="box" size="{text(0.5 * np.array(shape["size"]))}"'
        case "capsule":
            geom = f'type="capsule" fromto="{text(shape["a"], shape["b"])}" size="{shape["radius"]}"'
        case "sphere":
            geom = f'type="sphere" size="{shape["radius"]}"'
        case _:
            asset = f'<asset><mesh name="hull" inertia="convex" vertex="{text(shape["vertices"])}"/></asset>'
            geom = 'type="mesh" mesh="hull"'
    for key, name in (("center", "pos"), ("orientation", "quat")):
        if key in shape:
            geom += f' {name}="{text(shape[key])}"'
    beside = f'<geom type="sphere" size="0.02" pos="{text(ball)}"/>'
    if rod is not None:
        beside += f'<geom type="capsule" fromto="{text(*rod[0])}" size="{rod[1]}"/>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>{asset}<worldbody>
        <body pos="{text(place)}" quat="{text(turn)}"><freejoint/><geom {geom} mass="1"/></body>
        {beside}</worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return mujoco, model, data


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape["kind"])
def test_a_shape_says_where_its_mass_is(shape: dict[str, Any]) -> None:
    mujoco, model, _ = in_mujoco(shape, [0.0] * 3, [1.0, 0.0, 0.0, 0.0], [1.0] * 3)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[1])
    turn = turn.reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[1]) @ turn.T
    ours = PANDA.with_load(1.0, shapes=[shape])
    theirs = PANDA.with_load(1.0, model.body_ipos[1], inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    given = PANDA.with_load(1.0, [0.0] * 3, [0.0] * 6, shapes=[shape])
    np.testing.assert_allclose(ours.mass_matrix(READY), theirs.mass_matrix(READY), atol=1e-9)
    np.testing.assert_array_equal(given.mass_matrix(READY), PANDA.with_load(1.0).mass_matrix(READY))


def test_several_shapes_weigh_by_their_volumes() -> None:
    balls = [{"kind": "sphere", "center": [0.0, 0.0, z], "radius": r} for z, r in ((0.1, 0.02), (0.3, 0.04))]
    by_hand = PANDA.with_load(9.0, [0.0, 0.0, (0.1 + 8 * 0.3) / 9], [0.0] * 6)
    together = PANDA.with_load(9.0, shapes=balls)
    np.testing.assert_allclose(together.gravity_torque(READY), by_hand.gravity_torque(READY), atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape["kind"])
def test_distances_count_it(shape: dict[str, Any]) -> None:
    """A ball beside it is as far away as another engine finds it, where the tool takes it."""
    tool = PANDA.with_tool([0.02, -0.01, 0.15], TURNED)
    place, turn = tool.pose(READY)
    arm = tool.to_dict() | {"collision": [], "load": {"shapes": [shape]}}
    carries = vff.Scenario.from_dict(SCENE | {"arm": arm}).arm
    assert len(carries.collision) == 1 and carries.masses[-1] == PANDA.masses[-1]
    middle = place + np.array([0.3, 0.2, 0.1])
    ball = vff.Obstacle.sphere(middle, 0.02)
    measured = vff.distances(carries, READY, np.zeros(7), [ball]).distance
    mujoco, model, data = in_mujoco(shape, place, turn, middle)
    apart = mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)
    np.testing.assert_allclose(measured, [apart], atol=1e-6)


def test_a_scenario_says_what_is_carried() -> None:
    """Named arms, joints one by one and files alike; the plant carries it too."""
    load = {"mass": 0.6, "shapes": [TRAY]}
    named = vff.Scenario.from_dict(SCENE | {"arm": {"model": "panda", "load": load}})
    again = vff.Scenario.from_dict(named.to_dict())
    listed = vff.Scenario.from_dict(SCENE | {"arm": PANDA.to_dict() | {"load": load}})
    read = vff.Scenario.from_dict(SCENE | {"arm": {"urdf": PANDA.to_urdf(), "load": load}})
    carries = PANDA.with_load(0.6, shapes=[TRAY])
    for scene in (named, again, listed, read):
        assert scene.arm.masses[-1] == pytest.approx(carries.masses[-1], abs=1e-9)
        assert len(scene.arm.collision) == len(PANDA.collision) + 1
        np.testing.assert_allclose(scene.plant.mass_matrix(READY), carries.mass_matrix(READY), atol=1e-6)
    result = vff.simulate(named, {"controller.avoidance": "null_space"})
    held = vff.simulate(SCENE | {"plant": {"payload": {"mass": 0.6}}}, {"controller.avoidance": "null_space"})
    assert (
        result.metrics["max_error_transient"] < 1e-6 < 1e-4 < held.metrics["max_error_transient"]
    )  # what it does not know of


def edge() -> Any:
    """The middle of an edge of the tray in the hand that is ready [m]."""
    tip, turn = PANDA.pose(READY)
    return tip + rotation(turn) @ [0.15, 0.0, 0.03]


def test_barriers_keep_the_load_away() -> None:
    """A ball comes at the edge of the tray, and past the bare hand."""
    place = edge()
    ball = vff.Obstacle.sphere(place + np.array([0.25, 0.0, 0.0]), 0.03, vff.Motion.linear([-0.15, 0.0, 0.0]))
    bare = vff.Scenario.from_dict(SCENE | {"obstacles": [ball]})
    load = {"mass": 0.6, "shapes": [TRAY]}
    far, near = vff.simulate(bare), vff.simulate(bare, {"arm.load": load})
    moved = [np.linalg.norm(run.x - run.x_ref, axis=1).max() for run in (far, near)]
    through = np.linalg.norm(np.asarray(far.obstacles)[:, 0] - place, axis=1).min()
    assert through < 0.02, "the ball goes through where the tray would be"
    assert moved[0] < 1e-3 and moved[1] > 0.02
    assert min(run.metrics["min_clearance"] for run in (far, near)) > 0.0


def test_plans_go_around_with_it() -> None:
    """Through a gate that the hand alone fits through."""
    goal = [0.9, *READY[1:]]
    at = np.array(PANDA.pose([0.45, *READY[1:]])[0])
    outward = np.array([np.cos(0.45), np.sin(0.45), 0.0])
    posts = [
        vff.Obstacle.capsule([*foot, 0.1], [*foot, 0.5], 0.02)
        for foot in ((at + side * outward)[:2] for side in (-0.13, 0.13))
    ]
    scene = vff.Scenario.from_dict(SCENE | {"obstacles": posts})
    tray = {"kind": "box", "size": [0.24, 0.24, 0.02], "center": [0.0, 0.0, 0.03]}
    loaded = scene.replace(**{"arm.load": {"mass": 0.5, "shapes": [tray]}})
    free, around = vff.plan(scene, goal), vff.plan(loaded, goal)
    assert (free.status, around.status) == ("found", "found")

    def nearest(arm: vff.Arm, plan: vff.Plan) -> float:
        q = plan.at(np.linspace(0.0, plan.duration, 400))[0]
        return float(vff.distances(arm, q, np.zeros_like(q), posts).distance.min())

    assert nearest(PANDA, free) > 0.0 and nearest(loaded.arm, around) > 0.0
    assert nearest(loaded.arm, free) < 0.0, "the tray would have hit a post"


def test_a_drive_takes_up_what_is_grasped(tmp_path: Path) -> None:
    """Another controller takes over, of an arm with one body more, and lets go of it again."""
    scene = vff.Scenario.from_dict(SCENE | {"duration": 6.0})
    settings = scene["controller"]
    bare, carries = (
        vff.Controller(PANDA, settings),
        vff.Controller(PANDA.with_load(0.4, shapes=[TRAY]), settings),
    )
    post = vff.Obstacle.sphere(edge() + np.array([0.06, 0.0, 0.0]), 0.03)
    with vff.drive(SimulatedRobot(scene), bare, obstacles=[post], seconds=3.0) as driven:
        for controller in (carries, bare):
            while driven.state.t < (1.0 if controller is carries else 2.0):
                assert not driven.wait(0.05)
            driven.set_controller(controller)
        assert driven.wait(HANG)
    assert driven.report.status == "completed", driven.report.reason


def test_plans_on_the_way_are_for_the_arm_that_there_is() -> None:
    """A tray is taken up while a plan is followed: what is planned from then on is for it, too."""
    posts = [vff.Obstacle.capsule([x, y, 0.1], [x, y, 0.5], 0.02) for x, y in ((0.16, 0.08), (0.39, 0.19))]
    tray = {"kind": "box", "size": [0.24, 0.24, 0.02], "center": [0.0, 0.0, 0.03]}
    goal = [0.9, *READY[1:]]
    scene = vff.Scenario.from_dict(
        SCENE
        | {
            "duration": 12.0,
            "obstacles": posts,
            "controller": SCENE["controller"] | {"null_damping": 8.0, "posture": READY},
        }
    )
    plan = vff.plan(scene, goal)
    followed = scene.replace(reference=plan.reference, replan={}, **{"controller.posture_stiffness": 50.0})
    carries = PANDA.with_load(0.5, shapes=[tray])
    with vff.drive(SimulatedRobot(followed), followed, seconds=12.0) as driven:
        driven.wait(0.2)
        driven.set_controller(vff.Controller(carries, followed["controller"]))
        assert driven.wait(HANG)
        q = driven.state.q
    assert driven.report.status == "completed", driven.report.reason
    reasons = [search.reason for search in driven.report.replans]
    assert reasons.count("blocked") >= 1 and len(reasons) <= 3, reasons
    assert np.linalg.norm(PANDA.pose(q)[0] - PANDA.pose(goal)[0]) < 0.02  # of `replan.tolerance`


def test_a_scenario_says_which_law_takes_over() -> None:
    """Along a plan, whose settings are of no controller without one: `panda-shelf` with a load."""
    shelf = vff.Scenario.load("panda-shelf")
    carries = shelf.replace(**{"arm.load": {"mass": 0.4, "shapes": [TRAY | {"size": [0.1, 0.1, 0.02]}]}})
    with pytest.raises(ScenarioError, match="posture_stiffness"):
        vff.Controller(carries.arm, carries["controller"])
    with vff.drive(SimulatedRobot(shelf), shelf, seconds=2.0) as driven:
        driven.wait(0.5)
        driven.set_controller(carries, blend=0.3)
        assert driven.wait(HANG)
    assert driven.report.status == "completed", driven.report.reason


def test_an_emulated_robot_has_to_be_told() -> None:
    """Of what the arm of a scenario carries, and from the flange, wherever the tool ends."""
    shapes = [{"kind": "box", "size": [0.2, 0.2, 0.04], "center": [0.0, 0.0, 0.05]}]
    scene = vff.Scenario.load("panda-sweep").replace(
        obstacles=[], **{"arm.load": {"mass": 1.0, "shapes": shapes}}
    )
    franka = emulated.franka.Robot(scene)
    untold = np.abs(franka.body.weight() - franka.body.known.gravity_torque(franka.body.q)).max()
    turn = frame(PANDA.to_dict()["tool"])[:3, :3]
    inertia = turn @ np.diag([0.04 + 0.0016, 0.04 + 0.0016, 0.08]) / 12 @ turn.T
    franka.set_load(1.0, [0.0, 0.0, 0.1034 + 0.05], inertia.ravel())
    told = np.abs(franka.body.weight() - franka.body.known.gravity_torque(franka.body.q)).max()
    assert untold > 3.0 and told < 1e-9
    franka.body.known = franka.body.loaded
    assert np.abs(franka.body.weight() - franka.body.known.gravity_torque(franka.body.q)).max() < 1e-9
    assert emulate(scene, seconds=0.3).fine
    longer = vff.Scenario.load("ur5e-sweep").replace(
        obstacles=[],
        q0=[0.0, -1.57, 1.57, 0.3, 1.57, 0.0],
        **{
            "arm.tool": {"position": [0.0, 0.0, 0.15]},
            "plant.payload": {"mass": 1.0, "com": [0.0, 0.0, 0.05]},
        },
    )
    ur = emulated.ur.Robot(longer)
    ur.setPayload(1.0, [0.0, 0.0, 0.20])
    np.testing.assert_allclose(ur.body.weight(), ur.body.known.gravity_torque(ur.body.q), atol=1e-9)


def test_cameras_do_not_see_what_is_carried() -> None:
    """The perceiver cuts it away with the arm."""
    camera = {
        "columns": 64, "rows": 48, "focal": [60, 60], "centre": [31.5, 23.5],
        "position": [0.31, 0.0, 1.5], "orientation": [0, 1, 0, 0],
    }  # fmt: skip
    place, _ = PANDA.pose(READY)
    high = {"kind": "box", "size": [0.4, 0.4, 0.02], "center": [0.0, 0.0, 0.03]}
    depth = np.full((48, 64), round(1000 * (1.5 - place[2] + 0.04)), dtype=np.uint16)
    seen = []
    for arm in (PANDA, PANDA.with_load(0.5, shapes=[high])):
        perceiver = vff.Perceiver(arm, [camera], {"stride": 1, "least_points": 1})
        perceiver.observe(0.0, READY, [0.0] * 7)
        perceiver.see(depth, t=0.0)
        points = perceiver.points
        under = np.abs(points[:, :2] - place[:2]).max(axis=1) < 0.18 if len(points) else np.zeros(0)
        seen.append(int(under.sum()))
    assert seen[0] > 20 and seen[1] == 0


def test_what_links_are_to_ignore_is_not_said_of_what_they_carry() -> None:
    """The bare hand never meets links that a tray goes through; another engine finds how deep."""
    arm = vff.Arm.named("xarm7")
    tray = {"kind": "box", "size": [0.4, 0.3, 0.02], "center": [0.0, 0.0, 0.03]}
    goal = [1.028, 1.367, 0.758, 1.864, 1.924, 2.516, -0.614]
    scene = {
        "duration": 1.0,
        "q0": goal,
        "reference": {"kind": "setpoint"},
        "controller": {"task": "pose", "self_collision": "avoid"},
    }
    bare = vff.plan({**scene, "arm": {"model": "xarm7"}, "q0": [0.0, 0.0, 0.0, 0.8, 0.0, 0.8, 0.0]}, goal)
    carries = vff.Scenario.from_dict({**scene, "arm": {"model": "xarm7", "load": {"shapes": [tray]}}})
    assert bare.status == "found"
    blocked = vff.plan(carries.replace(q0=[0.0, 0.0, 0.0, 0.8, 0.0, 0.8, 0.0]), goal)
    assert blocked.status == "goal blocked" and "link7" in blocked.message
    depth = vff.simulate(carries, {"controller.self_collision": "report"}).self_clearance[0]
    place, turn = arm.pose(goal)
    nearest = np.inf
    for link, shape in arm.collision:
        if link == "link5":
            at = arm.link_poses(goal)[arm.link_names.index(link)]
            ends = [
                at[:3, :3] @ np.array(shape.get(key, shape.get("center", [0] * 3))) + at[:3, 3]
                for key in "ab"
            ]
            mujoco, model, data = in_mujoco(tray, place, turn, [9.0] * 3, (ends, shape["radius"]))
            nearest = min(nearest, mujoco.mj_geomDistance(model, data, 1, 2, 1.0, None))
    assert depth < -0.05 and depth == pytest.approx(nearest, abs=2e-3)


@pytest.mark.parametrize(
    ("load", "says"),
    [
        ({"mass": -1.0}, r"load\.mass"),
        ({"mass": 1.0, "com": [0.0, 0.0, float("inf")]}, r"load\.com"),
        (
            {"mass": 1.0, "shapes": [{"kind": "box", "size": [0.1, 0.0, 0.1]}]},
            r"load\.shapes\[0\]\.size\[1\]",
        ),
        ({"shapes": [TRAY, {"kind": "half_space", "normal": [0, 0, 1]}]}, r"load\.shapes\[1\]\.kind"),
        ({"shapes": [{"kind": "sphere"}]}, "radius"),
        ({"inertia": [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]}, r"load\.mass"),
        ({"weight": 1.0}, "weight"),
    ],
)
def test_what_nobody_can_carry_is_refused(load: dict[str, Any], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        vff.Scenario.from_dict(SCENE | {"arm": {"model": "panda", "load": load}})


def test_with_load_names_what_is_wrong() -> None:
    with pytest.raises(InputError, match=r"shapes\[0\]\.radius"):
        PANDA.with_load(1.0, shapes=[{"kind": "sphere", "radius": -0.1}])
    for shapes, says in (
        (3, "shapes: expected a list"),
        (TRAY, "shapes: expected a list"),
        ([{}], r"shapes\[0\]"),
        ([TRAY, {"kind": "box", "size": [1, 1, 1], "position": [0, 0, 0]}], r"shapes\[1\].*position"),
    ):
        with pytest.raises(InputError, match=says) as raised:
            PANDA.with_load(1.0, shapes=shapes)  # type: ignore[arg-type]
        assert "\n" not in str(raised.value)
    with pytest.raises(InputError, match=r"shapes.*plane"):
        vff.Arm.uniform(3).with_load(1.0, shapes=[{"kind": "sphere", "radius": 0.1}])


def test_masses_of_the_plant_are_those_of_the_links() -> None:
    """What the last one carries is there beside them."""
    masses = [joint["mass"] for joint in PANDA.to_dict()["joints"]]
    scene = vff.Scenario.load("panda-sweep").replace(**{"arm.load": {"mass": 2.0}})
    loaded = scene.plant.mass_matrix(scene["q0"])
    again = scene.replace(**{"plant.masses": masses}).plant.mass_matrix(scene["q0"])
    np.testing.assert_allclose(again, loaded, atol=1e-12)
    heavier = scene.replace(**{"plant.masses": [2.0 * mass for mass in masses]}).plant
    total = sum(joint["mass"] for joint in heavier.to_dict()["joints"])
    assert total == pytest.approx(2.0 * sum(masses) + 2.0)
