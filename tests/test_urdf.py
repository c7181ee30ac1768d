"""URDF and MJCF to explicit descriptions: what is read, what is refused, and what goes back."""
# ruff: noqa: E501 — models as they are written

from __future__ import annotations

import itertools
import json
import math
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from published import MODELS, chains, coordinates, pin, reduced_to
from spatial_oracle import mass_and_gravity, poses
from strategies import random_arm
from vffnull import Arm, Scenario, _core, arms, plan, simulate
from vffnull.errors import InputError, InputTypeError, ScenarioError, ScenarioWarning

mujoco = pytest.importorskip("mujoco")

ARM = """<robot name="two">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper"><inertial><origin xyz="0 0.02 0.2" rpy="0.3 0 0"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.035" izz="0.01" ixy="0.001"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.3"/></geometry></collision></link>
  <link name="lower"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.025"/></inertial>
    <collision><origin xyz="0 0 0.25"/><geometry><mesh filename="{mesh}"/></geometry></collision></link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="50" velocity="3"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 0 1"/><limit effort="20" velocity="4"/></joint>
  <joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/>
    <origin xyz="0 0 0.5" rpy="0 1.5707963267948966 0"/></joint>
</robot>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A package with a model and its mesh: a pyramid."""
    here = tmp_path / "two_description"
    (here / "meshes").mkdir(parents=True)
    (here / "urdf").mkdir()
    (here / "meshes" / "lower.obj").write_text(
        "v -0.05 -0.05 0\nv 0.05 -0.05 0\nv 0.05 0.05 0\nv -0.05 0.05 0\nv 0 0 0.2\n"
        "f 1 3 2\nf 1 4 3\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"
    )
    write(here, "package://two_description/meshes/lower.obj")
    return here


def write(here: Path, mesh: str) -> Path:
    path = here / "urdf" / "two.urdf"
    path.write_text(ARM.format(mesh=mesh))
    return path


def without_mesh(text: str = ARM) -> str:
    return text.replace('<mesh filename="{mesh}"/>', '<sphere radius="0.1"/>')


def refused(words: str, *args: Any, error: type[Exception] = InputError, **kwargs: Any) -> str:
    with pytest.raises(error) as caught:
        arms.read_urdf(*args, **kwargs)
    sentence = str(caught.value)
    for word in words.split("|"):
        assert word in sentence, sentence
    return sentence


# ------------------------------------------------------------------------------------------ what is read


def test_a_file_with_its_mesh(folder: Path) -> None:
    report = arms.read_urdf(folder / "urdf" / "two.urdf")
    arm = report.document
    assert [joint["name"] for joint in arm["joints"]] == ["shoulder", "elbow"]
    assert [joint["kind"] for joint in arm["joints"]] == ["revolute", "continuous"]
    assert (arm["base"], arm["tip"]) == ("base", "tool")
    assert arm["joint_limits"] == [[-1.0, 2.0], [-math.inf, math.inf]]
    assert arm["joints"][0]["damping"] == 0.5
    assert arm["joints"][0]["friction"] == 0.1
    assert [fit.link for fit in report.fits] == ["base", "upper", "lower"]
    assert report.fits[2].vertices == 5
    assert "volume/hull" in str(report)
    json.dumps(report.to_dict()["fits"])


@pytest.mark.parametrize(
    "mesh", ["../meshes/lower.obj", "package://two_description/meshes/lower.obj", "absolute"]
)
def test_meshes_are_found(folder: Path, mesh: str) -> None:
    mesh = (folder / "meshes" / "lower.obj").as_uri() if mesh == "absolute" else mesh
    assert len(arms.read_urdf(write(folder, mesh)).fits) == 3


@pytest.mark.parametrize("packages", ["list", "parent", "dict"])
def test_packages_are_searched(folder: Path, packages: str) -> None:
    text = ARM.format(mesh="package://two_description/meshes/lower.obj")
    given: Any = {"list": [folder], "parent": folder.parent, "dict": {"two_description": folder}}[packages]
    assert len(arms.read_urdf(text, packages=given).fits) == 3
    refused("cannot be found", text)


def test_a_mesh_that_is_not_there(folder: Path) -> None:
    path = write(folder, "package://two_description/meshes/upper.stl")
    sentence = refused(
        "lower: mesh|upper.stl|cannot be found|packages=", path, packages=[folder.parent / "other"]
    )
    assert str(folder / "meshes" / "upper.stl") in sentence
    assert str(folder.parent / "other" / "two_description" / "meshes" / "upper.stl") in sentence
    assert not arms.read_urdf(path, collision="none").document.get("collision")
    report = arms.read_urdf(path, collision="file")
    assert any("upper.stl" in message and "left out" in message for message in report.warnings)
    assert [item["link"] for item in report.document["collision"]] == ["base", "upper"]


def test_a_mesh_that_is_no_mesh(folder: Path) -> None:
    refused("is a directory", write(folder, "../meshes"))
    (folder / "meshes" / "broken.stl").write_bytes(b"solid nothing")
    refused("broken.stl", write(folder, "../meshes/broken.stl"))
    refused("http:// is not fetched", write(folder, "http://example.org/lower.stl"))


def test_shapes_as_in_the_file(folder: Path) -> None:
    shapes = [
        item["shape"]
        for item in arms.read_urdf(folder / "urdf" / "two.urdf", collision="file").document["collision"]
    ]
    assert [shape["kind"] for shape in shapes] == ["box", "convex", "convex"]
    assert [len(shape["vertices"]) for shape in shapes[1:]] == [32, 5]


def test_options_are_taken_over() -> None:
    turned = (0.5, 0.5, 0.5, 0.5)
    arm = arms.read_urdf(
        without_mesh(),
        tool=((0.0, 0.0, 0.1), turned),
        mount={"position": [1, 2, 3]},
        gravity=[0, -1.6, 0],
        armature=[0.1, 0.2],
        collision="none",
    ).document
    assert arm["gravity"] == [0.0, -1.6, 0.0]
    assert [joint["armature"] for joint in arm["joints"]] == [0.1, 0.2]
    assert arm["mount"]["position"] == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(arm["tool"]["position"], [0.1, 0.0, 0.5], atol=1e-15)
    assert arms.read_urdf(without_mesh(), armature=0.3).document["joints"][1]["armature"] == 0.3


def test_what_is_odd_is_warned_of() -> None:
    text = without_mesh().replace('<limit effort="20" velocity="4"/>', "")
    with pytest.warns(ScenarioWarning) as told:
        arm = arms.from_urdf(text, collision="none")
    assert [str(each.message) for each in told] == [
        f"no limit of {of} for `elbow`: taken for {most}" for of, most in (("speed", 100), ("torque", 100000))
    ]
    assert told[0].filename == __file__
    assert arm["torque_limits"] == [50.0, 1e5]
    assert _core.check_arm(arm) == arm


GRIPPER = """<link name="jaw"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial></link>
  <joint name="jointGripper" type="revolute"><parent link="tool"/><child link="jaw"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="5" velocity="1"/></joint></robot>"""


def test_a_gripper_that_has_become_a_joint_is_told_and_left_out_by_its_tip() -> None:
    text = without_mesh().replace("</robot>", GRIPPER)
    told = '`jointGripper`, by its name a gripper\'s, is joint 3 of the arm; tip = "tool" leaves it out'
    report = arms.read_urdf(text, collision="none")
    assert report.warnings == (told,) and f"odd: {told}" in str(report)
    assert len(report.document["joints"]) == 3
    left_out = arms.read_urdf(text, tip="tool", collision="none")
    assert len(left_out.document["joints"]) == 2 and "by its name" not in str(left_out)


def test_links_without_shapes_are_told() -> None:
    report = arms.read_urdf(without_mesh().replace("</robot>", GRIPPER))
    assert "no shape on `jaw`: nothing avoids it" in report.warnings
    assert not any("no shape" in each for each in arms.read_urdf(without_mesh()).warnings)


def test_possible_tips_are_ranked() -> None:
    """Names of tools first, then those with most joints on the way, fingers and cameras last."""
    ends = {
        "camera_link": "lower",
        "pin": "base",
        "left_finger": "tool",
        "right_hand": "base",
        "long": "lower",
    }
    more = "".join(
        f'<link name="{end}"/><joint name="to_{end}" type="fixed"><parent link="{on}"/><child link="{end}"/></joint>'
        for end, on in ends.items()
    )
    told = "leads to 5 ends, likely ones first: `right_hand`, `long`, `pin`, `left_finger`, `camera_link`; name one"
    with pytest.raises(InputError, match=told):
        arms.read_urdf(without_mesh().replace("</robot>", f"{more}</robot>"))


def test_rotors_that_outweigh_their_links_are_told() -> None:
    told = str(arms.read_urdf(without_mesh(), armature=[0.01, 4.0], collision="none"))
    assert "armature" in told and "0.01 kg·m²" in told and "4 kg·m²" in told
    heavy = next(line for line in told.splitlines() if line.startswith("armature is most"))
    assert (
        "elbow 9" in heavy and "shoulder" not in heavy and heavy.endswith("a push hardly moves these links")
    )
    assert "armature" not in str(arms.read_urdf(without_mesh(), collision="none"))


def test_pairs_that_always_touch_are_ignored_and_told() -> None:
    text = without_mesh().replace('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 0.01"/>')
    text = text.replace('<sphere radius="0.1"/>', '<sphere radius="0.6"/>')
    report = arms.read_urdf(text)
    assert report.touching == (("base", "lower"),)
    assert report.document["ignore"] == [["base", "lower"]]
    with pytest.warns(ScenarioWarning, match="`base` and `lower` overlap .* the pair is ignored"):
        arms.from_urdf(text)
    srdf = "<robot name='two'><disable_collisions link1='base' link2='lower' reason='Adjacent'/></robot>"
    report = arms.read_urdf(text, srdf=srdf)
    assert (report.touching, report.document["ignore"]) == ((), [["base", "lower"]])
    assert not report.warnings
    # An SRDF that keeps the pair is not overruled.
    report = arms.read_urdf(text, srdf="<robot name='two'/>")
    assert report.touching == () and "ignore" not in report.document
    assert "the SRDF keeps the pair" in report.warnings[0]


def test_a_pair_that_touches_in_one_posture_is_measured() -> None:
    """A ball on the forearm that meets one on the base in the middle of all ranges, and hardly anywhere else."""
    text = """<robot name="fold">
      <link name="base"><collision><origin xyz="0 0 0.9"/><geometry><sphere radius="0.1"/></geometry></collision></link>
      <link name="upper"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial></link>
      <link name="fore"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>
        <collision><origin xyz="0 0 0.4"/><geometry><sphere radius="0.1"/></geometry></collision></link>
      <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="50" velocity="3"/></joint>
      <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="50" velocity="3"/></joint>
    </robot>"""
    for srdf in (None, "<robot name='fold'/>"):
        report = arms.read_urdf(text, srdf=srdf)
        assert report.touching == () and "ignore" not in report.document
        scenario = {
            "arm": report.document,
            "duration": 0.01,
            "q0": [0.0, 0.0],
            "reference": {"kind": "setpoint"},
            "controller": {"self_collision": "report"},
        }
        # The spheres are 0.1 m apart, with radii of 0.1 m: the law, the barrier and a plan see 0.1 m of overlap.
        assert simulate(scenario).metrics.min_self_clearance == pytest.approx(-0.1, abs=1e-3)
        found = plan(scenario, [0.5, 0.5])
        assert found.status == "start blocked" and "`fore`" in found.message


# --------------------------------------------------------------------------------------- what is refused


def test_refusals_reach_python_as_sentences(tmp_path: Path) -> None:
    text = without_mesh()
    refused("no link `toool`|did you mean `tool`?", text, tip="toool")
    refused("no joint moves", text, tip="base")
    refused("is floating", text.replace('"continuous"', '"floating"'))
    refused("is planar", text.replace('"continuous"', '"planar"'))
    refused("triangle inequality|fix_inertia=True", text.replace('izz="0.025"', 'izz="0.25"'))
    refused(
        "has no mass",
        text.replace('<mass value="1"/>', '<mass value="0"/>')
        .replace("0.025", "0.0")
        .replace('ixx="0.01" iyy="0.02"', 'ixx="0" iyy="0"'),
    )
    refused("circle", text.replace('<parent link="base"/>', '<parent link="tool"/>'))
    refused("length 1", text.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 1"/>'))
    refused("must be finite", text.replace('effort="50"', 'effort="inf"'))
    refused("not well-formed", text[:-20])
    refused(
        "entities",
        "<!DOCTYPE robot [<!ENTITY x SYSTEM 'file:///etc/passwd'>]>" + text.replace("two", "&x;", 1),
    )
    bomb = "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 12))
    refused("entities", f"<!DOCTYPE robot [<!ENTITY a0 'ha'>{bomb}]><robot name='&a11;'/>")
    refused("use from_mjcf", "<mujoco/>")
    refused("No such file", tmp_path / "none.urdf")
    refused("directory", tmp_path)
    refused("srdf: ", text, srdf=tmp_path)
    refused("the SRDF is a URDF", text, srdf=text)
    refused("expected a dict", text, locked=[1], error=InputTypeError)
    refused("expected a path or text", 3, error=InputTypeError)
    refused("expected 3 numbers", text, gravity=[1])
    refused("expected numbers", text, armature="much", error=InputTypeError)
    refused("mount.orientation|length 1", text, mount=((0, 0, 0), (1, 0, 0, 1)))
    refused("unknown key 'place'", text, mount={"place": 1})
    refused("'fit', 'file' or 'none'", text, collision="fitt")
    (tmp_path / "binary.urdf").write_bytes(bytes(range(256)))
    refused("no file of text in UTF-8", tmp_path / "binary.urdf")


@pytest.mark.parametrize("name", ["tool", "mount"])
def test_a_quaternion_of_another_length_is_refused(name: str) -> None:
    """As that of an explicit arm: it is told of and not made one of length 1."""
    text = without_mesh()
    told = f"{name}.orientation: must have length 1 (within 0.01), has "
    refused(told + str(math.sqrt(2.0)), text, **{name: {"orientation": [1, 1, 0, 0]}})
    refused(told + "0", text, **{name: ([0, 0, 0.1], [0, 0, 0, 0])})
    refused(f"{name}.orientation: must be finite", text, **{name: {"orientation": [math.nan, 0, 0, 0]}})
    arms.read_urdf(text, collision="none", **{name: ([0, 0, 0.1], [1.005, 0, 0, 0])})


def test_what_is_said_yes_to_is_no_text_and_a_position_no_truth() -> None:
    text = without_mesh()
    wrong: Any = "no"  # which Python takes for a yes
    refused("fix_inertia: expected true or false, got str", text, fix_inertia=wrong, error=InputTypeError)
    locked = {"elbow": True}
    refused("locked['elbow']: expected a number, not a bool", text, locked=locked, error=InputTypeError)
    told = "arm.urdf: fix_inertia: expected true or false, got int"
    with pytest.raises(ScenarioError, match=told):
        Scenario.from_dict({"arm": {"urdf": text, "fix_inertia": 1}})


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("tool", 0.1, "tool: expected a position, (position, quaternion), or a dict of both, got float"),
        ("mount", 1.2, "mount: expected a position, (position, quaternion), or a dict of both, got float"),
        ("mount", True, "mount: expected a position, (position, quaternion), or a dict of both, got bool"),
        ("tool", [0, 1], "tool: expected a position, (position, quaternion), or a dict of both, got list"),
        ("tip", 3, "tip: expected the name of a link, got int"),
        ("base", ["a"], "base: expected the name of a link, got list"),
        ("tool", "up", "tool: expected a position, (position, quaternion), or a dict of both, got str"),
        ("packages", 3, "packages: expected a path, a list of paths, or a dict, got int"),
        ("packages", [1], "packages[0]: expected a path, got int"),
        ("packages", {"a": 3}, "packages['a']: expected a path, got int"),
    ],
)
def test_what_is_no_placement_and_no_folder_is_told_by_its_name(key: str, value: Any, told: str) -> None:
    text = without_mesh()
    assert refused(told, text, **{key: value}, error=InputTypeError) == told
    with pytest.raises(ScenarioError) as caught:
        Scenario.from_dict({"arm": {"urdf": text, key: value}})
    assert str(caught.value) == f"arm.urdf: {told}"


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("ignore", 3, "arm.ignore: expected a list, got integer `3`"),
        ("ignore", [3], "arm.ignore[0]: expected a list of 2 values, got integer `3`"),
        ("payload", "x", 'arm.payload: expected a number, got string "x"'),
        ("joint_limits", 3, "arm.joint_limits: expected a list, got integer `3`"),
        ("collision", 3, "arm.collision: expected a list, got integer `3`"),
        ("collision", [3], "arm.collision[0]: expected a table, got integer `3`"),
    ],
)
def test_what_stands_beside_a_urdf_is_told_of_as_in_an_explicit_arm(key: str, value: Any, told: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        Scenario.from_dict({"arm": {"urdf": without_mesh(), key: value}})
    assert str(caught.value) == told


def test_a_file_of_100_mb_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "large.urdf"
    with path.open("wb") as file:
        file.truncate(100 << 20)
    refused("104857600 bytes|at most 16777216", path)


def test_quaternions_and_axes_are_normalised_only_where_rounding_explains_it() -> None:
    text = without_mesh().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0.69 0.70"/>')
    refused("length 1", text)
    arm = arms.read_urdf(text.replace("0.69 0.70", "0.7071 0.7072"), collision="none").document
    assert abs(np.linalg.norm(arm["joints"][0]["axis"]) - 1) < 1e-15
    for key, good in (("orientation", [0.5, 0.5, 0.5, 0.504]), ("axis", [0.0, 0.0, 1.005])):
        changed = json.loads(json.dumps(arm))
        changed["joints"][1][key] = good
        assert abs(np.linalg.norm(_core.check_arm(changed)["joints"][1][key]) - 1) < 1e-15
        changed["joints"][1][key] = [1.02 * x for x in good]
        with pytest.raises(InputError, match=rf"joints\[1\]\.{key}: must have length 1"):
            _core.check_arm(changed)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("joints", 0, "mass"), 0.0, r"joints\[0\].mass: must be finite and > 0"),
        (("joints", 0, "com"), [0, math.nan, 0], r"joints\[0\].com: must be finite"),
        (("joints", 1, "inertia"), [1, 1, 3, 0, 0, 0], r"joints\[1\].inertia: .*triangle inequality"),
        (("joints", 1, "armature"), -1.0, r"joints\[1\].armature: must be finite and ≥ 0"),
        (("joints", 1, "name"), "shoulder", r"joints: `shoulder` is there twice"),
        (("joints", 1, "kind"), "planar", r"planar"),
        (("joints",), [], r"at least one joint"),
        (("joint_limits",), [[1, 0], [0, 1]], r"joint_limits\[0\]: must be lower < upper"),
        (("joint_limits",), [[0, 1]], r"joint_limits: expected 2 values"),
        (("torque_limits",), [1, 0], r"torque_limits\[1\]: must be > 0"),
        (("gravity",), [0, 0, math.inf], r"gravity: must be finite"),
        (
            ("collision",),
            [{"link": "uper", "shape": {"kind": "sphere", "center": [0, 0, 0], "radius": 1}}],
            r"collision\[0\].link: there is no link `uper`, did you mean `upper`",
        ),
        (
            ("collision",),
            [{"link": "upper", "shape": {"kind": "sphere", "center": [0, 0, 0], "radius": 0}}],
            r"collision\[0\].shape.radius",
        ),
        (("collision",), [{"link": "upper", "shape": {"kind": "cone"}}], r"cone"),
        (("ignore",), [["upper", "x"]], r"ignore\[0\]: there is no link `x`"),
        (("tools",), 1, r"tools"),
    ],
)
def test_explicit_descriptions_are_judged(path: tuple[Any, ...], value: Any, words: str) -> None:
    arm: Any = arms.read_urdf(without_mesh(), collision="none").document
    at = arm
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    with pytest.raises(InputError, match=words):
        _core.check_arm(arm)


def test_a_link_that_its_joint_cannot_accelerate_is_refused() -> None:
    point = without_mesh().replace('ixx="0.01" iyy="0.02" izz="0.025"', 'ixx="0" iyy="0" izz="0"')
    refused("`lower`, the last link, has no inertia", point.replace('<origin xyz="0.1 0 0"/>', ""))
    assert arms.read_urdf(point.replace('<origin xyz="0.1 0 0"/>', ""), armature=0.01, collision="none")


# -------------------------------------------------------------------------------- against other readers


# Why a chain of a published model may be refused.
FAULTS = (
    "no distribution of mass", "no mass", "mimics", "no joint moves", "is floating", "is planar", "no room",
    "has no inertia",
)  # fmt: skip


def compare(arm: dict[str, Any], locked: dict[str, float], model: Any, tip: str) -> None:
    """Mass matrix, gravity and tip against Pinocchio's reduced model."""
    reduced = reduced_to(model, arm, locked)
    data = reduced.createData()
    rng = np.random.default_rng(1)
    for _ in range(3):
        q = rng.uniform(-2, 2, len(arm["joints"]))
        whole = coordinates(reduced, q)
        M, g = mass_and_gravity(arm, q)
        pin.crba(reduced, data, whole)
        theirs = np.triu(data.M) + np.triu(data.M, 1).T - np.diag(reduced.armature)
        weight = pin.computeGeneralizedGravity(reduced, data, whole)
        assert np.abs(M - theirs).max() <= 1e-11 * np.abs(theirs).max()
        moment = sum(joint["mass"] for joint in arm["joints"]) * 9.81
        assert np.abs(g - weight).max() <= 1e-11 * max(np.abs(weight).max(), moment)
        pin.framesForwardKinematics(reduced, data, whole)
        placement = data.oMf[reduced.getFrameId(tip, pin.FrameType.BODY)].homogeneous
        assert np.abs(poses(arm, q)[-1] - placement).max() <= 1e-11


@pytest.mark.skipif(not MODELS, reason="pip install example-robot-data")
@pytest.mark.parametrize("path", MODELS, ids=lambda path: f"{path.parents[1].name}-{path.stem}")
def test_published_models_are_those_of_pinocchio(path: Path) -> None:
    try:
        model = pin.buildModelFromUrdf(str(path))
    except Exception as fault:
        pytest.skip(f"Pinocchio refuses it: {fault}")
    compared, said = 0, []
    for tip in chains(model):
        try:
            report = arms.read_urdf(path, tip=tip, collision="none")
        except InputError as fault:
            assert any(words in str(fault) for words in FAULTS), fault
            said.append(str(fault))
            continue
        compare(report.document, dict(report.locked), model, tip)
        compared += 1
        if compared == 8:
            break
    assert compared or said
    if not compared:
        pytest.skip(said[0])


def test_locked_and_fixed_joints_merge_as_in_pinocchio() -> None:
    """The same without a wheel: a random tree with side branches, everything off the chain locked."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        text, tip, locked = random_tree(rng)
        report = arms.read_urdf(text, tip=tip, locked=locked, collision="none")
        assert set(locked) <= set(report.locked)
        compare(report.document, dict(report.locked), pin.buildModelFromXML(text), tip)


def random_tree(rng: np.random.Generator) -> tuple[str, str, dict[str, float]]:
    links, joints, locked = ["<link name='l0'/>"], [], {}
    chain = [0]
    for i in range(1, 14):
        side = i > 1 and rng.random() < 0.5
        parent = int(rng.choice(i)) if side else chain[-1]
        kind = str(rng.choice(["revolute", "prismatic", "continuous", "fixed"]))
        if side:
            if kind != "fixed" and rng.random() < 0.7:
                locked[f"j{i}"] = float(rng.uniform(-1, 1))
        else:
            chain.append(i)
            kind = "revolute" if i == 1 else kind
        root = rng.normal(size=(3, 3))
        inertia = np.trace(root @ root.T) * np.eye(3) - root @ root.T
        numbers = (
            " ".join(
                f"{key}='{inertia[a, b]!r}'"
                for key, a, b in (
                    ("ixx", 0, 0),
                    ("iyy", 1, 1),
                    ("izz", 2, 2),
                    ("ixy", 0, 1),
                    ("ixz", 0, 2),
                    ("iyz", 1, 2),
                )
            )
            .replace("np.float64(", "")
            .replace(")", "")
        )
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        links.append(
            f"<link name='l{i}'><inertial>{origin(rng)}<mass value='{rng.uniform(0.1, 3)}'/><inertia {numbers}/>"
            "</inertial></link>"
        )
        joints.append(
            f"<joint name='j{i}' type='{kind}'><parent link='l{parent}'/><child link='l{i}'/>{origin(rng)}"
            f"<axis xyz='{' '.join(map(str, axis))}'/><limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
        )
    return f"<robot name='random'>{''.join(links + joints)}</robot>", f"l{chain[-1]}", locked


def origin(rng: np.random.Generator) -> str:
    xyz, rpy = (" ".join(map(str, rng.uniform(-1, 1, 3))) for _ in range(2))
    return f"<origin xyz='{xyz}' rpy='{rpy}'/>"


# ------------------------------------------------------------------------------------------- round trips


def assert_same(first: dict[str, Any], second: dict[str, Any], rng: np.random.Generator) -> None:
    n = len(first["joints"])
    assert [j["name"] for j in first["joints"]] == [j["name"] for j in second["joints"]]
    for _ in range(3):
        q = rng.uniform(-2, 2, n)
        for ours, theirs in zip(mass_and_gravity(first, q), mass_and_gravity(second, q), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * max(np.abs(ours).max(), 1))
        np.testing.assert_allclose(poses(first, q)[-1], poses(second, q)[-1], atol=1e-12)
    for key in ("joint_limits", "torque_limits"):
        np.testing.assert_allclose(first.get(key, []), second.get(key, []), rtol=1e-15)
    for key in ("damping", "friction"):
        assert [j[key] for j in first["joints"]] == [j[key] for j in second["joints"]]


def capsules(arm: dict[str, Any]) -> list[tuple[Any, ...]]:
    out = []
    for item in arm["collision"]:
        shape = item["shape"]
        ends = [shape["a"], shape["b"]] if shape["kind"] == "capsule" else [shape["center"]] * 2
        ends.sort(key=lambda end: [round(x, 3) for x in end])
        out.append((item["link"], np.array(ends), shape["radius"]))
    return sorted(out, key=lambda each: (each[0], round(each[2], 3), np.round(each[1], 3).tolist()))


@pytest.mark.parametrize("name", arms.names())
def test_bundled_arms_survive_urdf(name: str) -> None:
    arm = arms.named(name) | {"mount": {"position": [1.0, -2.0, 0.5], "orientation": [0.5, -0.5, 0.5, 0.5]}}
    text = arms.to_urdf(arm)
    mount = (arm["mount"]["position"], arm["mount"]["orientation"])
    again = arms.read_urdf(text, base=arm["base"], tip=arm["tip"], mount=mount, collision="none").document
    assert_same(arm, again, np.random.default_rng(0))
    assert again["velocity_limits"] == arm["velocity_limits"]


@pytest.mark.parametrize("name", arms.names())
def test_bundled_arms_survive_mjcf(name: str) -> None:
    arm = arms.named(name)
    arm["joints"][0] |= {"armature": 0.1, "damping": 0.5, "friction": 0.2}
    again = arms.read_mjcf(arms.to_mjcf(arm), base=arm["base"], tip=arm["tip"]).document
    assert_same(arm, again, np.random.default_rng(0))
    assert again["joints"][0]["armature"] == 0.1
    for ours, theirs in zip(capsules(arm), capsules(again), strict=True):
        assert ours[0] == theirs[0]
        np.testing.assert_allclose(ours[1], theirs[1], atol=1e-6)
        np.testing.assert_allclose(ours[2], theirs[2], atol=1e-6)


def test_any_arm_survives() -> None:
    """Random chains of every kind of joint with friction and rotors, some with an end on one side alone."""
    rng = np.random.default_rng(7)
    for n in range(1, 13):
        arm = random_arm(rng, n)
        for joint in arm["joints"]:
            joint |= {"damping": float(rng.uniform(0, 1)), "friction": float(rng.uniform(0, 1))}
        ends = {"revolute": [-1.0, 2.0], "prismatic": [-0.1, 0.4], "continuous": [-math.inf, math.inf]}
        arm["joint_limits"] = [ends[joint["kind"]] for joint in arm["joints"]]
        arm["torque_limits"] = rng.uniform(1, 100, n).tolist()
        arm = _core.check_arm(arm)
        base, tip = arm["base"], arm["tip"]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ScenarioWarning)
            read = arms.read_urdf(arms.to_urdf(arm), tip=tip, gravity=arm["gravity"], collision="none")
            armature = [joint["armature"] for joint in arm["joints"]]
            assert_same(arm, with_armature(read.document, armature), rng)
            turning = [i for i, joint in enumerate(arm["joints"]) if joint["kind"] == "revolute"]
            for i in turning:
                arm["joint_limits"][i] = [-math.inf, 2.0] if i % 2 else [-1.0, math.inf]
            assert_same(arm, arms.read_mjcf(arms.to_mjcf(arm), tip=tip, base="world").document, rng)
            far = arms.read_urdf(arms.to_urdf(arm), tip=tip, base=base, collision="none").document
        for i in turning:  # URDF has a number there
            lower, upper = far["joint_limits"][i]
            assert (lower <= -1e9, upper) == (True, 2.0) if i % 2 else (lower, upper >= 1e9) == (-1.0, True)


def with_armature(arm: dict[str, Any], armature: list[float]) -> dict[str, Any]:
    """An arm with what URDF cannot hold."""
    joints = [joint | {"armature": of} for joint, of in zip(arm["joints"], armature, strict=True)]
    return arm | {"joints": joints}


def test_a_fitted_urdf_comes_back_with_its_capsules() -> None:
    rods = without_mesh().replace('<box size="0.2 0.2 0.1"/>', '<cylinder radius="0.1" length="0.3"/>')
    arm = arms.read_urdf(rods).document
    again = arms.read_urdf(arms.to_urdf(arm), tip="tool").document
    for ours, theirs in zip(capsules(arm), capsules(again), strict=True):
        # What was written as cylinder and balls is one capsule again, a prism's corners larger.
        np.testing.assert_allclose(ours[1], theirs[1], atol=5e-3)
        np.testing.assert_allclose(ours[2], theirs[2], rtol=5e-3)


def test_what_urdf_cannot_hold_is_told(folder: Path) -> None:
    arm = arms.read_urdf(folder / "urdf" / "two.urdf", collision="file", armature=0.1).document
    with pytest.warns(ScenarioWarning, match="armature and convex hulls"):
        arms.to_urdf(arm)


# -------------------------------------------------------------------------------------------------- MJCF

HINGES = """<mujoco model="three"><compiler angle="radian" autolimits="true"/><option gravity="0 0 -3.7"/>
  <worldbody><body name="stand" pos="0 0 1"><geom size="0.05"/>
    <body name="a" pos="0.1 0 0" quat="0.8 0.6 0 0"><joint name="one" axis="0 1 0" pos="0 0.1 0.2" ref="0.3" range="-1 1"
        armature="0.02" damping="0.5" frictionloss="0.1"/>
      <inertial pos="0.1 0 0" mass="1" fullinertia="0.01 0.02 0.025 0.001 0 0"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.04"/>
      <body name="b" pos="0.4 0 0"><joint name="two" type="slide" axis="1 0 0" ref="0.05" range="-0.2 0.2"/>
        <inertial pos="0 0 0.1" mass="0.5" diaginertia="0.001 0.001 0.001"/>
        <geom type="box" size="0.05 0.04 0.03" pos="0 0 0.1"/>
        <body name="finger" pos="0 0 0.1"><joint name="grip" type="slide" axis="0 1 0" range="0 0.04"/>
          <inertial pos="0 0 0" mass="0.1" diaginertia="1e-5 1e-5 1e-5"/></body>
        <site name="tcp" pos="0.1 0 0.2" quat="0 1 0 0"/></body></body></body></worldbody>
  <actuator><motor joint="one" ctrlrange="-2 2" gear="10"/><motor joint="two" forcerange="-5 5"/></actuator></mujoco>"""


def test_mjcf_is_what_mujoco_simulates() -> None:
    report = arms.read_mjcf(HINGES, base="stand", tip="tcp", locked={"grip": 0.03})
    arm = report.document
    assert [joint["kind"] for joint in arm["joints"]] == ["revolute", "prismatic"]
    assert arm["gravity"] == [0.0, 0.0, -3.7]
    assert arm["torque_limits"] == [20.0, 5.0]
    assert arm["joints"][0]["armature"] == 0.02
    assert arm["joints"][0]["damping"] == 0.5
    assert arm["joints"][0]["friction"] == 0.1
    model = mujoco.MjModel.from_xml_string(HINGES)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = rng.uniform(-1, 1, 2)
        data.qpos[:] = [*q, 0.03]
        mujoco.mj_forward(model, data)
        M = np.zeros((3, 3))
        mujoco.mj_fullM(model, data, M) if mujoco_takes_data() else mujoco.mj_fullM(model, M, data.qM)
        ours, g = mass_and_gravity(arm, q)
        np.testing.assert_allclose(ours, M[:2, :2], rtol=0, atol=1e-12)
        np.testing.assert_allclose(g, data.qfrc_bias[:2], rtol=0, atol=1e-12)
        tip = poses(arm, q)[-1]
        stand = np.array([0.0, 0.0, 1.0])
        np.testing.assert_allclose(tip[:3, 3] + stand, data.site("tcp").xpos, atol=1e-12)
        np.testing.assert_allclose(tip[:3, :3].ravel(), data.site("tcp").xmat, atol=1e-12)


@pytest.mark.parametrize(
    ("motors", "limit", "told"),
    [
        ('<motor joint="one" forcerange="-5 50"/>', 5.0, "`one` give -5 to 50: the less is taken"),
        (
            '<motor joint="one" gear="50" ctrlrange="0 1"/>',
            50.0,
            "`one` give 0 to 50: they push one way alone",
        ),
        ('<motor joint="one" gear="-100" ctrlrange="-1 1" forcerange="-5000 5000"/>', 100.0, ""),
        ('<motor joint="one" gear="100" ctrlrange="-80 80" forcerange="-5 5"/>', 500.0, ""),
        (
            '<motor joint="one" gear="50" ctrlrange="0 1"/><motor joint="one" gear="-20" ctrlrange="0 1"/>',
            20.0,
            "`one` give -20 to 50",
        ),
        ('<motor jointinparent="one" gear="50" ctrlrange="-1 1"/>', 50.0, ""),
        ('<position joint="one" kp="100" ctrlrange="-1 1" forcerange="-30 30"/>', 30.0, ""),
        ('<motor joint="one" forcerange="-30 30"/><motor joint="one"/>', 1e5, ""),  # none
    ],
)
def test_mjcf_limits_of_torque_are_those_of_the_actuators(motors: str, limit: float, told: str) -> None:
    """In both directions, as MuJoCo gives them for every corner of what its controls may be."""
    start, end = HINGES.index("<actuator>"), HINGES.index('<motor joint="two"')
    given = HINGES[:start] + "<actuator>" + motors + HINGES[end:]
    report = arms.read_mjcf(given, base="stand", tip="tcp", locked={"grip": 0.03})
    assert report.document["torque_limits"][0] == limit
    said = [warning for warning in report.warnings if "actuators" in warning]
    assert (told in said[0] and len(said) == 1) if told else not said
    model = mujoco.MjModel.from_xml_string(given)
    data, found = mujoco.MjData(model), []
    for corner in itertools.product([-1e6, 1e6], repeat=model.nu):
        data.ctrl[:] = corner
        mujoco.mj_forward(model, data)
        found.append(data.qfrc_actuator[0])
    if limit < 1e5 and "one way" not in told:
        assert min(-min(found), max(found)) == pytest.approx(limit)


@pytest.mark.parametrize(
    ("motor", "joint", "flag", "told"),
    [
        ('armature="0.05"', "", "", ""),
        ('damping="0.02"', "", "", ""),
        ("", "", '<flag damper="disable"/>', ""),
        ("", "", '<flag frictionloss="disable"/>', ""),
        ("", 'damping="0.5 0.1"', "", "faster than the speed"),
        ("", 'stiffness="0 5"', "", "springs"),
        ("", "", '<option density="1.2"/>', "air or water"),
    ],
)
def test_mjcf_of_what_slows_a_joint(motor: str, joint: str, flag: str, told: str) -> None:
    """Inertia and damping of actuators, by the square of their gear, as MuJoCo has them; what is left out is told."""
    given = HINGES.replace('gear="10"/>', f'gear="10" {motor}/>')
    if joint:
        given = given.replace('damping="0.5"', joint if "damping" in joint else f'damping="0.5" {joint}')
    if flag:
        option = flag if "option" in flag else f"<option>{flag}</option>"
        given = given.replace("<worldbody>", f"{option}<worldbody>", 1)
    try:
        model = mujoco.MjModel.from_xml_string(given)
    except ValueError:
        pytest.skip("a MuJoCo that does not know it")
    report = arms.read_mjcf(given, base="stand", tip="tcp", locked={"grip": 0.03})
    usual = arms.read_mjcf(HINGES, base="stand", tip="tcp", locked={"grip": 0.03}).warnings
    more = [warning for warning in report.warnings if warning not in usual]
    assert any(told in warning for warning in more) if told else not more
    if told:
        return
    joints, data, dq = report.document["joints"], mujoco.MjData(model), [2.0, 0.0]
    data.qpos[:], data.qvel[:2] = [0.3, 0.1, 0.03], dq
    mujoco.mj_forward(model, data)
    M = np.zeros((3, 3))
    mujoco.mj_fullM(model, data, M) if mujoco_takes_data() else mujoco.mj_fullM(model, M, data.qM)
    ours, _ = mass_and_gravity(report.document, [0.3, 0.1])
    np.testing.assert_allclose(ours, M[:2, :2], rtol=0, atol=1e-12)
    damped = [joint["damping"] * speed for joint, speed in zip(joints, dq, strict=True)]
    np.testing.assert_allclose(damped, -data.qfrc_damper[:2], rtol=0, atol=1e-12)
    assert joints[0]["friction"] == (0.0 if "frictionloss" in flag else 0.1)


def test_mjcf_of_a_base_that_is_called_world_and_a_site_that_is_called_as_its_body() -> None:
    """MuJoCo has a world of its own; which of both is the tip is told."""
    named = HINGES.replace('name="stand"', 'name="floor"').replace('name="tcp"', 'name="b"')
    report = arms.read_mjcf(named, base="floor", tip="b", locked={"grip": 0.03})
    assert any("`b` is a body and a site" in warning for warning in report.warnings)
    of_site = arms.read_mjcf(named, base="floor", tip="b (site)", locked={"grip": 0.03}).document
    tcp = arms.read_mjcf(HINGES, base="stand", tip="tcp", locked={"grip": 0.03}).document
    np.testing.assert_array_equal(poses(of_site, [0.1, 0.1])[-1], poses(tcp, [0.1, 0.1])[-1])
    assert np.abs(poses(report.document, [0.1, 0.1])[-1] - poses(tcp, [0.1, 0.1])[-1]).max() > 0.1
    document = {**tcp, "base": "world", "ignore": [["world", "a"]]}
    for pair in document["collision"]:
        pair["link"] = pair["link"].replace("stand", "world")
    model = mujoco.MjModel.from_xml_string(arms.to_mjcf(document))
    assert model.body(1).name == "base" and model.nexclude == 1


def mujoco_takes_data() -> bool:
    return not hasattr(mujoco.MjData, "qM")


def test_mjcf_refusals() -> None:
    with pytest.raises(InputError, match="cannot compile"):
        arms.read_mjcf("<mujoco><worldbody><body/></worldbody></mujoco>".replace("<body/>", "<bodi/>"))
    with pytest.raises(InputError, match="is floating"):
        arms.read_mjcf(
            HINGES.replace('<body name="stand" pos="0 0 1">', '<body name="stand"><freejoint/>'), tip="b"
        )
    with pytest.raises(InputError, match=r"`b after grip`|has no mass"):
        two = HINGES.replace('<joint name="two"', '<joint name="more" axis="0 0 1"/><joint name="two"')
        arms.read_mjcf(two, base="stand", tip="tcp")
    with pytest.raises(InputTypeError, match="expected a path, text or MjModel"):
        arms.read_mjcf(3)
    with pytest.raises(InputError, match="no link `tpc`"):
        arms.read_mjcf(mujoco.MjModel.from_xml_string(HINGES), tip="tpc")


# ---------------------------------------------------------------------------------------------- capsules


@pytest.mark.parametrize("seed", range(20))
def test_no_capsule_is_smaller_than_is_possible(seed: int) -> None:
    """What is joined is decided by a bound that takes no search."""
    from vffnull.arms._capsules import _at_least, _dotted, least_capsule, volume

    rng = np.random.default_rng(seed)
    points = rng.normal(size=(int(rng.integers(2, 30)), 3)) * rng.uniform(0.01, 1.0, 3)
    assert _at_least(points) <= volume(*least_capsule(points)) * (1 + 1e-9)
    radii = rng.uniform(0.0, 0.3, len(points))
    assert _at_least(_dotted(points, radii)) <= volume(*least_capsule(points, radii)) * (1 + 1e-9)
    assert _at_least(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])) == 0.0


def test_few_capsules_are_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 16 pieces there are 120 pairs; of most it is seen at once that they do not go together."""
    from vffnull.arms import _capsules
    from vffnull.arms._capsules import Solid, fit_solids

    searched: list[int] = []
    search = _capsules.least_capsule
    monkeypatch.setattr(_capsules, "least_capsule", lambda *of: searched.append(1) or search(*of))
    tops = np.eye(3)
    rods = [
        Solid.cylinder(f"{row} {k}", 0.05, 0.1, 12).moved(tops, np.array([1.0 * row, 0.0, 0.1 * k]))
        for row in range(4)
        for k in range(4)
    ]
    fits = fit_solids("x", rods)
    assert sorted(len(fit.parts) for fit in fits) == [4, 4, 4, 4]
    assert len(searched) < 16 + 50


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1e-3, 1.0, 50.0]))
def test_capsules_contain_every_point(seed: int, count: int, scale: float) -> None:
    from vffnull.arms._capsules import least_capsule, protrusion, volume

    rng = np.random.default_rng(seed)
    points = scale * rng.normal(size=(count, 3)) * rng.uniform(0, 1, 3) ** 3 + rng.normal(size=3)
    radii = scale * rng.uniform(0, 0.2, count)
    a, b, radius = least_capsule(points, radii)
    assert protrusion(points, radii, a, b, radius) <= 1e-12 * max(scale, 1)
    middle = points.mean(axis=0)
    ball = float(np.max(np.linalg.norm(points - middle, axis=1) + radii))
    assert volume(a, b, radius) <= volume(middle, middle, ball) * (1 + 1e-9) + 1e-30


def test_the_least_capsule_of_known_bodies() -> None:
    from vffnull.arms._capsules import Solid, fit_solids

    (rod,) = fit_solids("x", [Solid.capsule("rod", 0.05, 0.3)])
    assert rod.tightness == pytest.approx(1.0, abs=1e-9)
    (ball,) = fit_solids("x", [Solid.capsule("ball", 0.05, 0.0)])
    assert ball.shape["kind"] == "sphere"
    (flat,) = fit_solids("x", [Solid.box("plate", (0.3, 0.2, 0.01))])  # any capsules waste more than a litre
    assert flat.shape["kind"] == "convex" and flat.tightness == pytest.approx(1.0)
    together = fit_solids(
        "x", [Solid.box("half", (0.05, 0.05, 0.2)), Solid.box("other half", (0.05, 0.05, 0.2))]
    )
    assert len(together) == 1
    assert together[0].parts == ("half", "other half")


def test_a_bent_part_is_split_and_its_surface_stays_inside() -> None:
    import trimesh

    from vffnull.arms._capsules import Solid, fit_solids

    pieces = [
        trimesh.creation.box((0.08, 0.08, 0.5)),
        trimesh.creation.box((0.5, 0.08, 0.08)).apply_translation((0.25, 0, 0.25)),
    ]
    bent = trimesh.util.concatenate(pieces)
    fits = fit_solids("elbow", [Solid.mesh("bent", np.array(bent.vertices), np.array(bent.faces))])
    assert 2 <= len(fits) <= 3
    surface = trimesh.sample.sample_surface(bent, 4000, seed=0)[0]
    gaps = []
    for fit in fits:
        a, b = np.array(fit.shape["a"]), np.array(fit.shape["b"])
        share = np.clip((surface - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        gaps.append(np.linalg.norm(surface - a - share[:, None] * (b - a), axis=1) - fit.shape["radius"])
    assert np.min(gaps, axis=0).max() <= 1e-9


# --------------------------------------------------------------------------------------- the command line


def vffnull(*args: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vffnull", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_command_line_lists_shows_and_checks(folder: Path) -> None:
    listed = vffnull("arms")
    assert listed.returncode == 0, listed.stderr
    assert all(name in listed.stdout for name in arms.names())
    assert [row["name"] for row in json.loads(vffnull("arms", "list", "--json").stdout)] == list(arms.names())
    shown = vffnull("arms", "show", "panda")
    assert "panda_joint7" in shown.stdout
    assert "Apache-2.0" in shown.stdout
    toml = vffnull("arms", "show", "ur5e", "--toml").stdout
    assert _core.check_arm(_core.parse_toml(toml, "ur5e")) == arms.named("ur5e")
    wrong = vffnull("arms", "show", "pandda")
    assert (wrong.returncode, "did you mean `panda`?" in wrong.stderr) == (2, True)
    file = folder / "urdf" / "two.urdf"
    checked = vffnull("arms", "check", file)
    assert checked.returncode == 0, checked.stderr
    assert "volume/hull" in checked.stdout
    data = json.loads(vffnull("arms", "check", file, "--json", "--lock", "elbow=0.5").stdout)
    assert data["locked"] == {"elbow": 0.5}
    arm = _core.parse_toml(vffnull("arms", "check", file, "--toml").stdout, "two")["arm"]
    assert _core.check_arm(arm) == arm
    wrong = vffnull("arms", "check", file, "--tip", "tol")
    assert (wrong.returncode, "did you mean `tool`?" in wrong.stderr) == (2, True)
    assert vffnull("arms", "check", folder / "none.urdf").returncode == 2
    assert vffnull("arms", "check", file, "--lock", "elbow").returncode == 2


def test_importing_arms_stays_light() -> None:
    code = "import sys, vffnull.arms as a; a.names(); print('numpy' in sys.modules, 'scipy' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "False"]


def test_friction_is_told_where_there_is_any() -> None:
    told = arms.describe(arms.read_urdf(without_mesh(), collision="none").document).splitlines()
    assert told[1].split()[4:8] == ["speed", "torque", "damping", "friction"]
    assert "0.5 N·m·s/rad  0.1 N·m" in told[2] and "0 N·m·s/rad    0 N·m" in told[3]
    arm = arms.named("ur5e")
    assert "damping" not in arms.describe(arm)
    arm["joints"][1] |= {"kind": "prismatic", "damping": 3.0}
    assert "3 N·s/m " in arms.describe(arm) and "friction" not in arms.describe(arm)


def test_no_warning_from_reading_a_report() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arms.read_urdf(without_mesh(), collision="none")


def test_a_joint_without_limits_beside_others() -> None:
    """A continuous joint needs none: it is told what it is taken for."""
    text = """<robot name="r"><link name="base"/>
    <link name="a"><inertial><mass value="1"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="b"><inertial><mass value="1"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="j1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
    <joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/>
      <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="2" effort="30"/></joint></robot>"""
    with pytest.warns(ScenarioWarning) as told:
        arm = Arm.from_urdf(text, collision="none")
    assert "no limit of speed for `j1`: taken for 100" in [str(each.message) for each in told]
    assert arm.velocity_limits.tolist() == [100.0, 2.0] and arm.torque_limits.tolist() == [1e5, 30.0]


def test_prefixes_that_nobody_declares_are_no_offence() -> None:
    """Simulators add elements of their own; macros that are left are told of all the same."""
    plain = without_mesh()
    more = plain.replace("</robot>", '<drake:loop drake:name="a"/><sensor:camera/></robot>')
    assert Arm.from_urdf("<!-- <a:b> --> " + more).to_dict() == Arm.from_urdf(plain).to_dict()
    refused("xacro", plain.replace("</robot>", "<xacro:part/></robot>"))
    refused("not well-formed", "<drake:robot")


def test_shapes_of_no_size_are_left_out_and_told() -> None:
    plain = without_mesh()
    shape = "<collision><geometry><{}/></geometry></collision></link>"
    for form in ('box size="0 0 0"', 'sphere radius="0"', 'cylinder radius="0" length="0"'):
        with pytest.warns(ScenarioWarning, match="has no size and is left out"):
            arm = Arm.from_urdf(plain.replace("</link>", shape.format(form), 1))
        assert arm.n == Arm.from_urdf(plain).n
    refused("must be > 0", plain.replace("</link>", shape.format('box size="0 1 1"'), 1))


def test_stops_that_are_far_away_are_none() -> None:
    """±1e16 rad was a range that an arm had to start in the middle of."""
    far = re.sub(r'lower="[^"]*" upper="[^"]*"', 'lower="-1e16" upper="1e16"', without_mesh())
    limits = Arm.from_urdf(far).joint_limits
    assert limits is None or not np.isfinite(np.array(limits, float)).any()


def test_what_is_repaired_is_possible_in_another_engine(tmp_path: Path) -> None:
    """Rounding left a quarter of the tensors impossible by so little that MuJoCo refused the arm."""
    mujoco = pytest.importorskip("mujoco")
    from scipy.spatial.transform import Rotation

    for seed in range(20):
        turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
        xx, xy, xz, yy, yz, zz = (turn @ np.diag([1e-3, 1e-3, 4e-3]) @ turn.T)[np.triu_indices(3)]
        tensor = f'ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"'
        text = re.sub(r'ixx="[^/]*/>', tensor + "/>", without_mesh())
        with pytest.warns(ScenarioWarning, match="nearest that is possible"):
            arm = Arm.from_urdf(text, fix_inertia=True)
        mujoco.MjModel.from_xml_string(arm.to_mjcf())
