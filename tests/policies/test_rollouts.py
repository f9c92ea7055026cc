"""Policies on virtual arms: as in simulation, safe whatever fails, and kept as datasets."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.rollout_samples import LOCKSTEP, evaluate, policy, refused, work_in
from support.xl320_samples import be_patient, be_quick, torques, virtual

from nas_data.cli import main
from nas_data.dataset.features import DONE, ENVIRONMENT, NEXT_ENVIRONMENT, NEXT_STATE, REWARD, STATE, SUCCESS
from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.envs.base import find_task
from nas_data.envs.ergo_shield import DEFENDER_RANGE
from nas_data.envs.ergo_shield import detect_touches as geometric_touches
from nas_data.errors import OptionError
from nas_data.hardware.virtual_bus.process import VirtualBus
from nas_data.hardware.virtual_bus.terminal import Options
from nas_data.hardware.xl320.arm import Xl320
from nas_data.hardware.xl320.control_table import TICK
from nas_data.hardware.xl320.joints import make_ergojr_joints
from nas_data.policies.evaluate import SEED
from nas_data.policies.rollouts import recorded
from nas_data.policies.rollouts.arm_setup import EVENT, KEY_EVENT, KEY_S, Keyboard
from nas_data.policies.rollouts.robot_stepper import RobotStepper
from nas_data.policies.rollouts.rollout import read_rollout_scores
from nas_data.policies.rollouts.two_arm_planner import make_two_arm_planner
from nas_data.recorders.guarded import GuardedArm, Setup
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.schedule import SteppedClock
from nas_data.recorders.watchdog import Watchdog
from nas_data.robots.base import find_robot
from nas_data.simulators.contact import count_contacts
from nas_data.simulators.mujoco import MujocoSimulator

JOINTS = make_ergojr_joints()
DUEL = (*LOCKSTEP, "--defender-port", "virtual")
UNDER_WAY = Path("datasets/rolled/recording")
ON_PORT = "nas_data.commands._on_arm.port_of"  # opens what --port names
# The program as a process, in which `--port virtual` is the arm on the port of the first argument.
ON_THIS_ARM = """
import contextlib, sys
from nas_data.cli import main
from nas_data.commands import _on_arm
_on_arm.port_of = lambda *_, **__: contextlib.nullcontext(sys.argv[1])
sys.exit(main(sys.argv[2:]))
"""


@pytest.fixture(autouse=True)
def _patient(monkeypatch) -> None:
    be_patient(monkeypatch)
    be_quick(monkeypatch)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    return work_in(tmp_path, monkeypatch)


# One arm


def test_a_policy_fares_on_the_arm_as_in_the_simulation_that_moves_it(capsys):
    reacher = policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1))
    options = (reacher, "--episodes", "2")
    simulated = evaluate(capsys, *options, "--on", "source")["groups"][0]["seeds"][0]
    measured = evaluate(capsys, *options, *LOCKSTEP, "--speed", "0")["groups"][0]["seeds"][0]
    assert measured["mean_length"] == pytest.approx(simulated["mean_length"], abs=3)
    assert measured["return"] == pytest.approx(simulated["return"], rel=0.05)  # the virtual arm's supply sags


def test_rollouts_are_kept_as_a_dataset_with_the_reward_of_each_row(capsys, monkeypatch):
    monkeypatch.setattr("nas_data.recorders.arm_motion.APPROACH", 0.6)  # as of a real arm
    monkeypatch.setattr("nas_data.recorders.arm_motion.SETTLE", 0.5)
    reset, sent = RobotStepper.reset, []

    def remembering(stepper, states, rows=None):
        sent.append(states[0, :6].copy())
        reset(stepper, states, rows)

    monkeypatch.setattr(RobotStepper, "reset", remembering)
    reacher = policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1))
    answer = evaluate(capsys, reacher, "--episodes", "2", *LOCKSTEP, "--record", "rolled")
    root = Path(answer["dataset"])
    dataset, provenance = read(root), read_provenance(root)
    assert verify(root) == []
    assert dataset.n_episodes == 2
    assert dataset.n_frames == answer["steps"] > 100
    assert dataset.commands / TICK == pytest.approx(np.rint(dataset.commands / TICK), abs=1e-3)
    for rows in dataset.episodes():
        assert np.array_equal(dataset.columns[STATE][rows][1:], dataset.columns[NEXT_STATE][rows][:-1])
        below = dataset.states[rows][0, :6] - sent.pop(0)
        assert np.abs(below).max() < np.radians(6)  # friction; an arm that hangs below its command is up to 14° off
    assert provenance.signal["environment"] == "ErgoReacher"
    assert provenance.target["configuration"]["speed"] == 1.745
    assert answer["held_back"] == answer["late"] == 0
    assert [path.name for path in Path("datasets/rolled").iterdir()] == [root.name]
    check_rewards(dataset, answer["returns"])


def check_rewards(dataset, told: list[list[float]]) -> None:
    """Check that each row holds its reward, and that the sums were told."""
    task = find_task("ErgoReacher")
    stepper = task.simulator().stepper(1)
    for number, rows in enumerate(dataset.episodes()):
        goals = task.start(np.random.default_rng(SEED + number)).goal[None]
        for row in range(rows.start, rows.stop):
            stepper.reset(dataset.next_states[row : row + 1].astype(float))
            verdict = task.judge(stepper, goals, np.zeros((1, 4)))
            assert dataset.columns[REWARD][row, 0] == pytest.approx(verdict.reward[0], abs=1e-5)
            assert dataset.columns[SUCCESS][row, 0] == verdict.success[0]
            assert dataset.columns[DONE][row, 0] == (row == rows.stop - 1)
    assert told == [returns_of(dataset)]


def check_care(touching: Callable[[str], tuple[int, int]], monkeypatch: pytest.MonkeyPatch, touches: int) -> None:
    """Check that what is held back keeps arms from touching, which they do at least so often where nothing is."""
    held_back, found = touching("careful")
    assert held_back > 10
    assert found == 0
    monkeypatch.setattr(RobotStepper, "_avoid_contact", lambda _, command: command)
    held_back, found = touching("careless")
    assert held_back == 0
    assert found > touches


def test_an_arm_is_not_led_into_the_floor(capsys, monkeypatch):
    def touching(name: str) -> tuple[int, int]:
        """Roll out, and return how many commands were held back and in how many readings the arm touched something."""
        reacher = policy("ErgoReacher", (1.0, 0.6, 0.0, 0.0))
        options = ("--episodes", "2", *LOCKSTEP, "--record", name, "--speed", "3")
        answer = evaluate(capsys, reacher, *options)
        reached = read(Path(answer["dataset"])).next_states[:, :6].astype(float)
        assert reached[:, 1].max() > 0.3
        simulator = MujocoSimulator(find_robot("ergojr"), 0.01, threads=1)
        return answer["held_back"], int((count_contacts(simulator, reached) > 0).sum())

    check_care(touching, monkeypatch, touches=10)


# Two arms


def short(monkeypatch: pytest.MonkeyPatch, steps: int) -> None:
    """Let attempts of ErgoShield last so many steps at most, and arms hold their first poses for less long."""
    monkeypatch.setattr("nas_data.policies.rollouts.two_arm_planner.SETTLE", 0.1)
    task = replace(find_task("ErgoShield"), horizon=steps)
    monkeypatch.setattr("nas_data.commands._on_arm.find_task", lambda _: task)


def test_a_duel_is_fought_and_kept(capsys, monkeypatch):
    shield = policy("ErgoShield", (0.1, 0.2, 0.2, 0.0, 0.1, 0.0))
    short(monkeypatch, 300)
    answer = evaluate(capsys, shield, "--episodes", "1", *DUEL, "--record", "duel", "--missed", "0.125")
    root = Path(answer["dataset"])
    dataset = read(root)
    assert verify(root) == []
    assert dataset.n_frames == answer["steps"] == 300
    opponent = dataset.columns[ENVIRONMENT]
    assert opponent.shape == (300, 12)
    assert np.ptp(opponent[:, :6], axis=0).max() > 0.1, "the defender takes another pose every 2.5 s"
    assert np.abs(opponent[:, :6]).max() < np.radians(45) + 0.1
    assert (answer["hits"], answer["missed"]) == ("simulated", 0.125)


def test_a_sword_may_lie_on_a_shield_but_no_arm_on_the_other():
    rng, task = np.random.default_rng(0), find_task("ErgoShield")
    attackers, defenders = (
        rng.uniform(-1.2, 1.2, (10_000, 6)),
        rng.uniform(-DEFENDER_RANGE, DEFENDER_RANGE, (10_000, 6)),
    )
    poses = np.concatenate([attackers, defenders], axis=1)
    states = np.concatenate([attackers, 0 * attackers, defenders, 0 * defenders], axis=1)
    stepper, touching = task.simulator().stepper(500), []
    for start in range(0, len(states), stepper.size):  # a simulation takes 14 MB
        stepper.reset(states[start : start + stepper.size])
        touching.append(geometric_touches(stepper))
    struck = poses[np.concatenate(touching)]
    bodies, edges = make_two_arm_planner(), make_two_arm_planner(edges=True)
    alone = PathPlanner(find_robot("ergojr_penholder"))
    assert len(struck) > 50
    assert np.mean([edges.touches(pose) for pose in struck]) < 0.2, "the others have an arm on the other as well"
    for pose in poses[:500]:
        assert alone.touches(pose[:6]) <= bodies.touches(pose) <= edges.touches(pose)
    crashed = next(pose for pose in struck if bodies.touches(pose) and not alone.touches(pose[:6]))
    upright = np.concatenate([np.zeros(6), crashed[6:]])
    assert bodies.enters_contact(upright, crashed)
    assert not bodies.enters_contact(crashed, upright)


@pytest.mark.slow
def test_arms_are_kept_from_touching_one_another(capsys, monkeypatch):
    def touching(name: str) -> tuple[int, int]:
        """Roll out, and return how many commands were held back and in how many readings the sword was in the arm."""
        options = ("--episodes", "1", *DUEL, "--record", name, "--speed", "3", "--missed", "1", "--apart", "all")
        answer = evaluate(capsys, policy("ErgoShield", (0.0, 0.3, 0.0, 0.0, 0.0, 0.0)), *options)
        dataset, planner = read(Path(answer["dataset"])), make_two_arm_planner(edges=True)
        places = (dataset.next_states[:, :6], dataset.columns[NEXT_ENVIRONMENT][:, :6])
        return answer["held_back"], sum(planner.touches(pose) for pose in np.concatenate(places, axis=1).astype(float))

    short(monkeypatch, 150)
    check_care(touching, monkeypatch, touches=3)


def test_an_arm_stays_where_the_command_without_its_sag_keeps_it():
    robot, pose = find_robot("ergojr_penholder"), np.array([0.1, 0.2, 0.2, 0.0, 0.1, 0.1])
    simulator, sag = MujocoSimulator(robot, 0.01, threads=1), PathPlanner(robot).sag(pose)
    at_rest = np.concatenate([pose, 0 * pose])[None]
    held, sagging = (simulator.rollout(at_rest, np.tile(c, (1, 200, 1)))[0, -1, :6] for c in (pose - sag, pose))
    assert np.abs(held - pose).max() < 1e-6
    assert np.abs(sagging - pose).max() > 0.05


def test_a_word_about_one_arm_is_a_word_about_both(monkeypatch):
    told = []
    monkeypatch.setattr(Watchdog, "extend_deadline", lambda guard, seconds: told.append(guard))
    planner = PathPlanner(find_robot("ergojr"))
    with virtual() as first, virtual() as second:
        setups = [Setup(driver=Xl320(port=bus.port, joints=JOINTS), planner=planner) for bus in (first, second)]
        with GuardedArm(setups[0], SteppedClock()) as one:
            with GuardedArm(setups[1], SteppedClock()) as other:
                one.share_guard(other)
                one.extend_deadline(1.0)
                assert len(set(told)) == 2
            told.clear()
            one.extend_deadline(1.0)
            assert len(told) == 1, "the other is safe, and its guard was sent home"


@pytest.mark.slow
def test_hits_are_what_the_keyboard_says(capsys, monkeypatch):
    short(monkeypatch, 60)
    os.mkfifo("keys")
    writer = os.open("keys", os.O_RDWR | os.O_NONBLOCK)
    over = threading.Event()

    def press() -> None:
        while not over.wait(0.05):
            os.write(writer, key(1) + key(0))

    thread = threading.Thread(target=press)
    thread.start()
    try:
        answer = evaluate(capsys, policy("ErgoShield", (0.0,) * 6), "--episodes", "1", *DUEL, "--hits", "keys")
    finally:
        over.set()
        thread.join()
        os.close(writer)
    assert answer["groups"][0]["seeds"][0]["return"] >= 1
    assert answer["hits"] == "keys"


def key(value: int, code: int = KEY_S) -> bytes:
    return EVENT.pack(0, 0, KEY_EVENT, code, value)


def test_a_key_counts_while_it_is_held_and_once_where_it_was_short():
    os.mkfifo("keys")
    with Keyboard("keys") as keyboard:
        writer = os.open("keys", os.O_WRONLY | os.O_NONBLOCK)

        def heard(*events: bytes) -> bool:
            os.write(writer, b"".join(events))
            return bool(keyboard(None)[0])

        assert [heard(), heard(key(1, code=30)), heard(EVENT.pack(0, 0, 0, 0, 0))] == [False] * 3
        assert [heard(key(1)), heard(), heard(key(2)), heard(key(0)), heard()] == [True, True, True, True, False]
        assert [heard(key(1), key(0)), heard()] == [True, False]
        os.close(writer)
    with pytest.raises(OptionError, match=r"nowhere cannot be read as a keyboard \(no such file or directory\)"):
        Keyboard("nowhere")


# What goes wrong


def test_where_one_arm_fails_both_are_left_without_torque(capsys):
    shield = policy("ErgoShield", (0.0,) * 6)
    with virtual() as attacker, virtual("overload:servo=2,after=2") as defender:
        ports = ("--on", "ergojr", "--port", attacker.port, "--defender-port", defender.port, "--hits", "simulated")
        said = refused(capsys, shield, "--episodes", "3", *ports, "--record", "duel")
        assert "Servo 2 (m2) shut down by overload" in said
        assert torques(attacker.port) == torques(defender.port) == [0] * 6


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [pytest.param(("--lockstep",), id="in lock-step"), pytest.param((), id="in real time")]
)
def test_ctrl_c_makes_the_arm_safe_and_keeps_what_is_finished(capsys, words):
    """In real time on an idle machine only: a busy one does not keep the rate, and `verify` says so."""
    reacher = policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1))
    with VirtualBus(Options(wire_delay=False, lockstep=bool(words))) as bus:
        options = [reacher, "--on", "ergojr", "--port", "virtual", "--record", "rolled", *words]
        command = [sys.executable, "-c", ON_THIS_ARM, bus.port, "policy", "evaluate", *options]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        until = time.monotonic() + 120
        while not UNDER_WAY.exists():
            assert process.poll() is None and time.monotonic() < until
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        assert process.returncode == 130
        assert "of 100 episodes are saved in datasets/rolled/recording; run the same command to continue." in said
        assert torques(bus.port) == [0] * 6
        count = read(UNDER_WAY).n_episodes
        answer = evaluate(capsys, *options, "--finish")
    assert len(answer["returns"]) == read(Path(answer["dataset"])).n_episodes == count >= 1
    assert verify(Path("datasets/rolled")) == []
    assert not UNDER_WAY.exists()


# Going on


def test_rollouts_go_on_where_they_stopped(capsys, monkeypatch):
    reacher = policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1))
    options = (reacher, *LOCKSTEP, "--episodes", "4", "--record", "rolled")
    with virtual("adapter_pulled:after=6") as bus, monkeypatch.context() as patch:
        patch.setattr(ON_PORT, lambda *_, **__: contextlib.nullcontext(bus.port))
        said = refused(capsys, *options)
    before, earlier = read(UNDER_WAY), returns_of(read(UNDER_WAY))
    assert 0 < len(earlier) < 4
    assert f"{len(earlier)} of 4 episodes are saved in {UNDER_WAY}; run the same command to continue." in said
    assert main(["policy", "evaluate", *options, "--json"]) == 0
    out, said = capsys.readouterr()
    answer = json.loads(out)
    assert f"{len(earlier)} of 4 episodes are saved in {UNDER_WAY}; continuing with the next." in said
    whole = read(Path(answer["dataset"]))
    assert np.array_equal(whole.columns[STATE][: before.n_frames], before.columns[STATE])
    assert whole.n_frames == answer["steps"]
    assert answer["returns"] == [returns_of(whole)]
    assert answer["returns"][0][: len(earlier)] == earlier
    assert answer["groups"][0]["seeds"][0]["episodes"] == 4
    assert answer["groups"][0]["seeds"][0]["return"] == pytest.approx(np.mean(returns_of(whole)))
    assert answer["sittings"] == read_provenance(Path(answer["dataset"])).target["tally"]["sittings"] == 2
    task = find_task("ErgoReacher")
    for number, first in enumerate(whole.starts):
        start = task.start(np.random.default_rng(SEED + number)).state[:6]
        assert np.abs(whole.states[first, :6] - start).max() < 0.25, "the start that the episode has in simulation"
    assert verify(Path(answer["dataset"])) == []


def returns_of(dataset) -> list[float]:
    """Return the sum of rewards of each rollout."""
    return [float(judgement.to_returns().returns[0]) for judgement in read_rollout_scores(dataset)]


@pytest.fixture(scope="module")
def begun_elsewhere(tmp_path_factory) -> tuple[Path, tuple[str, ...]]:
    """Save some of three rollouts; return the folder they are in, and the options."""
    with pytest.MonkeyPatch.context() as patch:
        folder = work_in(tmp_path_factory.mktemp("begun"), patch)
        options = (policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1)), *LOCKSTEP, "--episodes", "3", "--record", "rolled")
        append, done = IncrementalWriter.append, []

        def once(growing: IncrementalWriter, *arguments) -> None:
            if done:
                raise KeyboardInterrupt
            done.append(append(growing, *arguments))

        patch.setattr(IncrementalWriter, "append", once)
        assert main(["policy", "evaluate", *options]) == 130
    return folder, options


@pytest.fixture
def begun(begun_elsewhere, folder) -> tuple[str, ...]:
    """Have the folder of saved rollouts to work in; return the options."""
    elsewhere, options = begun_elsewhere
    shutil.copytree(elsewhere, folder, symlinks=True, dirs_exist_ok=True)
    return options


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("--speed", "3"), "servo configuration"),
        (("--episodes", "5"), "number of episodes"),
        (("--largest-step", "0.5"), "largest step"),
        (("policy",), "policy"),
        (("seed",), "seed"),
        (("task",), "task"),
    ],
)
def test_rollouts_of_something_else_are_not_gone_on_with(capsys, monkeypatch, begun, changed, words):
    if changed == ("policy",):
        policy("ErgoReacher", (0.3, -0.2, 0.2, 0.2))
    elif changed == ("seed",):
        monkeypatch.setattr("nas_data.commands._on_arm.SEED", SEED + 1)
    elif changed == ("task",):
        identity = recorded.list_shared_settings
        monkeypatch.setattr(
            recorded, "list_shared_settings", lambda known: {**identity(known), "environment": id(known)}
        )
    said = refused(capsys, *begun, *(changed if changed[0].startswith("--") else ()))
    assert said == (
        f"nas: {UNDER_WAY} was started with another {words}; give the same to continue, --finish to make a dataset of "
        "the saved episodes, or another --record."
    )
    assert read(UNDER_WAY).n_episodes == 1


def test_what_was_saved_is_finished_without_an_arm(capsys, begun):
    answer = evaluate(capsys, *begun, "--finish")
    assert len(answer["returns"]) == read(Path(answer["dataset"])).n_episodes == 1
    assert verify(Path("datasets/rolled")) == []
    assert not UNDER_WAY.exists()


def test_recordings_and_rollouts_are_not_mixed(capsys, begun):
    assert main(["record", "ergojr", *LOCKSTEP[2:], "--name", "rolled", "--episodes", "1"]) == 2
    assert "was started with another command; give the same to continue" in capsys.readouterr().err


@pytest.mark.slow
def test_a_rollout_is_saved_with_all_its_bouts_or_not_at_all(capsys, monkeypatch):
    short(monkeypatch, 40)
    calls = []

    def touched(stepper) -> np.ndarray:
        calls.append(len(calls) + 1)
        if len(calls) == 75:
            raise KeyboardInterrupt
        return np.array([(len(calls) - 1) % 40 in (0, 20)])  # the first is as if in touch already

    monkeypatch.setattr("nas_data.policies.rollouts.arm_setup.detect_touches", touched)
    options = (policy("ErgoShield", (0.0,) * 6), "--episodes", "2", *DUEL, "--record", "rolled")
    assert main(["policy", "evaluate", *options]) == 130
    assert read(UNDER_WAY).lengths.tolist() == [21, 19], "the second has touched once, and is not over"
    calls[:] = [0] * 80
    capsys.readouterr()
    answer = evaluate(capsys, *options)
    whole = read(Path(answer["dataset"]))
    assert whole.lengths.tolist() == [21, 19] * 2
    assert answer["returns"] == [[1.0, 1.0]]
    assert np.flatnonzero(whole.columns[REWARD][:, 0]).tolist() == [20, 60], "a hit is the last row of its attempt"
    assert np.flatnonzero(whole.columns[DONE][:, 0]).tolist() == [39, 79]
    assert np.flatnonzero(~whole.columns[SUCCESS][:, 0].astype(bool)).tolist() == [*range(20), *range(40, 60)]


@pytest.mark.parametrize(
    ("environment", "options", "words"),
    [
        ("ErgoReacher", ("--on", "ergojr"), "Evaluation on 'ergojr' needs --port PORT"),
        ("ErgoReacher", ("--port", "virtual"), "Evaluation on 'target' takes no --port"),
        ("ErgoReacher", ("--record", "reached"), "Evaluation on 'target' takes no --record"),
        ("ErgoReacher", ("--lockstep",), "Evaluation on 'target' takes no --lockstep"),
        ("ErgoReacher", (*LOCKSTEP, "--engine", "bullet"), "Evaluation on 'ergojr' takes no --engine"),
        ("ErgoReacher", (*LOCKSTEP, "--dynamics", "paper"), "Evaluation on 'ergojr' takes no --dynamics"),
        ("ErgoReacher", (*LOCKSTEP, "--largest-step", "0"), "--largest-step is 0.0; it must be above zero"),
        ("ErgoReacher", DUEL, "ErgoReacher takes no --defender-port"),
        ("ErgoShield", LOCKSTEP, "ErgoShield needs a second arm: give --defender-port"),
        (
            "ErgoShield",
            ("--on", "ergojr", "--port", "a", "--defender-port", "b"),
            "Give the source of the hits: --hits",
        ),
        (
            "ErgoShield",
            ("--on", "ergojr", "--port", "a", "--defender-port", "a", "--hits", "simulated"),
            "--port and --defender-port are both a",
        ),
        ("ErgoShield", (*DUEL, "--hits", "nowhere"), "nowhere cannot be read as a keyboard"),
        ("ErgoShield", (*DUEL, "--missed", "2"), "--missed is 2.0; it must be in 0 … 1"),
        ("ErgoReacher", (*LOCKSTEP, "--missed", "0.1"), "--missed is 0.1; it must be in 0 … 1"),
        ("ErgoReacher", ("--missed", "0.1"), "ErgoReacher has no touches to miss"),
        ("ErgoReacher", ("--on", "ergojr", "--port", "/dev/nowhere"), "There is no port /dev/nowhere"),
        (
            "ErgoReacher",
            ("--on", "ergojr", "--port", "/dev/nowhere", "--lockstep"),
            "lock-step belong to --port virtual; /dev/nowhere is a real arm",
        ),
        ("ErgoShield", (*LOCKSTEP, "--defender-port", "/dev/nowhere"), "/dev/nowhere is a real arm"),
        ("ErgoReacher", (*LOCKSTEP, "--record", "a/b"), "'a/b' is not a valid dataset name"),
        ("ErgoReacher", (*LOCKSTEP, "--speed", "-1"), "speed limit is -1"),
        ("ErgoReacher", ("--finish",), "Evaluation on 'target' takes no --finish"),
        ("ErgoReacher", (*LOCKSTEP, "--finish"), "--finish needs --record NAME"),
        (
            "ErgoReacher",
            (*LOCKSTEP, "--finish", "--record", "rolled"),
            "There are no saved episodes in datasets/rolled/recording",
        ),
        ("ErgoReacher", (*LOCKSTEP, "--apart", "all"), "--apart all needs the two arms of ErgoShield"),
        ("Pusher", LOCKSTEP, "An ErgoJr cannot do the task of a pusher"),
    ],
)
def test_bad_input_costs_one_sentence_and_writes_nothing(capsys, environment, options, words):
    actions = np.zeros(find_task(environment).action_space.shape[0])
    assert words in refused(capsys, policy(environment, tuple(actions)), *options)
    assert not Path("datasets").exists()
