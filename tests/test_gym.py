"""The Gymnasium environments: the interface, the spaces, the reward, and that many are the same as one."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import threading
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import vffnull as vff
from vffnull.engines.gym import ReachEnv, ReachVectorEnv
from waiting import HANG

NAME = "vffnull.engines.gym:vffnull/Reach-v0"
POSE: dict[str, Any] = {
    "controller.task": "pose",
    "reference": {"kind": "setpoint", "point": [4.0, 1.0, 0.3]},
    "measurement": {"position_noise": 1e-3, "delay": 3e-3},
}
EXACT: dict[str, Any] = {"start_noise": 0.0, "obstacle_noise": 0.0}
HITS: dict[str, Any] = {"overrides": {"controller.field.gain": 0.0, "duration": 8.0}, "period": 0.05}


@pytest.mark.parametrize("action", ["null_space", "torque"])
@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("sweep-through", None),
        ("sweep-through", POSE),
        ("paper-1", None),
        ("sweep-through", {"obstacles": []}),
        ("panda-sweep", {"duration": 0.5}),  # a pose in space
        ("panda-pointing", {"duration": 0.5}),
        ("ur5e-sweep", {"duration": 0.5}),  # a position in space
        ("gen3-circle", {"duration": 0.5}),  # joints without end, and a table
    ],
)
def test_gymnasium_s_own_check(action: Any, scenario: str, overrides: dict[str, Any] | None) -> None:
    """With warnings as errors: finite spaces, seeds, no array handed out twice."""
    env = gymnasium.make(NAME, scenario=scenario, overrides=overrides, action=action)
    check_env(env.unwrapped)
    observation, _ = env.reset(seed=3)
    done = False
    while not done:
        assert env.observation_space.contains(observation)
        observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
        done = terminated or truncated
    assert env.observation_space.contains(observation)


def test_no_action_leaves_the_law_alone() -> None:
    """Zero in the null space is the scenario's own run, to the last bit; the agent sees its state."""
    scenario = vff.Scenario.load("sweep-through")
    result = vff.simulate(scenario)
    env = ReachEnv(scenario, **EXACT)
    env.reset()
    rows = round(env.period / scenario["simulation"].get("dt", 1e-3))
    for k in range(1, 301):
        observation, _, _, _, info = env.step(np.zeros(6))
        part = {name: observation[where] for name, where in env.layout.items()}
        row = rows * k
        np.testing.assert_array_equal(part["dq"], result.dq[row])
        np.testing.assert_array_equal(part["tip"], result.x[row])
        np.testing.assert_array_equal(part["error"], result.error[row])
        np.testing.assert_array_equal(part["reference"], result.x_ref[row])
        np.testing.assert_array_equal(part["clearance"], result.clearance[row])
        np.testing.assert_array_equal(part["obstacles"], result.obstacles[row].ravel())
        np.testing.assert_allclose(np.arctan2(part["sin_q"], part["cos_q"]), result.q[row], atol=1e-15)
        assert info["t"] == result.t[row]
        assert info["clearance"] == result.clearance[row - rows + 1 : row + 1].min()
        way = np.linalg.norm(part["nearest"].reshape(6, 2), axis=1)
        radius = np.asarray(scenario.arm.radius)
        np.testing.assert_allclose(way - radius, part["clearance"], atol=1e-12)


def test_a_null_space_action_leaves_the_task_alone() -> None:
    """J M⁻¹ Nᵀ = 0: the tip stays, whatever the agent does to the links; unprojected it does not."""
    quiet = {"duration": 1.0, "controller.field.gain": 0.0, "obstacles": [], "simulation.dt": 1e-4}
    errors = {}
    for kind, overrides in (("dynamic", {}), ("none", {"controller.projection": "none"})):
        env = ReachEnv("sweep-through", quiet | overrides, **EXACT, torque=2.0)
        first, info = env.reset()
        for _ in range(100):
            observation, _, _, _, info = env.step(np.ones(6))
        assert np.abs(observation - first)[env.layout["sin_q"]].max() > 0.01
        errors[kind] = info["tracking_error"]
    assert errors["dynamic"] < 1e-4 < 1e-2 < errors["none"]


def test_a_torque_action_is_the_torque() -> None:
    """As `Simulation.step` with the same torque, to the last bit; beyond ±1 it stays at ±1."""
    env = ReachEnv("sweep-through", action="torque", period=1e-3, torque=[3, 2, 2, 1, 1, 0.5], **EXACT)
    env.reset()
    plant = vff.Simulation(vff.Scenario.load("sweep-through"))
    action = np.array([0.5, -2.0, 1.0, 0.0, -0.25, 3.0])
    for _ in range(200):
        observation, *_ = env.step(action)
        state = plant.step(np.clip(action, -1, 1) * env.torque)
        np.testing.assert_array_equal(observation[env.layout["dq"]], state.dq)


def test_the_reward_is_what_is_documented() -> None:
    weights = {"alive": 2.0, "tracking": 3.0, "clearance": 5.0, "effort": 7.0, "collision": 11.0}
    env = ReachEnv(**HITS, margin=0.5, weights=weights)
    env.reset(seed=0)
    generator = np.random.default_rng(0)
    for _ in range(1000):
        action = generator.uniform(-0.1, 0.1, 6)
        _, reward, terminated, truncated, info = env.step(action)
        used = np.clip(1 - info["clearance"] / 0.5, 0, 1)
        expected = 2 - 3 * info["tracking_error"] - 5 * used**2 - 7 * np.mean(action**2) - 11 * terminated
        assert reward == pytest.approx(expected, abs=1e-12)
        assert reward == pytest.approx(sum(v for k, v in info.items() if k.startswith("reward_")), abs=1e-12)
        if terminated or truncated:
            break
    assert terminated and not truncated and info["clearance"] < 0 and not info["diverged"]


def test_ends() -> None:
    """Truncated at the end of the scenario, terminated by speed with torques that no arm survives."""
    env = ReachEnv("sweep-through", {"duration": 0.1}, **EXACT)
    env.reset()
    ends = [env.step(np.zeros(6))[2:4] for _ in range(10)]
    assert ends == [(False, False)] * 9 + [(False, True)]
    env = ReachEnv("sweep-through", {"obstacles": []}, action="torque", torque=1e4)
    env.reset()
    for _ in range(100):
        observation, _, terminated, _, info = env.step(np.ones(6))
        if terminated:
            break
    assert terminated and info["diverged"] and env.observation_space.contains(observation)


@pytest.mark.parametrize(
    ("scenario", "turn", "shift"), [("sweep-through", 0.2, 0.3), ("panda-sweep", 0.1, 0.2)]
)
def test_starts_are_random_within_their_bounds(scenario: str, turn: float, shift: float) -> None:
    """Evenly spread over the whole interval, around q0 and the given position, in all directions."""
    env = ReachEnv(scenario, start_noise=turn, obstacle_noise=shift)
    seen = np.array([env.reset(seed=seed)[0] for seed in range(400)])
    angle = np.arctan2(seen[:, env.layout["sin_q"]], seen[:, env.layout["cos_q"]])
    for values, centre, width in (
        (angle, env.scenario["q0"], turn),
        (seen[:, env.layout["obstacles"]], env.scenario["obstacles"][0]["position"], shift),
    ):
        away = values - np.asarray(centre)
        assert np.abs(away).max() <= width + 1e-12 and np.abs(away).max() > 0.98 * width
        np.testing.assert_allclose(away.std(axis=0), width / np.sqrt(3), rtol=0.15)
    assert (seen[:, env.layout["clearance"]] > 0).all()


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("threads", [1, 3])
def test_many_are_the_same_as_one(mode: AutoresetMode, threads: int) -> None:
    """As Gymnasium's own vector environment of single ones: bit by bit, through many ends, infos included."""
    count = 5
    settings: dict[str, Any] = HITS | {"overrides": HITS["overrides"] | {"duration": 2.0}}
    ours = ReachVectorEnv(count, **settings, autoreset_mode=mode, threads=threads)
    theirs = SyncVectorEnv([lambda: ReachEnv(**settings)] * count, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    same(ours.reset(seed=7), theirs.reset(seed=7))
    generator = np.random.default_rng(1)
    ends = 0
    for _ in range(130):
        action = generator.uniform(-1, 1, (count, 6))
        found = ours.step(action)
        same(found, theirs.step(action))
        over = found[2] | found[3]
        ends += over.sum()
        if mode == AutoresetMode.DISABLED and over.any():
            with pytest.raises(gymnasium.error.ResetNeeded, match="have ended"):
                ours.step(action)
            both = [env.reset(options={"reset_mask": over}) for env in (ours, theirs)]
            same(*both)
    assert ends > 10


def same(ours: Any, theirs: Any) -> None:
    """Equal to the last bit, keys and types included."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for key in theirs:
            same(ours[key], theirs[key])
    elif isinstance(theirs, tuple):
        for mine, other in zip(ours, theirs, strict=True):
            same(mine, other)
    elif theirs.dtype == object:
        for mine, other in zip(ours, theirs, strict=True):
            assert (mine is None) == (other is None)
            np.testing.assert_array_equal(mine, other)
    else:
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)


def test_make_vec_takes_ours() -> None:
    envs = gymnasium.make_vec(NAME, num_envs=3)
    assert isinstance(envs.unwrapped, ReachVectorEnv) and envs.num_envs == 3
    first, _ = envs.reset(seed=[5, 6, 7])
    again, _ = envs.reset(seed=5)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(envs.reset()[0], first)


def _step(envs: ReachVectorEnv, pipe: Any) -> None:
    pipe.send(envs.step(np.zeros((4, 6)))[1])


def test_a_forked_process_goes_on() -> None:
    """Threads do not survive a fork: the child steps without them instead of waiting for ever."""
    envs = ReachVectorEnv(4, threads=2)
    envs.reset(seed=1)
    here, there = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=_step, args=(envs, there))
    child.start()
    assert here.poll(HANG)
    np.testing.assert_array_equal(here.recv(), envs.step(np.zeros((4, 6)))[1])
    child.join(HANG)
    assert child.exitcode == 0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"action": "position"}, "action: .*null_space.*torque"),
        ({"period": 1.5e-3}, r"period: must be a multiple of the control period 0.001 s, got 0.0015"),
        ({"period": 0.0}, "period: must be a multiple"),
        ({"torque": 0.0}, "torque: must be greater than 0, got 0.0"),
        ({"torque": [1.0, 2.0]}, "torque: expected 6 values, got 2"),
        ({"start_noise": -0.1}, "start_noise: must be 0 or more"),
        ({"obstacle_noise": float("nan")}, "obstacle_noise: .*finite"),
        ({"margin": 0.0}, "margin: must be greater than 0"),
        ({"weights": {"efort": 1.0}}, "weights: unknown key `efort`.*`effort`"),
        ({"weights": {"alive": -1.0}}, "weights.alive: must be 0 or more"),
        ({"overrides": {"duration": -1.0}}, "duration"),
    ],
)
def test_bad_settings_are_named(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=message):
        ReachEnv("sweep-through", **settings)


def test_bad_calls_are_named() -> None:
    env, envs = ReachEnv(), ReachVectorEnv(2)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(6))
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros((2, 6)))
    env.reset()
    envs.reset()
    with pytest.raises(vff.errors.InputError, match=r"action: expected shape \(6,\), got \(5,\)"):
        env.step(np.zeros(5))
    with pytest.raises(vff.errors.InputError, match="finite"):
        env.step(np.full(6, np.nan))
    with pytest.raises(vff.errors.InputError, match=r"action: expected shape \(2, 6\), got \(6,\)"):
        envs.step(np.zeros(6))
    with pytest.raises(vff.errors.InputError, match="seed: expected 2 values, got 3"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(vff.errors.InputError, match="reset_mask"):
        envs.reset(options={"reset_mask": [True]})
    for name in ("num_envs", "threads"):
        with pytest.raises(vff.errors.InputError, match=f"{name}: must be from 1 to"):
            ReachVectorEnv(**{name: 0})


@pytest.mark.parametrize(
    ("seed", "error", "message"),
    [
        (-1, vff.errors.InputError, "seed: must be from 0 to"),
        (2**63, vff.errors.InputError, "seed: must be from 0 to"),
        (10**400, vff.errors.InputError, "a number of more than 30 digits"),
        (1.5, vff.errors.InputTypeError, "seed: expected a whole number, not a float"),
        (True, vff.errors.InputTypeError, "seed: expected a whole number, not a bool"),
        ("1", vff.errors.InputTypeError, "seed: expected a whole number, not a str"),
    ],
)
def test_seeds_that_are_none(seed: Any, error: type[Exception], message: str) -> None:
    """An error of ours before anything has changed: the episodes go on as if nothing had been asked."""
    env, envs = ReachEnv(), ReachVectorEnv(2)
    for one in (env, envs):
        other = type(one)() if one is env else ReachVectorEnv(2)
        one.reset(seed=3)
        other.reset(seed=3)
        with pytest.raises(error, match=message):
            one.reset(seed=seed)
        np.testing.assert_array_equal(one.reset()[0], other.reset()[0])
    with pytest.raises(error, match=message.replace("seed", r"seed\[1\]")):
        envs.reset(seed=[1, seed])


def test_seeds_of_all_environments_are_in_range() -> None:
    envs = ReachVectorEnv(3)
    with pytest.raises(vff.errors.InputError, match=r"seed \+ 2"):
        envs.reset(seed=2**63 - 2)
    first = envs.reset(seed=np.int64(5))[0]
    np.testing.assert_array_equal(first, envs.reset(seed=[5, 6, 7])[0])
    np.testing.assert_array_equal(first, envs.reset(seed=np.array([5, 6, 7]))[0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_envs": 10**9}, "num_envs: must be from 1 to 65536"),
        ({"num_envs": 2.0}, "num_envs: expected a whole number"),
        ({"threads": 2**70}, "threads: must be from 1 to 1024"),
        ({"threads": "2"}, "threads: expected a whole number"),
        ({"autoreset_mode": "sometimes"}, "autoreset_mode: expected one of AutoresetMode.NEXT_STEP"),
        ({"flavour": 1}, "unknown key `flavour`"),
    ],
)
def test_settings_of_a_vector_environment_are_named(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(vff.VffNullError, match=message):
        ReachVectorEnv(**settings)


def test_threads_that_share_an_environment_take_turns() -> None:
    """As many steps as were asked for, and no error of the binding."""
    envs = ReachVectorEnv(4, threads=1, overrides={"duration": 1e4}, start_noise=0.0, obstacle_noise=0.0)
    envs.reset(seed=1)
    faults: list[BaseException] = []

    def work() -> None:
        try:
            for _ in range(50):
                envs.step(np.zeros((4, 6)))
        except BaseException as fault:
            faults.append(fault)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert faults == []
    alone = ReachVectorEnv(4, threads=1, overrides={"duration": 1e4}, start_noise=0.0, obstacle_noise=0.0)
    alone.reset(seed=1)
    for _ in range(200):
        alone.step(np.zeros((4, 6)))
    np.testing.assert_array_equal(envs.step(np.zeros((4, 6)))[0], alone.step(np.zeros((4, 6)))[0])


def test_without_gymnasium_the_extra_is_named() -> None:
    code = (
        "import sys; sys.modules['gymnasium'] = None\n"
        "try: import vffnull.engines.gym\n"
        "except ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert "vffnull[gym]" in done.stdout, done.stdout + done.stderr


def test_a_start_that_always_touches_is_told() -> None:
    """With what is in the way and how starts were drawn, instead of episodes of one step."""
    document = vff.Scenario.load("sweep-through").to_dict()
    document["obstacles"][0]["position"] = [0.5, 0.9]
    document["obstacles"][0]["shape"]["radius"] = 0.6
    random = r"touches obstacles\[0\] in the last of 100 starts, all in contact, drawn with start_noise 0.05"
    with pytest.raises(vff.errors.ScenarioError, match=random):
        ReachEnv(document)
    with pytest.raises(vff.errors.ScenarioError, match=r"touches obstacles\[0\] at the start"):
        ReachVectorEnv(2, document, **EXACT)


def test_options_that_there_are_not_are_refused() -> None:
    env = ReachEnv()
    env.reset(options={})
    with pytest.raises(vff.errors.InputError, match="options: no 'reset_mask'; there are none"):
        env.reset(options={"reset_mask": [True]})
    envs = ReachVectorEnv(2)
    with pytest.raises(vff.errors.InputError, match="options: no 'low'; there is reset_mask"):
        envs.reset(options={"low": 0.0})


def test_episodes_record_nothing() -> None:
    """So the record of a long scenario need not fit; that of a simulation has to."""
    long = {"duration": 4000.0, "simulation.dt": 5e-5, "obstacles": [], "simulation.record_every": 1}
    env = ReachEnv("sweep-through", long)
    env.reset(seed=0)
    assert np.isfinite(env.step(np.zeros(6))[0]).all()
    with pytest.raises(vff.errors.ScenarioError, match=r"simulation\.record_every: .* GB"):
        vff.simulate("sweep-through", long)


def test_sensors_of_many_episodes_have_to_fit() -> None:
    """64 of half a gigabyte each: refused at once, in one sentence, before the system ends the process."""
    slow = {"perception.kind": "range", "perception.rays": 60, "perception.latency": 1.0}
    with pytest.raises(vff.errors.ScenarioError, match=r"64 episodes take .* GB, more than the 8 GB allowed"):
        ReachVectorEnv(64, "panda-sweep", slow)
