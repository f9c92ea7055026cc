"""Record episodes from a simulated target: a robot with any effects, noise and quantisation."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from nas_data.api.arguments import Actuators, Progress, as_correction, as_model
from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import Origin
from nas_data.effects.base import Effect
from nas_data.effects.base import parse as parse_effect
from nas_data.environment_ids import make_environment_id
from nas_data.envs.base import find_task, find_task_file
from nas_data.errors import OptionError
from nas_data.excitations.base import Excitation
from nas_data.excitations.base import parse as parse_excitation
from nas_data.gap.report import GapReport
from nas_data.recorders.readings import Readings
from nas_data.recorders.session import PlaybackProtocol, RecordingSession, Target, check_amount
from nas_data.recorders.simulated import record as play_session
from nas_data.recorders.simulated import to_dataset
from nas_data.robots.base import Robot, find_robot
from nas_data.runs.progress import silence
from nas_data.simulators.engines import load_simulator

Start = Literal["rest", "random"]

SLOWEST, FASTEST = 0.01, 100_000.0  # [Hz] below and above any robot's control rate
LONGEST = 86_400.0  # [s] an episode of a day
ROBOT, DYNAMICS = "ergojr", "backlash"  # defaults
SECONDS = 3.0  # [s] of an episode, as in the paper's recordings


def record(
    robot: str | Path = ROBOT,
    *,
    env: str | None = None,
    dynamics: str = DYNAMICS,
    effects: Sequence[Effect | str] = (),
    report: GapReport | str | Path | None = None,
    excitation: Excitation | str = "steps",
    commands: str | Path | None = None,
    episodes: int = 20,
    seconds: float | None = None,
    rate: float | None = None,
    start: Start = "rest",
    joints: Sequence[str] = (),
    noise: float = 0.0,
    quantum: float | None = None,
    velocity_noise: float = 0.0,
    seed: int = 0,
    noise_seed: int | None = None,
    blind: bool = False,
    engine: str = "mujoco",
    actuators: Actuators = "position",
    progress: Progress | None = None,
) -> Dataset:
    """Play commands on a simulated target, and return its simulated sensor readings.

    Args:
        robot: A robot's name, or an MJCF or URDF file.
        env: An environment instead of a robot: its model, rate, initial states, and commands in its action space.
        dynamics: Dynamics of the target, for `env`: one of the environment's dynamics.
        effects: Effects of the target, for example `"backlash:joint=m3,half_width=0.02"`.
        report: A gap report, or its folder, whose effects and retuned parameters are added to the target.
        excitation: Command signal, `NAME` or `NAME:PARAMETER=NUMBER,…`.
        commands: A CSV file of commands to play instead, in columns `<joint>.pos`, `.vel` or `.effort`.
        episodes: Number of episodes.
        seconds: Length of each [s]; None for 3, or the environment's.
        rate: Control rate [Hz]; None for the robot's.
        start: First pose: the robot's rest pose, or random within a fifth of each range.
        joints: Move only these joints; the others hold their rest position. All by default.
        noise: Standard deviation of the measured positions [rad].
        quantum: Resolution of the measured positions [rad]; 0 for exact readings, None for the robot's.
        velocity_noise: Standard deviation of the measured velocities [rad/s].
        seed: Seed of commands, poses and noise; same seed, same bits.
        noise_seed: Seed of the noise alone, for the same motion with other noise; None for `seed`.
        blind: Omit the effects from the provenance, to test whether they are found.
        engine: `mujoco` or `bullet`.
        actuators: Actuators for a URDF: `position` servos, or motors (`torque`).
        progress: Called with the number of recorded episodes.

    Returns:
        Transitions at the control rate, with velocities; `save` writes them.

    Raises:
        OptionError, UnknownName: a value is out of its range, or there is no such robot, environment or effect.
        JointMismatch, LogError: joints or the command file do not fit the robot.
        ModelFileError: the model cannot be used.
    """
    if env is None:
        if dynamics != DYNAMICS:
            raise OptionError("--dynamics is of an environment; add --env, or give effects with --effect.")
        body = find_robot(as_model(robot, actuators))
        readings = make_readings(body, noise, quantum, velocity_noise)
        target = make_target(body, readings, effects, report, rate, engine)
    else:
        own: dict[str, object] = {"rate": rate, "effect": effects, "effects": report, "joints": joints}
        own |= {"robot": str(robot) != ROBOT, "actuators": actuators != "position", "start": start != "rest"}
        given = next((option for option, value in own.items() if value), None)
        if given:
            raise OptionError(
                f"--{given} cannot be combined with --env, because the environment defines it; leave --{given} out."
            )
        task = find_task(env)
        body, built_in = task.body(dynamics)
        simulator = load_simulator(body, task.period, task.joints, built_in, engine)
        target = Target(body, simulator, make_readings(body, noise, quantum, velocity_noise), 1 / task.period)
        seconds = task.horizon * task.period if seconds is None else seconds
    seconds = SECONDS if seconds is None else seconds
    check_amount(episodes, seconds, LONGEST)
    protocol = PlaybackProtocol(
        excitation=parse_excitation(excitation) if isinstance(excitation, str) else excitation,
        file=None if commands is None else Path(commands),
        episodes=episodes,
        seconds=seconds,
        start=start,
        seed=seed,
        noise_seed=noise_seed,
        joints=tuple(joints),
        environment=make_environment_id(find_task_file(env)) if env else "",
    )
    session, say = RecordingSession.draw(target, protocol), progress or silence
    total = len(session.commands)
    dataset = to_dataset(
        session, play_session(session, lambda done: say(f"recorded {done} of {count_of(total, 'episode')}"))
    )
    return replace(dataset, origin=Origin(dataset, session.provenance(blind)))


def make_target(
    robot: Robot,
    readings: Readings,
    effects: Sequence[Effect | str],
    report: GapReport | str | Path | None,
    rate: float | None,
    engine: str,
) -> Target:
    """Return a robot with effects and sensors as the target of a recording.

    Raises:
        OptionError: the control rate is invalid.
    """
    rate = robot.rate if rate is None else rate
    if not SLOWEST <= rate <= FASTEST:
        raise OptionError(f"--rate is {rate}; it must be in {SLOWEST:g} … {FASTEST:g} Hz.")
    named = None if report is None else as_correction(report)
    added = [*(named.effects if named else ())]
    added += [parse_effect(effect) if isinstance(effect, str) else effect for effect in effects]
    body = named.robot(robot, robot.joints) if named else robot
    return Target(robot, load_simulator(body, 1 / rate, effects=added, engine=engine), readings, rate)


def make_readings(robot: Robot, noise: float, quantum: float | None, velocity_noise: float) -> Readings:
    """Return the sensor model: noise and quantisation."""
    return Readings(
        noise=noise,
        quantum=robot.position_quantum if quantum is None else quantum,
        velocity_noise=velocity_noise,
        # exact positions imply an exact velocity register
        velocity_quantum=0.0 if quantum == 0 else robot.velocity_quantum,
    )
