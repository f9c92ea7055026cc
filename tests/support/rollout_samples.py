"""Policies that always do the same, and their rollouts on virtual arms through the program."""

import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from nas_data.cli import main
from nas_data.envs.base import find_task

LOCKSTEP = ("--on", "ergojr", "--port", "virtual", "--lockstep")


def work_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HF_LEROBOT_CALIBRATION", str(folder / "calibration"))
    return folder


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
