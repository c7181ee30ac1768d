"""An arm of one's own, from its file to a scenario that runs: shapes, a cache of them, MJCF, `arms new`."""

from __future__ import annotations

import json
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import vffnull as vff
import vffnull._core as _core
from vffnull.arms import _kept, read_urdf
from vffnull.arms._capsules import Solid, fit_solids
from vffnull.arms._new import INNER, TRIED, _bent, _passing
from vffnull.arms._read import _always
from vffnull.arms._touching import spread
from vffnull.cli import _commands
from vffnull.errors import InputError, ScenarioError, ScenarioWarning
from vffnull.model.arm import arm_of
from vffnull.model.headline import findings


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the fits of these tests are kept."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def nobodys(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody's own cache is touched; what one test has fitted, others need not."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(place))


@pytest.fixture
def cache(nobodys: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One of one's own, empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "vffnull" / "fits"


def test_a_plate_is_no_ball() -> None:
    """Around a wide flat thing a capsule has several times its volume: a hull takes its place."""
    (plate,) = fit_solids("base", [Solid.box("plate", (0.9, 0.9, 0.05))])
    assert plate.shape["kind"] == "convex" and plate.tightness < 1.0001
    assert plate.protrusion < 1e-9
    # A small one keeps its capsule, which is measured faster and wastes less than a litre.
    small = fit_solids("finger", [Solid.box("plate", (0.05, 0.05, 0.005))])
    assert {each.shape["kind"] for each in small} <= {"capsule", "sphere"}


def test_what_is_far_apart_is_not_joined_into_a_beam() -> None:
    """Rods here and there beside something large, of which a tenth is more than they are."""
    rods = [
        Solid.cylinder(f"rod{i}", 0.05, 0.4).moved(np.eye(3), np.array([0.3 * i, 0.3 * (i % 2), 0.0]))
        for i in range(4)
    ]
    fits = fit_solids(
        "base", [Solid.capsule("drum", 0.6, 1.0).moved(np.eye(3), np.array([0, -3.0, 0])), *rods]
    )
    assert all(fit.tightness <= 2.0 or fit.volume - fit.hull_volume <= 1e-3 for fit in fits)
    assert len(fits) > 2


def _robot(folder: Path) -> Path:
    path = folder / "robot.urdf"
    path.write_text(vff.Arm.named("panda").to_urdf(), encoding="utf-8")
    return path


def test_fits_are_kept(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second reading fits nothing and finds the same to the last bit; what is damaged is fitted again."""
    robot = _robot(tmp_path)
    first = read_urdf(robot, tip="panda_hand_tcp")
    entries = sorted(cache.glob("*.json"))
    assert entries and not [each for each in cache.iterdir() if each.suffix != ".json"]
    with monkeypatch.context() as frozen:
        frozen.setattr("vffnull.arms._capsules.fit_solids", lambda *_: pytest.fail("it is kept"))
        again = read_urdf(robot, tip="panda_hand_tcp")
    assert again.to_dict() == first.to_dict()
    for damage in (b"", b"{", b'{"digest": "x", "fits": []}', b"\xff\xfe"):
        entries[0].write_bytes(damage)
        assert read_urdf(robot, tip="panda_hand_tcp").to_dict() == first.to_dict()
    document = json.loads(entries[0].read_text(encoding="utf-8"))
    document["fits"][0]["shape"]["radius"] = 9.0
    entries[0].write_text(json.dumps(document), encoding="utf-8")
    assert read_urdf(robot, tip="panda_hand_tcp").to_dict() == first.to_dict()


@pytest.mark.parametrize("terminal", [True, False])
def test_a_bar_is_shown_while_shapes_are_fitted(
    terminal: bool, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a terminal alone; it counts every link, and is there while the first is fitted."""
    told: list[tuple[float, float]] = []
    shown: list[tuple[float, str]] = []
    begun: list[int] = []

    @contextmanager
    def bar(total: float, _delay: float, counts: str) -> Iterator[Any]:
        shown.append((total, counts))
        yield lambda done, of: told.append((done, of))

    def fit(*arguments: Any) -> Any:
        begun.append(len(shown))
        return fit_solids(*arguments)

    monkeypatch.setattr("vffnull.arms._read._progress.bar", bar)
    monkeypatch.setattr("vffnull.arms._capsules.fit_solids", fit)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    links = len(read_urdf(_robot(tmp_path), tip="panda_hand_tcp").document["joints"]) + 1
    assert begun and set(begun) == {int(terminal)}
    assert shown == [(links, ".0f links fitted")] * terminal
    assert told == [(done, links) for done in range(1, links + 1)] * terminal


def _resized(document: Any, factor: float) -> Any:
    """An arm of other lengths and of the same densities: masses by the cube, inertias by the fifth power."""
    made = json.loads(json.dumps(document))
    for joint in made["joints"]:
        joint["position"] = [factor * x for x in joint["position"]]
        joint["mass"] *= factor**3
        joint["com"] = [factor * x for x in joint["com"]]
        joint["inertia"] = [factor**5 * x for x in joint["inertia"]]
    for each in made["collision"]:
        shape = each["shape"]
        for key in ("a", "b", "center"):
            if key in shape:
                shape[key] = [factor * x for x in shape[key]]
        shape["radius"] *= factor
    made["torque_limits"] = [factor**4 * x for x in made["torque_limits"]]  # they hold the weight
    if tool := made.get("tool"):
        tool["position"] = [factor * x for x in tool["position"]]
    return made


def test_gains_follow_the_size_of_the_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a small and of a large one of the same build: the push by the mass, its range by the reach, the
    posture's stiffness by the inertia; what shapes accelerations is the same. Every line says its unit.
    """
    monkeypatch.chdir(tmp_path)
    found = {}
    for factor in (0.4, 2.5):
        document = _resized(vff.Arm.named("panda").to_dict(), factor)
        document["collision"] = [each for each in document["collision"] if each["link"] != document["base"]]
        Path("robot.urdf").write_text(arm_of(document).to_urdf(), encoding="utf-8")
        text = _new("robot.urdf", "--tip", document["tip"])
        Path("mine.toml").write_text(text, encoding="utf-8")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ScenarioWarning)
            found[factor] = vff.Scenario.load("mine.toml")
            result = vff.simulate(found[factor])
        assert result.status == "completed" and result.metrics.min_clearance > 0.0
        lines = [line for line in text.splitlines() if " = " in line and not line.startswith("#")]
        for key in ("duration", "q0", "stiffness", "damping", "null_damping", "posture", "dt", "shape"):
            (line,) = [line for line in lines if line.startswith(f"{key} = ")]
            assert re.search(r"# \S", line), line
    small, large = found[0.4], found[2.5]
    ratio = 2.5 / 0.4
    assert large["controller.stiffness"] == small["controller.stiffness"]
    assert large["controller.damping"] == small["controller.damping"]
    field = "controller.field"
    assert large[field]["influence"] / small[field]["influence"] == pytest.approx(ratio, rel=0.1)
    assert large[field]["gain"] / small[field]["gain"] == pytest.approx(ratio**3, rel=0.1)
    stiff = [np.array(each["controller.posture_stiffness"]) for each in (small, large)]
    assert np.median(stiff[1] / stiff[0]) == pytest.approx(ratio**5, rel=0.3)


def test_the_cache_is_bounded(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_kept, "MOST", 3000)
    read_urdf(_robot(tmp_path), tip="panda_hand_tcp")
    assert sum(each.stat().st_size for each in cache.glob("*.json")) <= 3000


def test_without_a_place_for_a_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert read_urdf(_robot(tmp_path), tip="panda_hand_tcp").fits


@pytest.mark.parametrize("arm", ["panda", "ur5e"])
@pytest.mark.parametrize("ending", ["urdf", "xml"])
def test_a_scenario_to_start_from(
    arm: str, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file that `arms new` prints is valid, within the limits, and runs at once without contact."""
    monkeypatch.chdir(tmp_path)
    made = vff.Arm.named(arm)
    Path(f"robot.{ending}").write_text(
        made.to_urdf() if ending == "urdf" else made.to_mjcf(), encoding="utf-8"
    )
    tip = ["--tip", vff.arms.named(arm)["tip"]]
    done = CliRunner().invoke(_commands, ["arms", "new", f"robot.{ending}", *tip], standalone_mode=False)
    assert done.exception is None, done.exception
    Path("mine.toml").write_text(done.stdout, encoding="utf-8")
    judged = CliRunner().invoke(_commands, ["validate", "mine.toml"], standalone_mode=False)
    assert judged.return_value == 0 and "mine.toml: valid" in judged.stdout, judged.output
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScenarioWarning)  # of what is odd in the file
        result = vff.simulate("mine.toml")
    assert result.status == "completed" and result.metrics.min_clearance > 0.0
    low, high = np.asarray(made.joint_limits).T
    assert (low < result.q[0]).all() and (result.q[0] < high).all()
    assert result.metrics.min_clearance < 0.3  # the ball does come near


@pytest.mark.parametrize("dry", [0.0, 1.0])
def test_a_scenario_for_joints_with_friction(
    dry: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the file says of friction is made up for, and simulated finely enough: the tip comes back."""
    monkeypatch.chdir(tmp_path)
    text = vff.Arm.named("ur5e").to_urdf()
    none, some = ('damping="0.0" friction="0.0"', f'damping="1.0" friction="{dry}"')
    assert text.count(none) >= 6
    Path("robot.urdf").write_text(text.replace(none, some), encoding="utf-8")
    tip = ["--tip", vff.arms.named("ur5e")["tip"]]
    done = CliRunner().invoke(_commands, ["arms", "new", "robot.urdf", *tip], standalone_mode=False)
    assert done.exception is None, done.exception
    Path("mine.toml").write_text(done.stdout, encoding="utf-8")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = vff.Scenario.load("mine.toml")
        result = vff.simulate(found)
    assert not [each for each in told if "friction" in str(each.message) or "duration" in str(each.message)]
    assert found["controller.command.viscous_friction"] == pytest.approx([0.9] * 6)
    assert ("coulomb_friction" in found["controller.command"]) == (dry > 0.0)
    assert not list(findings(result.metrics, found.arm))
    assert found["simulation.dt"] * found.to_dict()["simulation"].get("control_every", 1) == pytest.approx(
        1e-3
    )


def test_a_scenario_for_heavy_rotors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The task of an arm that hardly yields is not damped as near a singularity for it."""
    monkeypatch.chdir(tmp_path)
    document = vff.Arm.named("ur5e").to_dict()
    document["joints"] = [{**joint, "armature": 300.0} for joint in document["joints"]]
    Path("robot.xml").write_text(arm_of(document).to_mjcf(), encoding="utf-8")
    tip = ["--tip", document["tip"]]
    done = CliRunner().invoke(_commands, ["arms", "new", "robot.xml", *tip], standalone_mode=False)
    assert done.exception is None, done.exception
    Path("mine.toml").write_text(done.stdout, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScenarioWarning)
        found = vff.Scenario.load("mine.toml")
        assert vff.simulate(found, {"duration": 0.1}).metrics.singular_steps == 0
        usual = vff.simulate(found, {"duration": 0.1, "controller.singularity": 0.03})
    assert usual.metrics.singular_steps > 0


LINK = """<link name="l{i}"><inertial><origin xyz="0 0 0.15"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.003"/></inertial><collision><origin xyz="0 0 0.15"/>
<geometry><cylinder radius="0.04" length="0.3"/></geometry></collision></link>
<joint name="j{i}" type="{kind}"><parent link="l{before}"/><child link="l{i}"/>
<origin xyz="0 0 {far}"/><axis xyz="{axis}"/><limit lower="-2" upper="2.3" velocity="2" effort="400"/></joint>
"""


def _chain(*joints: str) -> str:
    """A URDF of links of 0.3 m; of each joint its kind, and its axis, as in ``"revolute 0 1 0"``."""
    parts = [joint.partition(" ") for joint in joints]
    links = [
        LINK.format(i=i, before=i - 1, kind=kind, axis=axis, far=0.3 if i > 1 else 0.0)
        for i, (kind, _, axis) in enumerate(parts, start=1)
    ]
    end = f"""<link name="tip"/><joint name="end" type="fixed"><parent link="l{len(joints)}"/>
        <child link="tip"/><origin xyz="0.05 0 0.3"/></joint>"""
    return "".join(['<robot name="chain"><link name="l0"/>', *links, end, "</robot>"])


@pytest.mark.parametrize(
    ("joints", "free"),
    [
        (["revolute 0 1 0"], 0),
        (["revolute 0 1 0"] * 3, 1),
        (["revolute 0 1 0"] * 7, 4),
        (["revolute 0 1 0"] * 10, 7),
        (["prismatic 1 0 0", "prismatic 0 1 0"], 0),
        (["prismatic 1 0 0", "revolute 0 1 0", "revolute 0 1 0"], 1),
    ],
)
def test_a_scenario_for_an_arm_that_cannot_move_its_tip_in_all_directions(
    joints: list[str], free: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not taken for one near a singularity, and the joints are counted that the task leaves."""
    monkeypatch.chdir(tmp_path)
    Path("robot.urdf").write_text(_chain(*joints), encoding="utf-8")
    text = _new("robot.urdf", "--tip", "tip")
    assert "singularity" not in text
    assert f"# leaves {free} of {len(joints)} joints free" in text
    Path("mine.toml").write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScenarioWarning)
        assert vff.simulate("mine.toml", {"duration": 0.1}).status == "completed"


@pytest.mark.parametrize("axes", ["z y z z", "z x z z x", "z y x z y"])
def test_the_ball_passes_what_a_joint_can_move(
    axes: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not the second joint where the first one only turns it: nothing could keep that clear."""
    monkeypatch.chdir(tmp_path)
    along = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    text = _chain(*(f"revolute {along[axis]}" for axis in axes.split()))
    Path("robot.urdf").write_text(text, encoding="utf-8")
    report = read_urdf("robot.urdf", tip="tip")
    arm = arm_of(report.document)
    q0 = _bent(report.document, arm)
    start, way = _passing(arm, np.asarray(q0), 0.1, 0.2)
    away = np.linalg.norm(arm.forward_kinematics(q0)[2:] - (start + 3.0 * 0.2 * way), axis=1)
    assert abs(away - 0.1).min() < 1e-12
    Path("mine.toml").write_text(_new("robot.urdf", "--tip", "tip"), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScenarioWarning)
        assert vff.simulate("mine.toml").metrics.min_clearance > 0.0


def test_pairs_that_always_overlap_are_told_of_in_one_sentence() -> None:
    one = _always([("a", "b")], "fit", False)
    assert one == [
        "the shapes of `a` and `b` overlap in nearly every posture: the pair is ignored, and nothing keeps "
        'them apart; an `srdf`, or collision = "file" says otherwise'
    ]
    (many,) = _always([("a", "b"), ("c", "d")], "file", True)
    assert many == (
        "the shapes of `a` and `b`, of `c` and `d` overlap in nearly every posture, and the SRDF keeps these "
        "pairs: they count as collisions; `ignore` them"
    )
    assert _always([], "fit", False) == []


def test_mjcf_in_a_scenario(tmp_path: Path) -> None:
    """Beside the scenario, as a URDF; the scenario holds what was read."""
    (tmp_path / "robot.xml").write_text(vff.Arm.named("iiwa14").to_mjcf(), encoding="utf-8")
    scenario = tmp_path / "mine.toml"
    text = 'duration = 0.1\nq0 = [0.0, 0.5, 0.0, -1.2, 0.0, 0.8, 0.0]\nreference.kind = "setpoint"\n[arm]\n'
    scenario.write_text(f'{text}mjcf = "robot.xml"\n', encoding="utf-8")
    # What overlaps in every posture, the file excludes.
    with pytest.warns(ScenarioWarning, match="no limit of speed"):
        found = vff.Scenario.load(scenario)
    assert len(found["arm.joints"]) == 7 and "mjcf" not in found["arm"]
    assert vff.simulate(found).status == "completed"
    for changes, said in (
        ({"arm.urdf": "robot.urdf"}, "give `urdf` or `mjcf`"),
        ({"arm.packages": "."}, "unknown key `packages` beside `mjcf`"),
        ({"arm.mjcf": "missing.xml"}, "arm.mjcf: "),
    ):
        with pytest.raises(ScenarioError, match=said):
            vff.simulate(scenario, changes)
    scenario.write_text(f'{text}urdf = "robot.xml"\n', encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"this is MJCF, `\[arm\] mjcf = …` reads it"):
        vff.Scenario.load(scenario)


def _new(*arguments: str) -> str:
    done = CliRunner().invoke(_commands, ["arms", "new", *arguments], standalone_mode=False)
    assert done.exception is None, done.exception
    return done.stdout


def test_an_arm_whose_links_touch_in_the_middle_of_its_ranges() -> None:
    """A posture further out is found where none of the inner half is free: a forearm that is folded there."""
    made = vff.Arm.named("ur5e").to_dict()
    made["joint_limits"][2] = [0.9, 2.0 * np.pi - 0.9]
    (wrist,) = (each for each in made["collision"] if each["link"] == "wrist_1_link")
    wrist["shape"]["radius"] = 0.28
    made["ignore"] = [["wrist_1_link", "wrist_3_link"]]
    inner = _core.overlapping_links(made, [q.tolist() for q in spread(made, TRIED, INNER[0])])
    assert all(inner)
    assert not _core.overlapping_links(made, [_bent(made, arm_of(made))])[0]


def test_shapes_that_touch_nothing_in_an_mjcf_are_told_of() -> None:
    """MuJoCo lets what has neither contype nor conaffinity pass through everything: left out, and said."""
    size = 'type="capsule" size="0.05" fromto="0 0 0 0 0 0.4" mass="1" conaffinity="0"'
    upper = f'<body name="upper" pos="0 0 1"><joint name="b" axis="1 0 0"/><geom {size} contype="0"/></body>'
    lower = f'<body name="lower"><joint name="a" axis="1 0 0"/><geom {size} contype="1"/>{upper}</body>'
    xml = f"<mujoco><worldbody>{lower}</worldbody></mujoco>"
    with pytest.warns(vff.errors.ScenarioWarning) as told:
        vff.Arm.from_mjcf(xml)
    (said,) = [str(each.message) for each in told if "touch nothing" in str(each.message)]
    assert "all shapes of `upper` touch nothing" in said


def chain_of_four(option: str = "", equality: str = "") -> str:
    """An MJCF of four capsules, each 0.3 m beyond the last."""
    shape = '<geom type="capsule" fromto="0 0 .05 0 0 .25" size=".05" mass="1"/>'
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
    bodies = "".join(
        f'<body name="l{i}" pos="0 0 .3"><joint name="j{i}" axis="{axis}" range="-2 2"/>{shape}'
        for i, axis in enumerate(axes)
    )
    world = f"<worldbody>{bodies}{'</body>' * 4}</worldbody>"
    option = f'<option gravity="0 0 -9.81">{option}</option>'
    return f'<mujoco><compiler angle="radian"/>{option}{world}<equality>{equality}</equality></mujoco>'


@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
def test_gravity_that_an_mjcf_turns_off() -> None:
    """A controller pushed against a gravity that the plant does not have."""
    weightless = vff.Arm.from_mjcf(chain_of_four('<flag gravity="disable"/>'))
    assert not weightless.gravity_torque([0.1, 0.3, 0.2, 0.1]).any()
    assert vff.Arm.from_mjcf(chain_of_four()).gravity_torque([0.1, 0.3, 0.2, 0.1]).any()


@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
def test_joints_that_an_mjcf_couples() -> None:
    """As in a URDF: one on the arm is refused, one beside it follows."""
    coupled = chain_of_four(equality='<joint joint1="j2" joint2="j1" polycoef="0.1 0.5 0 0 0"/>')
    with pytest.raises(InputError, match="`j2` lies on the chain and mimics `j1`"):
        vff.Arm.from_mjcf(coupled)
    followed = vff.Arm.from_mjcf(coupled, tip="l0", locked={"j1": 0.2})
    apart = vff.Arm.from_mjcf(chain_of_four(), tip="l0", locked={"j1": 0.2, "j2": 0.2})
    np.testing.assert_allclose(followed.inertias, apart.inertias, atol=1e-15)
    np.testing.assert_allclose(followed.com, apart.com, atol=1e-15)


def test_an_mjcf_has_no_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the scenario would not take is refused at once."""
    monkeypatch.chdir(tmp_path)
    Path("robot.xml").write_text(vff.Arm.named("ur5e").to_mjcf(), encoding="utf-8")
    for command in ("new", "check"):
        done = CliRunner().invoke(
            _commands, ["arms", command, "robot.xml", "--package", "."], standalone_mode=False
        )
        assert "--package is for a URDF" in str(done.exception)


def test_arms_new_hands_on_how_the_file_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every option of reading is in the scenario, which reads the arm that was read."""
    monkeypatch.chdir(tmp_path)
    Path("robot.urdf").write_text(vff.Arm.named("panda").to_urdf(), encoding="utf-8")
    tip = vff.arms.named("panda")["tip"]
    asked = ["--tip", tip, "--lock", "panda_joint7=0.25", "--collision", "file", "--package", str(tmp_path)]
    asked += ["--fix-inertia", "--pieces", "2"]
    Path("mine.toml").write_text(_new("robot.urdf", *asked), encoding="utf-8")
    table = _core.parse_toml(Path("mine.toml").read_text(encoding="utf-8"), "mine")["arm"]
    assert table == {
        "urdf": "robot.urdf",
        "tip": tip,
        "locked": {"panda_joint7": 0.25},
        "collision": "file",
        "pieces": 2,
        "packages": [str(tmp_path)],
        "fix_inertia": True,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScenarioWarning)
        assert vff.Scenario.load("mine.toml").arm.n == 6


def test_what_is_odd_about_an_arm_is_listed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`arms new` and `validate` list it; `run` says in one line that there is something."""
    monkeypatch.chdir(tmp_path)
    document = vff.Arm.named("ur5e").to_dict()
    bare = document["joints"][2]["link"]
    document["collision"] = [each for each in document["collision"] if each["link"] != bare]
    text = re.sub(r' velocity="[^"]*"', "", arm_of(document).to_urdf())
    Path("robot.urdf").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(
        _commands, ["arms", "new", "robot.urdf", "--tip", document["tip"]], standalone_mode=False
    )
    assert f"no shape on `{bare}`" in done.stderr and "no limit of speed" in done.stderr
    Path("mine.toml").write_text(done.stdout, encoding="utf-8")
    listed = CliRunner().invoke(_commands, ["validate", "mine.toml"], standalone_mode=False).output
    assert listed.count("warning: ") == done.stderr.count("warning: ") > 1
    ran = CliRunner().invoke(
        _commands, ["run", "mine.toml", "--set", "duration=0.1", "-q"], standalone_mode=False
    )
    told = [line for line in ran.stderr.splitlines() if "about the arm" in line]
    assert told == [
        f"warning: {listed.count('warning: ')} things are odd about the arm: "
        "`vffnull validate mine.toml` lists them"
    ]
    assert "no shape on" not in ran.output


def test_studies_and_recordings_tell_what_is_odd_in_sentences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not as Python prints its warnings, with a file and a line of the source."""
    monkeypatch.chdir(tmp_path)
    text = _chain("revolute 0 0 1", "revolute 0 1 0").replace(' velocity="2"', "")
    Path("robot.urdf").write_text(text, encoding="utf-8")
    Path("mine.toml").write_text(_new("robot.urdf"), encoding="utf-8")
    factor = '[[factors]]\nkey = "duration"\nrange = [0.1, 0.2]\n'
    design = '[design]\nkind = "sobol"\ncount = 2\n'
    Path("study.toml").write_text(f'scenario = "mine.toml"\n{factor}{design}', encoding="utf-8")
    Path("cell.mcap").touch()
    for command in (
        ["study", "run", "study.toml", "--dry-run"],
        ["perceive", "cell.mcap", "--arm", "robot.urdf", "--known", "mine.toml"],
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("error", ScenarioWarning)
            done = CliRunner().invoke(_commands, command, standalone_mode=False)
        assert not isinstance(done.exception, ScenarioWarning)
        assert done.stderr.count("warning: no limit of speed for `j1`, `j2`") == 1, done.output
        assert "ScenarioWarning" not in done.output


@pytest.mark.parametrize(
    ("arm", "tip", "said"),
    [
        ("robot.urdf", "hand", "tip: there is no link `hand`"),
        ("panda", "panda_link7", "--tip belongs to the file of an arm; panda says where its arm ends"),
    ],
)
def test_a_recording_is_replayed_with_a_tip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arm: str, tip: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("robot.urdf").write_text(_chain("revolute 0 0 1", "revolute 0 1 0"), encoding="utf-8")
    Path("cell.mcap").touch()
    command = ["perceive", "cell.mcap", "--arm", arm, "--tip", tip]
    done = CliRunner().invoke(_commands, command, standalone_mode=False)
    assert said in str(done.exception)


@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
def test_pairs_that_a_model_excludes_are_ignored() -> None:
    """They were lost without a word, those that `to_mjcf` has written, too."""
    document = vff.Arm.named("panda").to_dict() | {"ignore": [["panda_link3", "panda_link7"]]}
    arm = vff.Scenario.load("panda-sweep").replace(arm=document).arm
    assert ["panda_link3", "panda_link7"] in vff.Arm.from_mjcf(arm.to_mjcf()).to_dict()["ignore"]
