"""Construction of a simulator by the name of its physics engine."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from nas_data.effects.base import Effect
from nas_data.errors import UnknownName
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.base import Simulator

ENGINE_NAMES = {"mujoco": "MuJoCo", "bullet": "PyBullet"}
ENGINES = tuple(ENGINE_NAMES)
MUJOCO = ENGINES[0]


def load_simulator(
    model: str | Path | Robot,
    period: float,
    joints: Sequence[str] | None = None,
    effects: Iterable[Effect] = (),
    engine: str = "mujoco",
    threads: int | None = None,
) -> Simulator:
    """Build a simulator.

    Args:
        model: A robot, its name or a model file.
        period: Control period [s].
        joints: Joints to measure and command; those that actuators drive if None.
        effects: Effects to add to the model.
        engine: One of `ENGINES`.
        threads: Threads for batched work; all cores if None. PyBullet uses one.

    Raises:
        UnknownName: there is no such engine.
        NasError: the model cannot be used; see the engine's file.
    """
    robot = model if isinstance(model, Robot) else find_robot(model)
    if engine == "mujoco":
        from nas_data.simulators.mujoco import MujocoSimulator

        return MujocoSimulator(robot, period, joints, effects, threads)
    if engine == "bullet":
        from nas_data.simulators.bullet import BulletSimulator

        return BulletSimulator(robot, period, joints, effects)
    raise UnknownName("engine", engine, ENGINES)
