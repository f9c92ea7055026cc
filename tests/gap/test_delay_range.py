"""A delay that differs from episode to episode is told from one that does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nas_data.cli import main
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.write import write
from nas_data.effects.base import parse
from nas_data.gap.delay_range import find_delay_range, find_minimum, read_range
from nas_data.gap.problem import Problem

SHORT, LONG = 0.02, 0.05  # [s]
FRICTION = "coulomb_friction:joint=pendulum,torque=0.05"


def record(folder: Path, delay: float, seed: int, *effects: str, episodes: int = 4, seconds: float = 1.5) -> Path:
    names = [f"command_delay:delay={delay}", *effects]
    options = [word for name in names for word in ("--effect", name)]
    command = ["record", "sim", "--robot", "pendulum", *options, "--noise", "0.0009", "--out", str(folder)]
    assert main([*command, "--episodes", str(episodes), "--seconds", str(seconds), "--seed", str(seed)]) == 0
    return folder


def join(folder: Path, *parts: Path) -> Problem:
    assert main(["merge", *map(str, parts), "--out", str(folder)]) == 0
    return Problem.load(folder, "pendulum")


@pytest.mark.parametrize("fitted", [SHORT, 0.03, LONG])
def test_episodes_with_two_delays_have_both(tmp_path: Path, fitted: float):
    """Whatever compromise was fitted, within 5 %."""
    problem = join(tmp_path / "both", record(tmp_path / "a", SHORT, 0), record(tmp_path / "b", LONG, 1))
    effects = [parse(f"command_delay:joint=pendulum,delay={fitted}")]
    least, most = find_delay_range(problem.train, effects, {}, 0)["delay"]
    assert (least, most) == (pytest.approx(SHORT, rel=0.05), pytest.approx(LONG, rel=0.05))


@pytest.mark.parametrize("fitted", [0.0195, 0.0205])
def test_episodes_with_one_delay_have_no_range(tmp_path: Path, fitted: float):
    """Also where the model lacks friction that the recording has, so that the rest is far above the noise."""
    parts = record(tmp_path / "a", SHORT, 0, FRICTION), record(tmp_path / "b", SHORT, 1, FRICTION)
    problem = join(tmp_path / "same", *parts)
    delay = f"command_delay:joint=pendulum,delay={fitted}"
    assert find_delay_range(problem.train, [parse(delay), parse(FRICTION)], {}, 1) == {}
    for effects in ([parse(delay)], [parse(delay), parse(FRICTION)]):
        assert find_delay_range(problem.train, effects, {}, 0) == {}


def test_a_delay_that_changes_within_an_episode_is_found(tmp_path: Path):
    """In two long episodes, from the middle on."""
    folder = record(tmp_path / "constant", SHORT, 0, episodes=2, seconds=20)
    constant, provenance = read(folder), read_provenance(folder)
    commands, late = constant.columns["action"].copy(), round((LONG - SHORT) * constant.fps)
    for rows in constant.episodes():
        second = slice((rows.start + rows.stop) // 2, rows.stop)
        commands[second] = np.concatenate([commands[second][late:], np.repeat(commands[second][-1:], late, axis=0)])
    assert provenance is not None
    write(replace(constant, columns={**constant.columns, "action": commands}), tmp_path / "changing", provenance)
    effects = [parse(f"command_delay:joint=pendulum,delay={SHORT}")]
    assert find_delay_range(Problem.load(folder, "pendulum").train, effects, {}, 0) == {}
    least, most = find_delay_range(Problem.load(tmp_path / "changing", "pendulum").train, effects, {}, 0)["delay"]
    assert (least, most) == (pytest.approx(SHORT, rel=0.05), pytest.approx(LONG, rel=0.05))


def test_an_episode_in_which_nothing_moves_has_no_delay_of_its_own():
    moving, resting = np.array([9.0, 1.0, 9.0]), np.array([5.0, 5.1, 5.0])
    table = dict(zip((-1, 0, 1), np.stack([moving, resting], axis=1), strict=True))
    assert read_range(table, 0.02) is None


def test_the_minimum_of_a_parabola_is_found():
    shifts = np.arange(-2, 3)
    assert find_minimum(shifts, (shifts - 0.3) ** 2) == pytest.approx(0.3)
    assert find_minimum(shifts, 1.0 * shifts) == -2
