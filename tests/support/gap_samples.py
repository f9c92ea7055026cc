"""A gap report of three joints, with its series, as `nas gap` would have written it."""

import copy
import json

import numpy as np

JOINTS = ("m1", "m2", "gripper/left")
FLOOR = np.full(3, 0.0015)
EPISODES = np.array([2, 5, 8])

BACKLASH = {
    "effect": "backlash",
    "joint": "m2",
    "parameters": {"half_width": {"value": 0.0173, "unit": "rad", "interval95": [0.0162, 0.0184]}},
    "confidence": 0.97,
    "evidence": {"heldout_error_before": 0.0211, "heldout_error_after": 0.0021},
    "alternatives": [{"effect": "joint_compliance", "joint": "m2", "heldout_error_after": 0.0093}],
    "in_model_xml": True,
}
DELAY = {
    "effect": "command_delay",
    "joint": None,
    "parameters": {"delay": {"value": 0.0314, "unit": "s", "interval95": [0.03, 0.0327]}},
    "confidence": 0.64,
    "evidence": {"heldout_error_before": 0.05, "heldout_error_after": 0.02},
    "alternatives": [{"effect": "rotor_inertia", "joint": "m1", "heldout_error_after": 0.0201}],
    "equals": [{"effect": "rotor_inertia", "joint": "m1"}],
    "in_model_xml": False,
}
REST = {"joint": "m1", "ratio_to_noise": 6.3, "goes_with": "position"}
BINS = [("speed", "still", 1.2), ("speed", "fast", 14.2), ("reversal", "after a reversal", 33.0)]
FIND = {
    "joints": {
        joint: {
            "floor": 0.0015,
            "one_step": 0.002,
            "one_step_hold": 0.004,
            "open_loop": 0.02,
            "open_loop_hold": 0.4,
            "open_loop_command": 0.1,
            "ratio_to_noise": 13.3,
        }
        for joint in JOINTS
    },
    "regimes": [
        {
            "joint": joint,
            "regime": regime,
            "bin": name,
            "rows": 90,
            "rmse": ratio * 0.0015,
            "rest": 0.0015,
            "ratio_to_noise": ratio,
            "share": 0.4,
            "significant": ratio > 2,
        }
        for joint in JOINTS
        for regime, name, ratio in BINS
    ],
    "audit": [
        {"check": "timing", "finding": "no row is late", "ok": True},
        {"check": "command shift", "finding": "commands look one row late", "ok": False},
    ],
    "undecidable": ["m1 never turned round: play and friction look alike."],
}
REPORT = {
    "schema": 1,
    "verdict": "explained",
    "dataset": "arm_steps",
    "model": "arm.xml",
    "effects": [BACKLASH],
    "retuned": [{"parameter": "m2.damping", "factor": 0.934}, {"parameter": "m1.mass", "factor": 1.12}],
    "unexplained": [],
    "gap": {
        "metric": "open-loop position RMSE on held-out episodes",
        "unit": "rad",
        "noise_floor": 0.0015,
        "before": 0.0207,
        "after": 0.0017,
        "per_joint": {joint: {"before": 0.02, "after": 0.0017} for joint in JOINTS},
    },
    "find": FIND,
    "shares": {"names": 0.93, "learned": None, "left": 0.07},
    "placebo": {
        "effects": [{"effect": "joint_compliance", "joint": "m2"}],
        "after": 0.0111,
        "text": "joint_compliance",
    },
    "next_experiment": "slow triangle on m2: separates backlash from joint compliance",
    "episodes": {"train": [0, 1, 3, 4, 6, 7], "heldout": EPISODES.tolist()},
    "seed": 0,
    "seconds": 38.4,
}


def series(rng, gap=0.02, placebo=True):
    """Return held-out episodes with a joint (m2) that is off, of which one is shorter than the others."""
    time = 0.02 * np.arange(1, 101)
    measured = np.sin(time[None, :, None] * (1 + rng.random((3, 1, 3))))
    counts = np.ones((3, 100), bool)
    counts[1, 70:] = False

    def off(size):
        return measured + FLOOR * rng.standard_normal(measured.shape) + size * np.array([0.0, 1.0, 0.0])

    parts = {"before": off(gap), "retuned": off(0.9 * gap), "after": off(0.0)}
    parts |= {"placebo": off(0.5 * gap)} if placebo else {}
    return {
        "time": time,
        "joints": np.array(JOINTS),
        "episodes": EPISODES,
        "measured": measured,
        "command": np.sign(measured),
        "counts": counts,
        "floor": FLOOR,
        **parts,
    }


def written(folder, changes=None, drawn=None, gap=0.02):
    """Write a report and its series."""
    folder.mkdir(exist_ok=True)
    report = {**copy.deepcopy(REPORT), **(changes or {})}
    (folder / "report.json").write_text(json.dumps(report))
    np.savez(folder / "series.npz", **(drawn or series(np.random.default_rng(0), gap)))
    return folder
