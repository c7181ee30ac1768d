"""Pictures of runs in space: what is drawn is where the arm is, what is near covers what is behind."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import vffnull as vff
from vffnull.draw import geometry, style
from vffnull.draw.figures import animation, film, limits, null_space, render, space, tracking
from vffnull.draw.figures.rays import Solid
from vffnull.draw.figures.render import Canvas, Layer, rods, trace
from vffnull.draw.primitives import Axes, Body
from vffnull.draw.scene import Scene
from vffnull.evaluation.geometry.arm import rotation
from vffnull.live.scene.space import SpaceScene
from vffnull.model.arm import arm_of

FRONT = np.eye(3)  # right x, up y, towards the viewer z
GREY = np.full(3, 0.5)


@pytest.fixture(scope="module")
def result() -> vff.Result:
    return vff.simulate("panda-sweep", {"simulation.record_every": 200})


@pytest.fixture(scope="module")
def scene(result: vff.Result) -> Scene:
    return Scene.of_result(result)


# -------------------------------------------------------------------------------------------- what there is


def test_bodies_are_where_the_arm_is(result: vff.Result, scene: Scene) -> None:
    """Every capsule of the description, at the pose of its link, computed joint by joint."""
    document = vff._core.arm_model("panda")
    for row in (0, len(result.t) - 1):
        place, frames = np.eye(4), {document["base"]: np.eye(4)}
        for joint, angle in zip(document["joints"], result.q[row], strict=True):
            step, turn = np.eye(4), np.eye(4)
            step[:3, :3], step[:3, 3] = rotation(joint["orientation"]), joint["position"]
            half = angle / 2.0
            turn[:3, :3] = rotation([np.cos(half), *(np.sin(half) * np.array(joint["axis"]))])
            place = place @ step @ turn
            frames[joint["link"]] = place
        bodies = [each for each in scene.at(row, ["base", "link"]) if isinstance(each, Body)]
        assert len(bodies) == len(document["collision"])
        names = [document["base"], *(joint["link"] for joint in document["joints"])]
        for body, given in zip(
            sorted(bodies, key=lambda each: each.index),
            sorted(document["collision"], key=lambda each: names.index(each["link"])),
            strict=True,
        ):
            frame = frames[given["link"]]
            ends = np.array([given["shape"]["a"], given["shape"]["b"]]) @ frame[:3, :3].T + frame[:3, 3]
            np.testing.assert_allclose(body.corners, ends, rtol=0, atol=1e-13)
            assert body.radius == given["shape"]["radius"] and names[body.index + 1] == given["link"]


def test_the_tool_is_where_the_record_says(result: vff.Result, scene: Scene) -> None:
    (axes,) = scene.at(5, ["tool"])
    assert isinstance(axes, Axes) and result.orientation is not None
    np.testing.assert_allclose(axes.origin, result.x[5], rtol=0, atol=1e-14)
    np.testing.assert_allclose(axes.axes, rotation(result.orientation[5]), rtol=0, atol=1e-12)


def test_what_is_drawn_is_what_was_measured(result: vff.Result, scene: Scene) -> None:
    """The nearest points of bodies and ball lie as far apart as the recorded clearance."""
    ((core, radius),) = scene.cores
    for row in range(len(result.t)):
        least = np.full(7, np.inf)
        for part in scene.parts:
            if part.index < 0:
                continue
            a, b, ball = part.corners[row, 0], part.corners[row, -1], core[0] + scene.obstacles[row, 0]
            share = np.clip((ball - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            gap = float(np.linalg.norm(a + share * (b - a) - ball)) - radius - part.radius
            least[part.index] = min(least[part.index], gap)
        np.testing.assert_allclose(least, result.clearance[row], rtol=0, atol=1e-7)


def test_forces_push_away_from_the_obstacle(scene: Scene) -> None:
    points, forces = scene.pushes
    away = points - scene.obstacles[:, :1]
    size = np.linalg.norm(forces, axis=2)
    np.testing.assert_allclose(size, scene.strength, rtol=1e-9, atol=1e-12)
    pushed = size > 1e-6
    assert pushed.any() and np.all((away * forces).sum(axis=2)[pushed] > 0.0)


def test_obstacles_of_every_kind_are_drawn() -> None:
    half = np.sqrt(0.5)
    obstacles = [
        vff.Obstacle.half_space([0.0, 0.0, -0.5], [0.0, 0.0, 1.0]),
        vff.Obstacle.capsule([1.0, 0.0, 0.0], [1.0, 0.0, 0.4], 0.05),
        vff.Obstacle.box([1.2, 0.4, 0.3], [0.2, 0.4, 0.6], orientation=[half, 0.0, 0.0, half]),
    ]
    scenario = vff.Scenario.load("panda-sweep").replace(obstacles=obstacles, duration=0.02)
    floor, rod, box = Scene.of_result(vff.simulate(scenario)).at(0, ["obstacle"])
    assert isinstance(floor, Body) and isinstance(rod, Body) and isinstance(box, Body)
    np.testing.assert_allclose(floor.corners[:, 2], -0.5, atol=1e-12)
    np.testing.assert_allclose(floor.corners.mean(axis=0)[:2], 0.0, atol=1e-12)  # below the base
    np.testing.assert_allclose(rod.corners, [[1.0, 0.0, 0.0], [1.0, 0.0, 0.4]], atol=1e-12)
    low, high = box.corners.min(axis=0), box.corners.max(axis=0)
    np.testing.assert_allclose([low, high], [[1.0, 0.3, 0.0], [1.4, 0.5, 0.6]], atol=1e-12)


def test_a_link_without_shapes_is_a_thin_line() -> None:
    result = vff.simulate("panda-sweep", {"arm.collision": "none", "duration": 0.02})
    scene = Scene.of_result(result)
    assert sorted(part.index for part in scene.parts) == list(range(7))
    np.testing.assert_allclose(scene.parts[2].corners[0], scene.joints[0, 2:4], atol=1e-14)
    assert all(0.0 < part.radius < 0.05 for part in scene.parts)


def test_a_scenario_and_an_arm_alone() -> None:
    scenario = vff.Scenario.load("panda-sweep")
    scene = Scene.of_scenario(scenario)
    np.testing.assert_allclose(scene.joints[0], scenario.arm.forward_kinematics(scenario["q0"]), atol=1e-14)
    assert scene.obstacles.shape == (1, 1, 3) and scene.dimension == 3
    alone = Scene.of_postures(vff.Arm.named("ur5e"), np.full((1, 6), 0.1))
    assert alone.joints.shape == (1, 7, 3) and not alone.cores


# ------------------------------------------------------------------------------------------------ rendering


def dots(solid: Solid, half: float = 1.0, count: int = 201) -> tuple[Any, Any, Any]:
    xs = np.linspace(-half, half, count)
    colours, depths = trace([solid], FRONT, xs, xs)
    return xs, colours, depths


def test_a_ball_is_round() -> None:
    xs, _, depths = dots(Solid(np.array([[0.2, -0.1, 0.3]]), 0.4987, GREY))
    x, y = xs[None, :] - 0.2, xs[:, None] + 0.1
    inside = x**2 + y**2 < 0.4987**2
    np.testing.assert_array_equal(np.isfinite(depths), inside)
    np.testing.assert_allclose(depths[inside], 0.3 + np.sqrt(0.4987**2 - (x**2 + y**2)[inside]), atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.4, -0.7, 1.5, np.pi / 2])
def test_a_rod_has_its_surface_at_its_radius(tilt: float) -> None:
    """Every point that a ray meets is as far from the axis as the rod is thick, whatever way it leans."""
    direction = np.array([np.cos(tilt) * 0.6, np.cos(tilt) * 0.3, np.sin(tilt)])
    corners = np.array([-0.4 * direction, 0.4 * direction])
    xs, _, depths = dots(Solid(corners, 0.15, GREY))
    rows, columns = np.nonzero(np.isfinite(depths))
    points = np.stack([xs[columns], xs[rows], depths[rows, columns]], axis=1)
    along = corners[1] - corners[0]
    share = np.clip((points - corners[0]) @ along / (along @ along), 0.0, 1.0)
    away = np.linalg.norm(points - corners[0] - share[:, None] * along, axis=1)
    np.testing.assert_allclose(away, 0.15, rtol=0, atol=1e-9)
    flat = geometry.outline(corners, 0.15, FRONT[:2])
    area = 0.5 * abs(np.sum(flat[:, 0] * np.roll(flat[:, 1], -1) - flat[:, 1] * np.roll(flat[:, 0], -1)))
    assert len(rows) * (xs[1] - xs[0]) ** 2 == pytest.approx(area, rel=0.02)


def test_a_box_has_its_nearest_face_in_front() -> None:
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    xs, _, depths = dots(Solid(bits * [0.6, 0.4, 0.5] - [0.3, 0.2, 0.25], 0.0, GREY))
    inside = (np.abs(xs[None, :]) < 0.3 - 1e-9) & (np.abs(xs[:, None]) < 0.2 - 1e-9)
    np.testing.assert_allclose(depths[inside], 0.25, atol=1e-12)
    assert not np.isfinite(depths[np.abs(xs) > 0.21][:, np.abs(xs) > 0.31]).any()


def test_what_is_near_covers_what_is_behind() -> None:
    """Whatever the order in which they are given; a faint layer lets others shine through."""
    red, blue = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    near = Solid(np.array([[0.0, 0.0, 1.0]]), 0.3, red)
    far = Solid(np.array([[0.0, 0.0, -1.0]]), 0.6, blue)
    canvas = Canvas.around([Layer([near, far])], FRONT[:2], 0.02)
    middle = tuple(size // 2 for size in canvas.shape)
    for layers in ([Layer([near, far])], [Layer([far]), Layer([near])], [Layer([near]), Layer([far])]):
        picture = canvas.draw(layers)
        assert picture[middle][0] > 150 and picture[middle][2] < 90 and picture[middle][3] == 255
    seen_through = canvas.draw([Layer([near], 0.3), Layer([far])])[middle]
    assert seen_through[2] > seen_through[0] > 20
    assert canvas.draw([Layer([far])])[0, 0, 3] == 0  # beside it there is nothing


def test_a_floor_hides_what_is_below_and_bears_a_shadow() -> None:
    view = geometry.view_of(3)
    ball = Solid(np.array([[0.0, 0.0, 0.5]]), 0.2, GREY)
    sunk = Solid(np.array([[0.0, 0.0, -0.05]]), 0.2, GREY)
    layers = [Layer([ball], floor=0.0)]
    canvas = Canvas.around(layers, view, 0.01)
    picture = canvas.draw(layers)
    below = geometry.seen(np.array([0.0, 0.0, 0.0]), view)
    column, row = ((below - canvas.low) / canvas.dot).astype(int)
    assert 0 < picture[row, column, 3] < 255  # grey and faint
    whole = Canvas.around([Layer([sunk])], view, 0.01).draw([Layer([sunk])])
    cut = Canvas.around([Layer([sunk])], view, 0.01).draw([Layer([sunk], floor=0.0)])
    assert 0.2 < (cut[..., 3] == 255).sum() / (whole[..., 3] == 255).sum() < 0.95


def test_bodies_are_cut_off_at_a_box() -> None:
    """Where a ray meets nothing within the box there is nothing; the rest stays as it is."""
    rod = Solid(np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), 0.2, GREY)
    box = (np.array([-0.5, -1.0, -1.0]), np.array([0.5, 1.0, 1.0]))
    canvas = Canvas.around([Layer([rod])], FRONT[:2], 0.01)
    whole, cut = canvas.draw([Layer([rod])]), canvas.draw([Layer([rod], box=box)])
    columns = canvas.low[0] + canvas.dot * (np.arange(canvas.shape[1]) + 0.5)
    inside = np.abs(columns) < 0.49
    np.testing.assert_array_equal(cut[:, inside], whole[:, inside])
    assert not cut[:, np.abs(columns) > 0.51, 3].any() and whole[:, np.abs(columns) > 0.51, 3].any()


@pytest.mark.parametrize("dot", [0.002, 0.006, 0.02])
def test_a_ray_where_nothing_ends_is_as_good_as_four(scene: Scene, dot: float) -> None:
    """Few dots differ from the mean of all rays, edges and lines thinner than a dot included."""
    row = len(scene.t) // 2
    ends = np.array([[-0.5, 0.1, 1.0], [0.5, 0.8, 1.0]])
    lines = [*space.path_layers(scene, row, 0.005 * scene.reach), Layer([Solid(ends, 0.2 * dot, GREY)])]
    shell = Layer([Solid(scene.obstacles[row, :1], 0.3, GREY)], 0.1)
    layers = [*space.layers_at(scene, row), *lines, shell]
    canvas = Canvas.around(layers, FRONT[:2], dot)
    fine = Canvas(canvas.view, canvas.low, dot / 2.0, (2 * canvas.shape[0], 2 * canvas.shape[1]))
    every = render.Grid(*(fine.low[i] + fine.dot * (np.arange(fine.shape[1 - i]) + 0.5) for i in (0, 1)))
    rays, _ = render._seen(layers, FRONT, every)
    wanted = rays.reshape(canvas.shape[0], 2, canvas.shape[1], 2, 4).mean(axis=(1, 3))
    found = canvas.draw(layers) / 255.0
    found[..., :3] *= found[..., 3:]
    off = np.abs(found - wanted).max(axis=-1)[wanted[..., 3] > 0.0]
    assert off.mean() < 0.004 and (off > 0.04).mean() < 0.004


def test_lines_are_rods() -> None:
    points = np.stack([np.linspace(0, 1, 500), np.zeros(500), np.zeros(500)], axis=1)
    whole, dashed = rods(points, 0.01, GREY), rods(points, 0.01, GREY, dashed=True)
    assert sum(float(np.ptp(each.corners[:, 0])) for each in whole) == pytest.approx(1.0)
    assert sum(float(np.ptp(each.corners[:, 0])) for each in dashed) == pytest.approx(0.5, abs=0.05)
    assert rods(points[:1].repeat(5, axis=0), 0.01, GREY) == []


def test_bodies_are_put_where_the_axes_are(scene: Scene) -> None:
    """In three dimensions the traced bodies and Matplotlib's own projection agree, and scales are equal."""
    from mpl_toolkits.mplot3d import proj3d  # type: ignore[import-untyped]

    from vffnull.draw import style

    with style.look():
        figure = style.figure(4.0, 4.0)
        figure.set_layout_engine("none")
        ax = space.stage(figure, scene, (0.0, 0.0, 1.0, 1.0))
    view, scale, origin = space.view_of(ax)
    np.testing.assert_allclose(view @ view.T, np.eye(2), atol=1e-12)
    place = np.array([0.2, -0.1, 0.4])
    x, y, _ = proj3d.proj_transform(*place, ax.get_proj())
    np.testing.assert_allclose(origin + scale * (view @ place), [x, y], atol=1e-12)


# -------------------------------------------------------------------------------------------- whole pictures


def test_figures(result: vff.Result, tmp_path: Path) -> None:
    """Every figure of a run in space, as files, with more than one colour in them."""
    paths = vff.simulate("panda-sweep", {"duration": 0.3, "simulation.record_every": 30}).plot(tmp_path)
    names = {Path(path).stem for path in paths}
    expected = {"overview", "strobe", "tracking", "tracking_error", "joint_angles", "clearance"}
    assert expected | {"joint_torques", "limits", "null_space"} <= names
    for path in paths:
        with Image.open(path) as image:
            colours = image.convert("RGB").getcolors(1 << 20)
        assert colours is not None and len(colours) > 20, path


@pytest.mark.parametrize("task", ["position", "pointing"])
def test_figures_of_other_tasks(task: str) -> None:
    figures = vff.simulate("panda-sweep", {"duration": 0.1, "controller.task": task}).plot()
    assert isinstance(figures, dict)
    labels = [ax.get_ylabel() for ax in figures["tracking_error"].axes]
    assert any("rad" in label for label in labels) == (task == "pointing")
    assert len(figures["tracking"].axes) == (3 if task == "position" else 4)


def test_the_strobe_picture_has_three_aligned_projections(result: vff.Result) -> None:
    """To one scale on paper, as in a technical drawing: x below x, z beside z."""
    figures = result.plot()
    assert isinstance(figures, dict)
    figure = figures["strobe"]
    front, side, top = (ax for ax in figure.axes if ax.name == "rectilinear")
    wide, high = figure.get_size_inches()
    for ax in (front, side, top):
        place = ax.get_position()
        (left, right), (bottom, upper) = ax.get_xlim(), ax.get_ylim()
        across, upwards = place.width * wide / (right - left), place.height * high / (upper - bottom)
        assert across == pytest.approx(upwards, rel=1e-9)
        assert across == pytest.approx(front.get_position().width * wide / np.ptp(front.get_xlim()), rel=1e-9)
    assert (
        front.get_position().x0 == pytest.approx(top.get_position().x0) and front.get_xlim() == top.get_xlim()
    )
    assert front.get_position().y0 == pytest.approx(side.get_position().y0)
    assert front.get_ylim() == side.get_ylim() and side.get_xlim() == top.get_ylim()
    labels = [ax.get_xlabel() + ax.get_ylabel() for ax in (front, side, top)]
    assert labels == ["$x$ [m]$z$ [m]", "$y$ [m]$z$ [m]", "$x$ [m]$y$ [m]"]
    (key,) = figure.legends
    said = [text.get_text() for text in key.get_texts()]
    assert said[0] == "$t$ = 0.0" and said[4] == "6.0 s" and "obstacle" in said
    # Nothing lies on anything else.
    boxes = [ax.get_tightbbox() for ax in (front, side, top)] + [key.get_window_extent()]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_axes_of_a_tall_scene_are_named(tmp_path: Path) -> None:
    """Their names are within the picture, on each side."""
    tall = vff.simulate("panda-lean", {"duration": 0.02, "wrenches": None})
    figures = tall.plot()
    assert isinstance(figures, dict)
    for name in ("overview", "strobe"):
        figure = figures[name]
        figure.savefig(tmp_path / "tall.png")
        deep: Any = next(ax for ax in _all_axes(figure) if hasattr(ax, "zaxis"))
        for axis in (deep.xaxis, deep.yaxis, deep.zaxis):
            box = axis.label.get_window_extent()
            assert box.x0 > 0 and box.y0 > 0 and box.x1 < figure.bbox.x1 and box.y1 < figure.bbox.y1, name


def _all_axes(figure: Any) -> list[Any]:
    """Of a figure and of its parts."""
    return [*figure.axes, *(ax for part in figure.subfigs for ax in part.axes)]


def test_what_sensors_see_in_space_has_no_axes_and_is_there_whole() -> None:
    """A picture from a corner has nothing to be read along its edges; the person's arm is within it."""
    watched = vff.simulate("panda-watched", {"duration": 0.05})
    figures = watched.plot()
    assert isinstance(figures, dict)
    ax = figures["sensed"].axes[0]
    assert not ax.axison
    scene = Scene.of_result(watched)
    low, high = np.transpose([ax.get_xlim(), ax.get_ylim()])
    for index in range(2):
        (body,) = [each for each in scene.at(0, ["obstacle"]) if getattr(each, "index", None) == index]
        assert isinstance(body, Body)
        assert (body.outline() > low).all() and (body.outline() < high).all()


def test_paths_of_obstacles_and_of_the_reference_are_told_apart() -> None:
    scene = Scene.of_result(vff.simulate("iiwa-line", {"duration": 0.5}))
    colours = {line.get_label(): line.get_color() for line in space.key(scene)}
    assert len({colours[name] for name in ("obstacle", "reference", "tip")}) == 3


def test_limits_are_shares_with_what_is_left(result: vff.Result) -> None:
    """At −1 and 1 a joint is at its limits; the nearest is named, in its own unit."""
    angle, _, torque = limits.uses(result)
    low, high = np.array(result.scenario.arm.joint_limits).T
    np.testing.assert_allclose(angle.shares(1), -1 + 2 * (result.q[:, 1] - low[1]) / (high[1] - low[1]))
    most = np.asarray(result.scenario.arm.torque_limits)
    np.testing.assert_allclose(torque.shares(3), result.tau[:, 3] / most[3], rtol=1e-14)
    left = np.minimum(result.q - low, high - result.q).min(axis=0)
    joint, there = angle.nearest()
    assert joint == np.abs(2 * (result.q - low) / (high - low) - 1).max(axis=0).argmax()
    assert there == pytest.approx(left[joint])
    figures = result.plot()
    assert isinstance(figures, dict)
    axes = figures["limits"].axes
    assert [ax.get_ylabel() for ax in axes] == ["joint angle", "joint speed", "joint torque"]
    assert f"joint {joint}: {1e3 * there:.3g} mrad left" in [text.get_text() for text in axes[0].texts]
    assert all(len(ax.get_lines()) == 9 for ax in axes)  # seven joints and two limits


def test_limits_that_are_broken_or_missing(result: vff.Result) -> None:
    """A panel goes as far as the joint does; no limits, no line; an arm without any has no figure."""
    q = result.q.copy()
    q[3, 2] = 3.5  # rad; the limit is 2.8973
    broken = dataclasses.replace(result, q=q)
    joint, left = limits.uses(broken)[0].nearest()
    assert joint == 2 and left == pytest.approx(2.8973 - 3.5)
    axes = limits.limits(broken).axes
    assert axes[0].get_ylim()[1] > 3.5 / 2.8973 and "603 mrad beyond" in axes[0].texts[0].get_text()
    tau = result.tau.copy()
    tau[3, 1] = result.scenario.arm.torque_limits[1] * (1.0 + 1e-15)
    axes = limits.limits(dataclasses.replace(result, tau=tau)).axes
    assert axes[2].texts[0].get_text() == "joint 1: at its limit"
    endless = vff.simulate("gen3-circle", {"duration": 0.01})
    assert limits.uses(endless)[0].joints == [1, 3, 5]
    figures = vff.simulate("paper-1", {"duration": 0.01}).plot()
    assert isinstance(figures, dict) and "limits" not in figures


@pytest.mark.parametrize("task", ["position", "pointing", "pose"])
def test_null_motion_leaves_the_task_alone(task: str) -> None:
    """N q̇ with the law's own projector; the rest of the motion, and no more, is what the task sees."""
    line = {"kind": "line", "end": [0.05, 0.1, 0.0], "relative": True, "duration": 0.3}
    overrides = {"duration": 0.3, "controller.task": task, "simulation.record_every": 50, "reference": line}
    result = vff.simulate("panda-sweep", overrides)
    speeds, energies = null_space.motion(result)
    arm = result.scenario.arm
    controller = vff.Controller(arm, vff.ControlSettings(task=task))
    assert result.orientation_ref is not None or task == "position"
    for row in (2, 6):
        q, dq = result.q[row], result.dq[row]
        x_ref: Any = result.x_ref[row]
        if result.orientation_ref is not None:
            x_ref = (x_ref, result.orientation_ref[row])
        N = np.asarray(controller.terms(q, dq, x_ref=x_ref).N)
        np.testing.assert_allclose(speeds[row], N @ dq, rtol=0, atol=1e-10)
        M = arm.mass_matrix(q)
        rest = dq - speeds[row]
        assert energies[row] + rest @ M @ rest / 2 == pytest.approx(result.energy[row, 0], rel=1e-9)
    seen = np.abs(arm.jacobian(result.q[-1])[:3] @ speeds[-1]).max()
    assert seen < 1e-12 < np.abs(result.dx[-2]).max()


def test_null_motion_in_the_plane_and_where_there_is_none() -> None:
    """A planar pose also turns; an arm that its task takes up altogether has no null space to show."""
    pose = {"controller.task": "pose", "reference": {"kind": "setpoint", "point": [4.0, 1.0, 0.3]}}
    result = vff.simulate("sweep-through", {"duration": 0.2, "simulation.record_every": 100, **pose})
    speeds, _ = null_space.motion(result)
    for q, speed in zip(result.q, speeds, strict=True):
        np.testing.assert_allclose([*(result.scenario.arm.jacobian(q) @ speed), speed.sum()], 0.0, atol=1e-12)
    assert np.abs(speeds).max() > 1e-3
    full = {"duration": 0.01, "controller.task": "pose", "reference": {"kind": "setpoint"}}
    figures = vff.simulate("ur5e-sweep", full).plot()
    assert isinstance(figures, dict) and "null_space" not in figures


def test_rotation_vectors_do_not_jump() -> None:
    """Beyond a half turn, through a whole one and back through none; each is a vector of its rotation."""
    axis = np.array([0.48, 0.6, 0.64])
    angles = np.concatenate([np.linspace(0.0, 8.0, 60), np.linspace(8.0, -4.0, 90)])
    turns = rotation(np.column_stack([np.cos(angles / 2), np.sin(angles / 2)[:, None] * axis]))
    np.testing.assert_allclose(tracking.rotation_vectors(turns), angles[:, None] * axis, rtol=0, atol=1e-9)


def test_orientation_is_tracked_beside_its_reference() -> None:
    """A pose as a rotation since the start, pointing as the direction of the tool's axis."""
    line = vff.simulate("iiwa-line", {"simulation.record_every": 500})
    figures = line.plot()
    assert isinstance(figures, dict)
    ax = figures["tracking"].axes[-1]
    assert ax.get_ylabel() == "rotation [rad]"
    assert line.orientation is not None and line.orientation_ref is not None
    between = rotation(line.orientation[-1]) @ rotation(line.orientation_ref[0]).T
    vector = np.array([each.get_ydata()[-1] for each in ax.get_lines()[::2]])
    angle = float(np.linalg.norm(vector))
    assert np.trace(between) == pytest.approx(1 + 2 * np.cos(angle), abs=1e-9) and angle > 0.5
    np.testing.assert_allclose(between @ vector, vector, atol=1e-9)
    figures = vff.simulate("panda-pointing", {"duration": 0.1}).plot()
    assert isinstance(figures, dict)
    ax = figures["tracking"].axes[-1]
    assert ax.get_ylabel() == "tool axis [–]"
    axis = [each.get_ydata()[0] for each in ax.get_lines()[::2]]
    assert np.linalg.norm(axis) == pytest.approx(1.0, abs=1e-12)


def test_film(result: vff.Result, tmp_path: Path) -> None:
    path = result.animate(tmp_path / "run.gif", fps=1)
    frames = []
    with Image.open(path) as film:
        assert getattr(film, "n_frames", 0) == 7  # 6 s
        for i in (0, 4):
            film.seek(i)
            frames.append(np.asarray(film.convert("RGB"), dtype=int))
    assert (np.abs(frames[0] - frames[1]).sum(axis=2) > 60).mean() > 0.02


def test_a_film_shows_how_near_it_is(result: vff.Result, scene: Scene) -> None:
    """Links turn from grey to orange as the ball comes near, the ball stays dark and is where it belongs;
    words say the clearance and the error; the course of the clearance grows."""
    rows = np.array([0, 15])
    with style.look():
        picture = film.SpacePicture(result, scene, rows, 1.0)
        frames = [picture.at(i).astype(int) for i in range(2)]
        words = [text.get_text() for text in picture._texts]
    least = result.clearance[15].min()
    assert words[0].startswith(f"t = {result.t[15]:.2f} s")
    assert words[1] == f"clearance {1e3 * least:.0f} mm" and " µm" in words[2]
    (course, now) = picture._course
    assert len(course.get_xdata()) == 16 and now.get_ydata()[0] == least  # type: ignore[attr-defined]

    def warm(frame: Any) -> float:
        """The share of orange dots."""
        red, green, blue = np.moveaxis(frame, 2, 0)
        return float(((red > green + 50) & (green > blue + 20)).mean())

    assert warm(frames[1]) > 0.02 > 0.002 > warm(frames[0])
    canvas, height = picture._canvas, frames[0].shape[0]
    bottom = round(picture._axes.bbox.y0)
    for row, frame in zip(rows, frames, strict=True):
        x, y = (canvas.view @ scene.obstacles[row, 0] - canvas.low) / canvas.dot
        dark = frame[
            height - 1 - bottom - int(y) - 3 : height - 1 - bottom - int(y) + 3, int(x) - 3 : int(x) + 3
        ]
        assert dark.mean() < 90


def test_a_gif_keeps_shades_and_white(result: vff.Result, scene: Scene, tmp_path: Path) -> None:
    """256 colours and a pattern that stands still: smooth shades stay so, white is white."""
    path = result.animate(tmp_path / "run.gif", fps=1, speed=6.0)
    rows = animation.frames(result, 1, 6.0)
    with style.look():
        picture = film.SpacePicture(result, scene, rows, 6.0)
        drawn = picture.at(1).astype(float)
    with Image.open(path) as made:
        made.seek(1)
        shown = np.asarray(made.convert("RGB"), dtype=float)
    white = (drawn == 255).all(axis=2)
    assert (shown[white] == 255).all()
    away = np.abs(shown - drawn)[~white]
    assert away.mean() < 4.0
    tall, wide = (size // 8 * 8 for size in drawn.shape[:2])

    def smooth(dots: Any) -> Any:
        """Means of squares of 8 by 8 dots, in which the pattern vanishes."""
        return dots[:tall, :wide].reshape(tall // 8, 8, wide // 8, 8, 3).mean(axis=(1, 3))

    assert np.abs(smooth(shown) - smooth(drawn)).max() < 8.0
    np.testing.assert_allclose(animation._BAYER.mean(), 0.0, atol=1e-12)


def test_a_film_without_obstacles(tmp_path: Path) -> None:
    quiet = vff.simulate("panda-sweep", {"obstacles": [], "duration": 0.1, "simulation.record_every": 50})
    quiet.animate(tmp_path / "run.gif", fps=10)
    with Image.open(tmp_path / "run.gif") as film_:
        assert film_.height < film_.width  # no room for a clearance that there is not


def test_colours_say_the_clearance() -> None:
    ends = [style.by_clearance(share) * 255 for share in (-1.0, 0.5, 1.0, np.inf, np.nan)]
    for found, wanted in zip(ends, [style.CONTACT, style.NEAR, *[style.FREE] * 3], strict=True):
        np.testing.assert_allclose(found, wanted)
    np.testing.assert_allclose(style.by_clearance(0.25) * 255, np.add(style.CONTACT, style.NEAR) / 2)


def test_comparison(result: vff.Result, tmp_path: Path) -> None:
    other = vff.simulate("panda-sweep", {"controller.field.gain": 40.0, "simulation.record_every": 200})
    page = vff.compare({"strong": result, "weak": other}, tmp_path / "both.html")
    assert page.stat().st_size > 100_000


@pytest.mark.parametrize("name", ["panda", "gen3"])
def test_an_arm_shows_its_capsules(name: str) -> None:
    """Also one whose joints have no ends, and without a word of NumPy."""
    arm = vff.Arm.named(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = arm._repr_html_()
    assert text.count("<polygon") >= len(arm.collision) and name in text and "nan" not in text


def test_notebooks(result: vff.Result) -> None:
    for shown in (result, result.scenario):
        text = shown._repr_html_()
        assert text.count("<polygon") >= 20 and "panda-sweep" in text


def test_a_pedestal_stands_on_the_floor() -> None:
    """The floor of figures, films and pages is where the base ends, not where the first joint is mounted."""
    from vffnull.draw.figures.space import floor_of

    arm = vff.Arm.named("panda").to_dict()
    plain = vff.Scenario.load("panda-sweep").replace(arm=arm)
    assert Scene.of_scenario(plain).foot == floor_of(Scene.of_scenario(plain)) == 0.0
    column = {"kind": "capsule", "a": [0.0, 0.0, -0.9], "b": [0.0, 0.0, -0.2], "radius": 0.1}
    arm["collision"] = [*arm["collision"], {"link": arm["base"], "shape": column}]
    scene = Scene.of_scenario(plain.replace(arm=arm))
    assert scene.foot == floor_of(scene) == pytest.approx(-1.0)


def test_an_arm_is_not_looked_for_behind_its_own_pedestal() -> None:
    """One that stands beside a body, as of a robot with two arms: behind it, seen from the usual corner."""
    document = vff.Arm.named("panda").to_dict()
    body = {"kind": "capsule", "a": [0.25, -0.3, 0.0], "b": [0.25, -0.3, 1.4], "radius": 0.25}
    for place, turn in ((body, 90.0), (body | {"a": [-0.5, 0.4, 0.0], "b": [-0.5, 0.4, 1.4]}, 0.0)):
        made = document | {"collision": [*document["collision"], {"link": document["base"], "shape": place}]}
        scene = Scene.of_arm(arm_of(made), [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
        assert scene.next_corner == turn


def test_bundled_scenes_are_seen_from_the_usual_corner() -> None:
    """So that figures of one are beside those of another."""
    scenes = [Scene.of_scenario(vff.Scenario.load(name)) for name in vff.scenarios()]
    assert {scene.next_corner for scene in scenes} == {0.0}


@pytest.mark.parametrize("turn", [0.0, 0.8, 1.6, 2.4, 3.1, 4.0, 5.0])
def test_no_arm_is_seen_end_on_unless_asked_for(turn: float, tmp_path: Path) -> None:
    """Wherever it reaches, figures, films, reports and the live page show it from where it is not short."""
    usual = vff.Scenario.load("panda-sweep")
    q0 = [turn - 6.2832 if turn > 2.8 else turn, *usual["q0"][1:]]
    q0[0] = float(np.clip(q0[0], -2.8, 2.8))
    made = usual.replace(q0=q0, duration=0.02, obstacles=[])
    scene = Scene.of_scenario(made)
    joints = scene.joints[0] - scene.joints[0, 0]
    reach = float(np.ptp(np.linalg.norm(joints[:, :2], axis=1)))

    def width(azimuth: float) -> float:
        return float(np.ptp(joints @ geometry.looking(azimuth, 0.0)[0]))

    drawn = space.stage(style.figure(4.0), scene, (0.0, 0.0, 1.0, 1.0))
    assert width(drawn.azim) > 0.35 * reach
    assert drawn.azim == space.AZIMUTH + scene.next_corner
    page = SpaceScene.__new__(SpaceScene)
    page._still, page._view, page._floor, page.reach = scene, "", 0.0, scene.reach
    low, high = space.bounds(scene)
    seen = page.camera((low[0], high[0], low[1], high[1], low[2], high[2]), 1.0)
    away = np.asarray(seen.position) - np.asarray(seen.look_at)
    assert width(np.degrees(np.arctan2(away[1], away[0]))) > 0.35 * reach
