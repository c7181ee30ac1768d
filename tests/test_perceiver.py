"""The perceiver in Python: pictures of every kind, what it refuses, and what MuJoCo's renderer shows it."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import threading
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, VffNullError

ARM = vff.Arm.named("panda")
AWAY = [0.0, -1.5, 0.0, -2.8, 0.0, 1.6, 0.8]
STILL = [0.0] * 7
FROM = [0.5, 0.0, 1.6]
CAMERA: dict[str, Any] = {
    "columns": 320,
    "rows": 240,
    "focal": [280.0, 280.0],
    "centre": [159.5, 119.5],
    "position": FROM,
    "orientation": [0.0, 1.0, 0.0, 0.0],  # straight down
}
TABLE = vff.Obstacle.half_space([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
MOVES = vff.Obstacle.sphere([0.5, 0.0, 0.3], 0.1, motion=vff.Motion.linear([0.1, 0.0, 0.0]))
PERIOD = 1.0 / 30.0


def picture(balls: list[tuple[Any, float]]) -> np.ndarray:
    """Depths [m] of a table at z = 0 and of balls, by a ray caster that is nothing but these lines."""
    columns, rows = np.meshgrid(np.arange(320) - 159.5, np.arange(240) - 119.5)
    rays = np.stack([columns / 280.0, -rows / 280.0, -np.ones_like(rows)], axis=-1)
    depth = np.full(rows.shape, FROM[2])
    square = (rays * rays).sum(axis=-1)
    for centre, radius in balls:
        off = np.array(FROM) - centre
        b = rays @ off
        root = b * b - square * (off @ off - radius * radius)
        hit = (-b - np.sqrt(np.maximum(root, 0.0))) / square
        depth = np.where((root > 0.0) & (hit > 0.0), np.minimum(depth, hit), depth)
    return depth


def perceiver(**settings: Any) -> vff.Perceiver:
    made = vff.Perceiver(ARM, [CAMERA], settings, known=[TABLE])
    made.observe(0.0, AWAY, STILL)
    return made


def test_pictures_of_every_kind() -> None:
    """Whole millimetres, and metres in whatever numbers and order, make the same cloud."""
    depth = picture([([0.5, 0.1, 0.3], 0.0803)])
    millimetres = np.round(1000.0 * depth).astype(np.uint16)
    clouds = []
    for given in (
        millimetres,
        np.asfortranarray(millimetres),
        millimetres.astype(">u2"),
        (millimetres * np.float32(1e-3)).astype(np.float32),
        millimetres * 1e-3,
    ):
        made = perceiver()
        counts = made.see(given, 0.0)
        assert counts["measured"] == 160 * 120
        clouds.append(made.points)
        assert made.velocities.shape == made.points.shape and not made.velocities.any()
        assert made.t == 0.0 and repr(made) == f"<Perceiver: 1 cameras, {len(made.points)} points>"
    assert len(clouds[0]) > 30
    for cloud in clouds[1:3]:
        np.testing.assert_array_equal(cloud, clouds[0])
    for cloud in clouds[3:]:
        assert abs(len(cloud) - len(clouds[0])) < 0.1 * len(cloud)  # rounding at borders of cells
    off = np.linalg.norm(clouds[0] - [0.5, 0.1, 0.3], axis=1) - 0.0803
    assert np.abs(off).max() < 0.01


def test_a_ball_is_followed() -> None:
    """8 cm at 0.5 m/s: known to a tenth after four pictures, and handed to the law as it is."""
    made, velocity = perceiver(), np.array([0.3, 0.4, 0.0])
    for k in range(4):
        t = k * PERIOD
        if k:
            made.observe(t, AWAY, STILL)
        made.see(picture([(np.array([0.4, -0.1, 0.4]) + velocity * t, 0.04)]), t)
    (track,) = made.tracks
    assert track["moves"] and track["seen"] == 4 and track["t"] == pytest.approx(3 * PERIOD)
    assert np.linalg.norm(track["velocity"] - velocity) < 0.1 * 0.5
    goes_on = (made.velocities == track["velocity"]).all(axis=1)
    assert goes_on.mean() > 0.6  # all but cells at its rim, which were hit one picture earlier
    cloud = [vff.Obstacle.points(np.empty((0, 3)), made.radius)]
    law = vff.Controller(ARM, {"avoidance": "cbf"})
    law.torque(AWAY, STILL, [0.3, 0.0, 0.5], obstacles=cloud)
    points, velocities, t = made.cloud
    np.testing.assert_array_equal(points, made.points)
    np.testing.assert_array_equal(velocities, made.velocities)
    law.update_points(points, velocities=velocities, t=t)
    found = law.terms(AWAY, STILL, [0.3, 0.0, 0.5], obstacles=cloud, t=0.8)
    gone = made.points + made.velocities * (0.8 - 3 * PERIOD)
    there = [vff.Obstacle.points(gone, made.radius)]
    expected = vff.Controller(ARM, {"avoidance": "cbf"}).terms(AWAY, STILL, [0.3, 0.0, 0.5], obstacles=there)
    np.testing.assert_allclose(found.clearance, expected.clearance, atol=1e-12)


def test_one_wrong_time_ends_nothing() -> None:
    """A state from the far future is dropped by the next one; a clock that truly leaps is followed."""
    made = perceiver()
    made.observe(1e6, AWAY, STILL)
    for k in range(1, 30):
        made.observe(0.01 * k, AWAY, STILL)
    assert made.see(picture([]), 0.28)["measured"]
    for k in range(30):
        made.observe(1e3 + 0.01 * k, AWAY, STILL)
    assert made.see(picture([]), 1e3 + 0.2)["measured"]
    with pytest.raises(InputError, match="after the last one"):
        made.observe(0.3, AWAY, STILL)


def test_a_late_picture_takes_nothing_back() -> None:
    """What one camera has seen since is there, though another's was taken before and looks through it."""
    perceiver = vff.Perceiver(ARM, [CAMERA, CAMERA], {"stride": 1}, known=[TABLE])
    ball = np.array([0.5, 0.3, 0.6])
    for t in np.arange(0.0, 1.2, 0.01):
        perceiver.observe(t, AWAY, STILL)
    perceiver.see(picture([(ball, 0.08)]), 1.0, 0)
    seen = perceiver.points
    assert len(seen) > 10
    perceiver.see(picture([]), 0.95, 1)
    np.testing.assert_array_equal(perceiver.points, seen)
    perceiver.see(picture([]), 1.05, 1)
    assert len(perceiver.points) == 0


def test_a_cloud_in_the_frame_of_the_camera() -> None:
    depth = picture([([0.5, 0.1, 0.3], 0.08)])
    columns, rows = np.meshgrid(np.arange(320), np.arange(240))
    cloud = np.stack([(columns - 159.5) / 280.0 * depth, (rows - 119.5) / 280.0 * depth, depth], axis=-1)
    made = perceiver(stride=1)
    made.see_points(cloud.reshape(-1, 3), 0.0)
    off = np.linalg.norm(made.points - [0.5, 0.1, 0.3], axis=1) - 0.08
    assert len(made.points) > 30 and np.abs(off).max() < 0.01


def test_half_a_cloud_is_never_read() -> None:
    """Points and velocities are of one picture, while another thread takes pictures in."""
    made = perceiver(stride=4)
    seen = [picture([([0.5, 0.1, 0.3], 0.08)]), picture([([0.5, 0.1, 0.3], 0.08), ([0.3, -0.2, 0.3], 0.12)])]

    enough = threading.Event()

    def see() -> None:
        k = 0
        while k < 200 or not enough.is_set():
            k += 1
            made.observe(0.03 * k, AWAY, STILL)
            made.see(seen[k % 2], 0.03 * k)

    thread = threading.Thread(target=see)
    thread.start()
    times: set[float | None] = set()
    try:
        while thread.is_alive():
            points, velocities, t = made.cloud
            assert points.shape == velocities.shape
            times.add(t)
            if len(times) > 2:  # a busy machine may let the other thread go first
                enough.set()
    finally:
        enough.set()
        thread.join()
    assert len(times) > 2


def test_what_is_taken_up_is_cut_away() -> None:
    """A ball in the hand is seen until the perceiver knows the arm with it; then everything begins anew."""
    q = [0.0, -0.3, 0.0, -1.9, 0.0, 1.6, 0.8]
    ball = {"kind": "sphere", "radius": 0.09, "center": [0.0, 0.0, 0.1]}
    loaded = ARM.with_load(0.5, shapes=[ball])
    place, (w, x, y, z) = ARM.pose(q)
    ahead = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
    shown = picture([(place + 0.1 * ahead, 0.08)])
    made = vff.Perceiver(ARM, [CAMERA], {}, known=[TABLE])

    def left() -> int:
        made.observe(0.0, q, STILL)
        made.see(shown, 0.0)
        return len(made.points)

    assert left() > 5
    made.set_arm(loaded)
    assert len(made.points) == 0  # no picture will ever show that it is free there
    made.forget()
    assert made.t is None and len(made.points) == 0
    assert left() == 0
    with pytest.raises(InputError, match="arm: expected one with 7 joints, got 6"):
        made.set_arm(vff.Arm.named("ur5e"))
    with pytest.raises(InputError, match="this one is in the plane"):
        made.set_arm(vff.Arm.uniform(7))


def test_bodies_that_turn_are_told() -> None:
    """A row of balls that turns: how fast, and every point as fast as it is."""
    made, rate = perceiver(), 2.5
    for k in range(15):
        t = k * PERIOD
        if k:
            made.observe(t, AWAY, STILL)
        along = np.array([np.cos(rate * t), np.sin(rate * t), 0.0])
        balls = [([0.5, 0.0, 0.4] + s * along, 0.04) for s in np.linspace(-0.3, 0.3, 21)]
        made.see(picture(balls), t)
    (track,) = made.tracks
    assert track["moves"] and np.abs(track["angular_velocity"] - [0.0, 0.0, rate]).max() < 0.2
    points, velocities, _ = made.cloud
    off = velocities - np.cross([0.0, 0.0, rate], points - [0.5, 0.0, 0.4])
    assert np.median(np.linalg.norm(off, axis=1)) < 0.1
    assert np.linalg.norm(velocities, axis=1).max() > 0.6


def test_reckoning_with_what_is_hidden_needs_no_other_setting() -> None:
    made = perceiver(hidden=0.3)
    made.see(picture([([0.5, 0.1, 0.3], 0.08)]), 0.0)
    assert made.points[:, 2].min() < 0.27


def camera(**changed: Any) -> dict[str, Any]:
    return CAMERA | changed


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: vff.Perceiver(vff.Arm.uniform(3), [CAMERA]), "this one is in the plane"),
        (lambda: vff.Perceiver(ARM, []), "cameras: expected one at least"),
        (lambda: vff.Perceiver(ARM, [CAMERA, camera(focal=[0.0, 1.0])]), r"cameras\[1\]: focal must be"),
        (lambda: vff.Perceiver(ARM, [{"columns": 3}]), r"cameras\[0\].rows: missing"),
        (lambda: vff.Perceiver(ARM, [camera(lens=1)]), r"cameras\[0\].lens: unknown, expected columns"),
        (lambda: vff.Perceiver(ARM, [camera(focal=[1.0])]), r"cameras\[0\].focal: expected shape \(2,\)"),
        (lambda: vff.Perceiver(ARM, [camera(rows=10**9)]), r"cameras\[0\]: columns × rows must be"),
        (
            lambda: vff.Perceiver(ARM, [CAMERA], {"voxels": 1.0}),
            "settings.voxels: unknown, expected room, voxel",
        ),
        (lambda: vff.Perceiver(ARM, [CAMERA], {"stride": 1.5}), "settings.stride: must be a whole number"),
        (lambda: vff.Perceiver(ARM, [CAMERA], {"room": [1.0]}), r"settings.room: expected shape \(2, 3\)"),
        (lambda: vff.Perceiver(ARM, [CAMERA], {"memory": -1.0}), "settings.memory: must be 0 or more"),
        (lambda: vff.Perceiver(ARM, [CAMERA], {"range": np.inf}), "settings.range: must be finite, got inf"),
        (lambda: vff.Perceiver(ARM, [CAMERA], {"voxel": 1e-5}), "settings.room: has .* cells"),
        (
            lambda: vff.Perceiver(ARM, [CAMERA], {"memory": -1e300}),
            "settings.memory: must be 0 or more, got -1e300",
        ),
        (lambda: perceiver().see(np.ones((3, 3)), 0.0), r"depth: expected shape \(240, 320\), got \(3, 3\)"),
        (lambda: perceiver().see(np.ones((240, 320)), 0.0, camera=1), "there is no camera 1"),
        (lambda: perceiver().see(np.ones((240, 320), np.int32), 0.0), "depth: expected uint16, .* got int32"),
        (lambda: perceiver().see(np.ones((240, 320), np.uint8), 0.0), "depth: expected uint16, .* got uint8"),
        (lambda: perceiver().see(np.full((240, 320), 1000, object), 0.0), "expected uint16, .* got int64"),
        (lambda: perceiver().see(np.ma.ones((240, 320), np.uint16), 0.0), "depth: .* got a masked array"),
        (lambda: vff.Perceiver(ARM, [CAMERA], known=3), "known: expected a sequence of obstacles, got int"),
        (
            lambda: vff.Perceiver(ARM, [CAMERA], known=[TABLE, MOVES]),
            r"known\[1\]: moves, and what is known is left out",
        ),
        (
            lambda: vff.Perceiver(ARM, [CAMERA], known=[TABLE, {"shape": {"sphere": {}}}]),
            r"known\[1\]\.shape",
        ),
        (
            lambda: vff.Perceiver(ARM, [CAMERA], {"room": [[3.0, -1.0, 0.0], [5.0, 1.0, 1.0]]}),
            "settings.room: is out of reach of the arm, which goes .* m around its base",
        ),
        (lambda: perceiver().see(np.ones((240, 320)), np.inf), "t must be finite"),
        (
            lambda: perceiver().see(np.ones((240, 320)), 1.0),
            "no state of the arm is known within 0.05 s of 1 s",
        ),
        (lambda: perceiver().see_points([[0.0, np.nan, 1.0]], 0.0), r"cloud\[0\]\[1\] must be finite"),
        (lambda: perceiver().observe(0.0, AWAY, STILL), r"after the last one \(0 s\)"),
        (lambda: perceiver().observe(1.0, [np.nan] * 7, STILL), "q: expected 7 finite numbers"),
    ],
)
def test_what_is_refused(make: Any, sentence: str) -> None:
    with pytest.raises(VffNullError, match=sentence):
        make()


JUDGED = """
    import mujoco
    import numpy as np
    import vffnull as vff
    from vffnull.engines.export import to_mjcf

    arm = vff.Arm.named("panda")
    ball = vff.Obstacle.sphere([0.85, 0.0, 0.2], 0.04)
    text = to_mjcf(arm, obstacles=[ball])
    eye = '<camera name="eye" pos="0.4 0 1.6" fovy="50"/><geom type="plane" size="3 3 0.1" pos="0 0 -0.05"/>'
    model = mujoco.MjModel.from_xml_string(text.replace("<worldbody>", "<worldbody>" + eye, 1))
    data = mujoco.MjData(model)
    renderer = mujoco.Renderer(model, 240, 320)
    renderer.enable_depth_rendering()
    focal = 120.0 / np.tan(np.radians(25.0))
    # MuJoCo's cameras look along -z, ours along z.
    camera = {"columns": 320, "rows": 240, "focal": [focal, focal], "centre": [159.5, 119.5],
              "position": [0.4, 0.0, 1.6], "orientation": [0.0, 1.0, 0.0, 0.0]}
    ball = model.body("obstacle_1").mocapid[0]
    floor = vff.Obstacle.half_space([0.0, 0.0, -0.05], [0.0, 0.0, 1.0])
    settings = {"room": [[-1.0, -1.0, -0.3], [1.0, 1.0, 1.4]], "stride": 1}
    perceiver = vff.Perceiver(arm, [camera], settings, known=[floor])
    mean = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.6, 0.8])
    swing, rate = np.array([0.6, 0.2, 0.2, 0.3, 0.4, 0.3, 0.5]), 2.0
    left = 0
    for k in range(30):
        t = k / 30.0
        q, dq = mean + swing * np.sin(rate * t), swing * rate * np.cos(rate * t)
        perceiver.observe(t, q, dq)
        late = t + 0.02  # the clock of the camera is off
        data.qpos[:7] = mean + swing * np.sin(rate * late)
        centre = np.array([0.85, 0.3 * t - 0.15, 0.2])
        data.mocap_pos[ball] = centre
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, "eye")
        counts = perceiver.see(renderer.render(), t)
        off = np.linalg.norm(perceiver.points - centre, axis=1)
        left += int((off > 0.1).sum())
        assert (off < 0.06).sum() > 3, (k, len(off))
        assert counts["own"] > 500
    moving = [track for track in perceiver.tracks if track["moves"]]
    print(left, [track["velocity"].round(3).tolist() for track in moving])
    assert left == 0
    assert len(moving) == 1 and np.abs(moving[0]["velocity"] - [0.0, 0.3, 0.0]).max() < 0.03
"""


def test_what_a_renderer_of_others_shows() -> None:
    """MuJoCo draws a Panda that swings and a ball; a clock is off by 20 ms. Of the arm nothing is left, and
    the ball has its velocity.
    """
    pytest.importorskip("mujoco")
    code = "import os\nos.environ.setdefault('MUJOCO_GL', 'egl')\n" + textwrap.dedent(JUDGED)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False
    )
    if done.returncode and "mujoco.Renderer" in done.stderr:
        pytest.skip("nothing renders here")
    assert done.returncode == 0, done.stderr
