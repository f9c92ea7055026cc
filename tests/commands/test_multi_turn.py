"""A joint that makes many turns is split, checked, predicted, learned and evaluated like any other."""

from pathlib import Path

import numpy as np
import pytest
from support.command_samples import FAST, done

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.dataset.versions import resolve

CART = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body><joint name="wheel" axis="0 1 0" damping="{damping}" armature="0.01"/><geom size="0.05" mass="0.1"/></body>
<body pos="0 0.3 0"><joint name="winch" axis="0 1 0" damping="{damping}" armature="0.01"/><geom size="0.05" mass="0.1"/>
</body></worldbody>
<actuator><velocity joint="wheel" kv="1"/><position joint="winch" kp="20" kv="1"/></actuator></mujoco>"""
TWO_TURNS = 4 * np.pi  # [rad]


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A folder in which a wheel and a winch have turned ten times, and a model with less damping."""
    monkeypatch.chdir(tmp_path)
    Path("robot.xml").write_text(CART.format(damping=0.3))
    Path("model.xml").write_text(CART.format(damping=0.05))
    rows = [f"{episode},{speed},{0.4 * row}" for episode, speed in enumerate((20, -25)) for row in range(150)]
    Path("commands.csv").write_text("\n".join(["episode,wheel.vel,winch.pos", *rows]) + "\n")
    done("record", "sim", "--robot", "robot.xml", "--commands", "commands.csv", "--out", "turning")
    return tmp_path


@pytest.mark.slow
def test_every_command_takes_positions_of_many_turns(here):
    turning = read(here / "turning")
    assert (np.abs(turning.states[:, :2]).max(axis=0) > 2 * TWO_TURNS).all()
    done("verify", "turning")
    done("split", "turning", "--seconds", "1", "--name", "cut")
    cut = read(resolve(here / "datasets/cut"))
    assert cut.n_episodes == 6 and np.array_equal(cut.states, turning.states)
    done("pair", "datasets/cut", "--model", "model.xml", "--out", "paired")
    done("verify", "paired")
    for kind in ("delta", "forward"):
        done("train", kind, "paired", "--out", kind, *FAST)
        found = done("evaluate", kind, "paired", "--json").json
        assert found
    own = done("evaluate", "robot.xml", "datasets/cut", "--json").out
    assert "NaN" not in own
    loaded = Dataset.load(here / "datasets/cut")
    again = Dataset.from_arrays(
        loaded.states[:, :2], loaded.commands, rate=loaded.fps, joints=loaded.joints,
        kind=("velocity", "position"), turns=True,
    )  # fmt: skip
    done("verify", again.save(here / "made"))
