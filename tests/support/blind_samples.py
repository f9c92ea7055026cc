"""Blind cases small enough for a test, and workflows under test that know everything or nothing."""

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from nas_data.benchmarks.blind.arms import NominalArm, build_ergojr, draw_random_arm
from nas_data.benchmarks.blind.case import Base, Case, CommandSequence, Conditions, Identity, SealedAnswer, Truth
from nas_data.benchmarks.blind.draw import draw_case, make_scripts
from nas_data.benchmarks.blind.plants.base import find_plant
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.mujoco_plant import multiply
from nas_data.benchmarks.blind.settings import any as any_setting
from nas_data.benchmarks.blind.settings import torque, xl320
from nas_data.effects.base import add_effects, make_effect
from nas_data.robots.base import read_spec
from nas_data.typed_json import from_json

PERIOD = 0.01  # [s]


def arms() -> list[NominalArm]:
    """Return an arm of either sort."""
    return [build_ergojr(), draw_random_arm(np.random.default_rng(3))]


def steps(episodes: int, seconds: float, seed: int = 1, hold: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """Return commands (E, T, 6) that jump every `hold` periods, and poses (E, 6)."""
    rng = np.random.default_rng(seed)
    count = round(seconds / PERIOD)
    targets = rng.uniform(-1.2, 1.2, (episodes, -(-count // hold), 6))
    return np.repeat(targets, hold, axis=1)[:, :count], rng.uniform(-0.3, 0.3, (episodes, 6))


def positions(plant: str, arm: NominalArm, truths: list[Truth], commands: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return where a plant's links are [rad], shape (len(truths), E, T + 1, n)."""
    return find_plant(plant)(arm, truths, commands, poses, PERIOD)[..., : len(arm.joints)]


def drawn(number: int, episodes: int = 1) -> tuple[NominalArm, Conditions, np.ndarray, np.ndarray]:
    """Return an arm of the setting `any`, its conditions, and a few commands and poses."""
    setting, identity = any_setting.SETTING, Identity("none", "numpy", number, 5, setting="any")
    arm, conditions = setting.draw(identity)
    control = Constants.of(arm.model()).control
    return arm, conditions, *setting.episodes(conditions, episodes, control, identity.stream("commands"))


@cache
def followed(number: int) -> tuple[NominalArm, Conditions, CommandSequence]:
    """Return a machine of the setting `torque`, its conditions, and what its nominal self did."""
    identity = Identity("none", "numpy", number, 5, setting="torque")
    arm, conditions = torque.SETTING.draw(identity)
    handed, _ = make_scripts(arm, conditions, torque.SETTING.episodes, identity.stream("commands"))
    return arm, conditions, handed("numpy", Truth(Base.nominal(len(arm.joints))))


@cache
def shortened(**identity: object) -> Case:
    """Draw a case of the settings that `shorten` makes."""
    return draw_case(**identity)


def shorten(monkeypatch) -> None:
    """Let cases have three episodes of half a second (other arms: of one), and two fresh ones; none is drawn twice.

    Motions under torque commands are cut in two pieces of half a second, two motions handed over and one kept back.
    Sizes of effects are tried first on MuJoCo, which is fast where episodes are few and short.
    """
    monkeypatch.setattr("nas_data.benchmarks.blind.run_case.draw_case", shortened)
    monkeypatch.setattr(xl320, "EPISODES", 3)
    monkeypatch.setattr(xl320, "FRESH", 2)
    monkeypatch.setattr(xl320, "SECONDS", 0.5)
    monkeypatch.setattr(any_setting, "EPISODES", (3, 3))
    monkeypatch.setattr(any_setting, "FRESH", 2)
    monkeypatch.setattr(any_setting, "SECONDS", (1.0, 1.0))
    monkeypatch.setattr(torque, "PIECES", (2, 2))
    monkeypatch.setattr(torque, "MOTIONS", (2, 2))
    monkeypatch.setattr(torque, "SECONDS", (0.5, 0.5))
    for setting in (xl320, torque):
        monkeypatch.setattr(setting, "SETTING", replace(setting.SETTING, screen="mujoco"))


def report_of(effects: list, verdict: str, unexplained: list | None = None) -> dict:
    """Return a report of the contract's form."""
    return {"schema": 1, "verdict": verdict, "effects": effects, "unexplained": unexplained or []}


def entry_of(
    effect: str, joint: str | None, values: dict, confidence: float = 0.95, beside: list | None = None
) -> dict:
    """Return one effect of a report."""
    parameters = {key: {"value": value, "interval95": [value * 0.9, value * 1.1]} for key, value in values.items()}
    alternatives = [{"effect": name} for name in beside or []]
    return {
        "effect": effect, "joint": joint, "parameters": parameters, "confidence": confidence,
        "alternatives": alternatives,
    }  # fmt: skip


def know_nothing(dataset: Path, model: Path, out: Path) -> None:
    """Say that nothing hides."""
    out.mkdir(parents=True)
    (out / "report.json").write_text(json.dumps(report_of([], "none")))
    shutil.copy(model, out / "model.xml")


def know_everything(dataset: Path, model: Path, out: Path) -> None:
    """Read the sealed answer, which no workflow may."""
    answer = json.loads((dataset.parent / "answer.json").read_text())
    hidden = [(entry["effect"], entry["joint"], entry["parameters"]) for entry in answer["effects"]]
    spec = read_spec(model)
    joints = tuple(answer["joints"])
    multiply(spec, joints, Base(**answer["base"]))
    add_effects(spec, [make_effect(*entry) for entry in hidden])
    spec.compile()
    out.mkdir(parents=True)
    (out / "model.xml").write_text(spec.to_xml())
    report = report_of([entry_of(*entry) for entry in hidden], "explained")
    (out / "report.json").write_text(json.dumps(report))


FINE = 1e-4  # [s] timestep of the reference
INDEPENDENT = ("numpy", pytest.param("bullet", marks=pytest.mark.bullet))


def reference(
    arm: NominalArm, commands: np.ndarray, poses: np.ndarray, period: float = PERIOD, settle: float = 0.5
) -> np.ndarray:
    """Return positions (E, T + 1, n) of the nominal arm in MuJoCo at a fine timestep."""
    spec = arm.spec()
    spec.option.timestep = FINE
    for joint in spec.joints:
        joint.solref_friction = [2 * FINE, 1]
    model = spec.compile()
    shown = []
    for episode, pose in zip(commands, poses, strict=True):
        data = mujoco.MjData(model)
        data.qpos[:] = data.ctrl[:] = pose
        mujoco.mj_step(model, data, round(settle / FINE))
        rows = [data.qpos.copy()]
        for command in episode:
            data.ctrl[:] = command
            mujoco.mj_step(model, data, round(period / FINE))
            rows.append(data.qpos.copy())
        shown.append(rows)
    return np.array(shown)


def answered(effects: list[dict], **more) -> SealedAnswer:
    """Return a sealed answer that hides some effects; the other entries are arbitrary unless given."""
    sensor = {"noise": 0.0, "quantum": 0.0, "floor": 0.001}
    conditions = {"rate": 100.0, "seconds": 3.0, "episodes": 2, "fresh": 2, "settle": 0.5, "signal": "steps"}
    ones = [1.0, 1.0]
    whole = {
        "case": "one", "family": "one", "plant": "mujoco", "number": 0, "seed": 0, "faint": False, "setting": "xl320",
        "arm": "arm", "joints": [], "excitation": "steps", "conditions": {**conditions, "sensor": sensor},
        "base": {"mass": ones, "damping": ones, "armature": ones, "stiffness": ones},
    }  # fmt: skip
    hidden = [{"mark": 5.0, "marked_joint": entry["joint"] or "", **entry} for entry in effects]
    return from_json(SealedAnswer, {**whole, **more, "effects": hidden})
