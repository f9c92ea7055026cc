"""Policies on virtual arms: as in simulation, safe whatever fails, and kept as datasets."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file
from xl320_samples import virtual

from nas_data.cli import main
from nas_data.dataset.features import ENVIRONMENT, NEXT_STATE, STATE
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.envs.base import find_task
from nas_data.errors import OptionError
from nas_data.recorders.ergojr_ways import Ways
from nas_data.recorders.guarded import GuardedArm, Setup
from nas_data.recorders.schedule import SteppedClock
from nas_data.recorders.watchdog import Watchdog
from nas_data.robots.base import find_robot
from nas_data.rollouts.keyboard import EVENT, KEY_EVENT, KEY_S, Keyboard
from nas_data.rollouts.robot_stepper import RobotStepper
from nas_data.simulators.contact import contact_counts
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.virtual_bus.options import Options
from nas_data.virtual_bus.process import VirtualBus
from nas_data.xl320.arm import Arm
from nas_data.xl320.ergojr import ergojr_joints
from nas_data.xl320.units import TICK

JOINTS = ergojr_joints()
LOCKSTEP = ("--on", "ergojr", "--port", "virtual", "--lockstep")
DUEL = (*LOCKSTEP, "--defender-port", "virtual")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HF_LEROBOT_CALIBRATION", str(tmp_path / "calibration"))
    return tmp_path


def policy(environment: str, actions: tuple[float, ...]) -> str:
    """Write a policy that always does the same."""
    task, folder = find_task(environment), Path(f"policy_{environment}")
    width = task.observation_space.shape[0]
    folder.mkdir(exist_ok=True)
    tensors = {
        "mlp_extractor.policy_net.0.weight": np.zeros((4, width)),
        "mlp_extractor.policy_net.0.bias": np.zeros(4),
        "action_net.weight": np.zeros((len(actions), 4)),
        "action_net.bias": np.array(actions),
        "observation.mean": np.zeros(width),
        "observation.variance": np.ones(width),
    }
    save_file({name: values.astype(np.float32) for name, values in tensors.items()}, folder / "policy.safetensors")
    config = {"kind": "ppo", "seed": 0, "frames": 0, "plant": {"environment": environment}}
    (folder / "config.json").write_text(json.dumps(config))
    return str(folder)


def evaluate(capsys, *words: str) -> dict:
    assert main(["policy", "evaluate", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys, *words: str) -> str:
    assert main(["policy", "evaluate", *words]) == 2
    return capsys.readouterr().err.splitlines()[-1]


def torques(port: str) -> list[int]:
    arm = Arm(port, JOINTS)
    found = [arm.bus.get(identity, "torque_enable") for identity in JOINTS.ids]
    arm.close()
    return found


# One arm


def test_a_policy_fares_on_the_arm_as_in_the_simulation_that_moves_it(capsys):
    reacher = policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1))
    options = (reacher, "--episodes", "3")
    simulated = evaluate(capsys, *options, "--on", "source")["groups"][0]["seeds"][0]
    measured = evaluate(capsys, *options, *LOCKSTEP, "--speed", "0")["groups"][0]["seeds"][0]
    assert measured["mean_length"] == pytest.approx(simulated["mean_length"], abs=3)
    assert measured["return"] == pytest.approx(simulated["return"], rel=0.03)


def test_rollouts_are_kept_as_a_dataset(capsys):
    reacher = policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1))
    answer = evaluate(capsys, reacher, "--episodes", "3", *LOCKSTEP, "--record", "rolled")
    root = Path(answer["dataset"])
    dataset, provenance = read(root), read_provenance(root)
    assert verify(root) == []
    assert dataset.n_episodes == 3
    assert dataset.n_frames == answer["steps"] > 100
    assert dataset.commands / TICK == pytest.approx(np.rint(dataset.commands / TICK), abs=1e-3)
    for rows in dataset.episodes():
        assert np.array_equal(dataset.columns[STATE][rows][1:], dataset.columns[NEXT_STATE][rows][:-1])
        assert np.abs(dataset.states[rows][0, :6]).max() < np.radians(18) + 0.1
    assert provenance.signal["environment"] == "ErgoReacher"
    assert provenance.target["configuration"]["speed"] == 1.745
    assert answer["held_back"] == answer["late"] == 0
    assert [path.name for path in Path("datasets/rolled").iterdir()] == [root.name]


def test_an_arm_is_not_led_into_the_floor(capsys, monkeypatch):
    def touching(name: str) -> tuple[int, int]:
        """Roll out, and return how many commands were held back and in how many readings the arm touched something."""
        reacher = policy("ErgoReacher", (1.0, 0.6, 0.0, 0.0))
        options = ("--episodes", "3", *LOCKSTEP, "--record", name, "--speed", "3")
        answer = evaluate(capsys, reacher, *options)
        reached = read(Path(answer["dataset"])).next_states[:, :6].astype(float)
        assert reached[:, 1].max() > 0.3
        simulator = MujocoSimulator(find_robot("ergojr"), 0.01, threads=1)
        return answer["held_back"], int((contact_counts(simulator, reached) > 0).sum())

    held_back, touches = touching("careful")
    assert held_back > 10
    assert touches == 0
    monkeypatch.setattr(RobotStepper, "_careful", lambda _, command: command)
    held_back, touches = touching("careless")
    assert held_back == 0
    assert touches > 10


# Two arms


def test_a_duel_is_fought_and_kept(capsys):
    shield = policy("ErgoShield", (0.1, 0.2, 0.2, 0.0, 0.1, 0.0))
    answer = evaluate(capsys, shield, "--episodes", "1", *DUEL, "--record", "duel", "--missed", "0.125")
    root = Path(answer["dataset"])
    dataset = read(root)
    assert verify(root) == []
    assert dataset.n_frames == answer["steps"] == 1000
    opponent = dataset.columns[ENVIRONMENT]
    assert opponent.shape == (1000, 12)
    assert np.ptp(opponent[:, :6], axis=0).max() > 0.1, "the defender takes another pose every 2.5 s"
    assert np.abs(opponent[:, :6]).max() < np.radians(45) + 0.1
    assert (answer["hits"], answer["missed"]) == ("simulated", 0.125)


def test_a_word_about_one_arm_is_a_word_about_both(monkeypatch):
    told = []
    monkeypatch.setattr(Watchdog, "promise", lambda guard, seconds: told.append(guard))
    ways = Ways(find_robot("ergojr"))
    with virtual() as first, virtual() as second:
        setups = [Setup(port=bus.port, joints=JOINTS, ways=ways) for bus in (first, second)]
        with GuardedArm(setups[0], SteppedClock()) as one:
            with GuardedArm(setups[1], SteppedClock()) as other:
                one.accompany(other)
                one.promise(1.0)
                assert len(set(told)) == 2
            told.clear()
            one.promise(1.0)
            assert len(told) == 1, "the other is safe, and its guard was sent home"


def test_hits_are_what_the_keyboard_says(capsys):
    os.mkfifo("keys")
    writer = os.open("keys", os.O_RDWR | os.O_NONBLOCK)
    over = threading.Event()

    def press() -> None:
        while not over.wait(1.5):
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
    with virtual() as attacker, virtual("overload:servo=2,after=4") as defender:
        ports = ("--on", "ergojr", "--port", attacker.port, "--defender-port", defender.port, "--hits", "simulated")
        said = refused(capsys, shield, "--episodes", "3", *ports, "--record", "duel")
        assert "Servo 2 (m2) shut down by overload" in said
        assert torques(attacker.port) == torques(defender.port) == [0] * 6


def test_ctrl_c_makes_the_arm_safe_and_keeps_what_is_finished():
    reacher = policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1))
    with VirtualBus(Options(honest=False)) as bus:
        command = [sys.executable, "-m", "nas_data", "policy", "evaluate", reacher, "--on", "ergojr"]
        command += ["--port", bus.port, "--record", "rolled"]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        recording, until = Path("datasets/rolled/recording"), time.monotonic() + 120
        while not recording.exists():
            assert process.poll() is None and time.monotonic() < until
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        assert process.returncode == 130
        assert "what was finished is kept" in said
        assert torques(bus.port) == [0] * 6
    assert read(Path("datasets/rolled")).n_episodes >= 1
    assert verify(Path("datasets/rolled")) == []


@pytest.mark.parametrize(
    ("environment", "options", "words"),
    [
        ("ErgoReacher", ("--on", "ergojr"), "Judging on 'ergojr' needs --port PORT"),
        ("ErgoReacher", ("--port", "virtual"), "Judging on 'target' takes no --port"),
        ("ErgoReacher", ("--record", "reached"), "Judging on 'target' takes no --record"),
        ("ErgoReacher", ("--lockstep",), "Judging on 'target' takes no --lockstep"),
        ("ErgoReacher", (*LOCKSTEP, "--engine", "bullet"), "Judging on 'ergojr' takes no --engine"),
        ("ErgoReacher", (*LOCKSTEP, "--dynamics", "paper"), "Judging on 'ergojr' takes no --dynamics"),
        ("ErgoReacher", (*LOCKSTEP, "--largest-step", "0"), "--largest-step is 0.0; it must be above zero"),
        ("ErgoReacher", DUEL, "ErgoReacher takes no --defender-port"),
        ("ErgoShield", LOCKSTEP, "ErgoShield needs a second arm: give --defender-port"),
        ("ErgoShield", ("--on", "ergojr", "--port", "a", "--defender-port", "b"), "Say where hits are read: --hits"),
        ("ErgoShield", ("--on", "ergojr", "--port", "a", "--defender-port", "a", "--hits", "simulated"), "Both arms"),
        ("ErgoShield", (*DUEL, "--hits", "nowhere"), "nowhere cannot be read as a keyboard"),
        ("ErgoShield", (*DUEL, "--missed", "2"), "--missed 2.0 is a share (0 … 1) of simulated hits"),
        ("ErgoReacher", (*LOCKSTEP, "--missed", "0.1"), "--missed 0.1 is a share (0 … 1) of simulated hits"),
        ("ErgoReacher", ("--missed", "0.1"), "ErgoReacher has no touches that could be missed"),
        ("ErgoReacher", ("--on", "ergojr", "--port", "/dev/nowhere"), "There is no port /dev/nowhere"),
        ("ErgoReacher", (*LOCKSTEP, "--record", "a/b"), "'a/b' is no name for a dataset"),
        ("ErgoReacher", (*LOCKSTEP, "--speed", "-1"), "speed limit is -1"),
        ("Pusher", LOCKSTEP, "An ErgoJr cannot do the task of a pusher"),
    ],
)
def test_bad_input_costs_one_sentence_and_writes_nothing(capsys, environment, options, words):
    actions = np.zeros(find_task(environment).action_space.shape[0])
    assert words in refused(capsys, policy(environment, tuple(actions)), *options)
    assert not Path("datasets").exists()
