"""Arms of two to seven joints and any size, each servo strong and quick enough for its load."""

from dataclasses import replace

import mujoco
import numpy as np

from nas_data.benchmarks.blind.arms import RANGE, JointDrive, Link, NominalArm, Style, to_mjcf

JOINTS = (2, 7)
LENGTH = (0.05, 0.6)  # [m] length of a link
LONGEST = 1.2  # [m] approximate largest length of a stretched arm, that of a small industrial one
SPREAD = (0.7, 1.2)  # link lengths relative to the arm's mean
DENSITY = 13.0  # [kg/m²] mass over length squared: 0.3 kg at 15 cm, as small arms have
BANDWIDTH = (2.5, 6.0)  # [Hz] bandwidth of the closed loop
RATIO = (0.5, 1.1)  # damping ratio
DROOP = (0.02, 0.12)  # [rad] largest droop under the arm's weight; sets how heavy the rotors behind the gears are
ROTOR = (0.2, 0.8)  # least rotor inertia over carried inertia
LIGHTEST = 5e-4  # [kg m²] least reflected rotor inertia: half that of an XL-320, the smallest servo
SPARE = (2.0, 4.0)  # least ratio of torque limit to largest gravity torque
SPEED = (1.5, 5.0)  # [rad/s] at which damping takes the torque limit: industrial arms reach 3, an XL-320 12
FRICTION = (0.005, 0.04)  # friction as a share of the torque limit
TIMESTEPS = (0.001, 0.002)  # [s]
POSTURES, REACH = 40, 1.2  # random postures in which a servo's load is measured; their largest joint angle [rad]
SHAPES = {"box": "{width:.5f} {width:.5f} {half:.5f}", "capsule": "{width:.5f} {half:.5f}"}
SHAPES["cylinder"] = SHAPES["capsule"]
PREFIXES = ("j", "joint", "axis_")


def draw_design(rng: np.random.Generator, period: float, excess: float = 1.0) -> NominalArm:
    """Draw an arm whose timestep divides the control period [s]; `excess` multiplies the servos' gains."""
    count = int(rng.integers(JOINTS[0], JOINTS[1] + 1))
    prefix = str(rng.choice(PREFIXES))
    joints = tuple(f"{prefix}{number}" for number in range(1, count + 1))
    links, style = draw_links(rng, count), draw_style(rng, period)
    carried = measure_joint_loads(to_mjcf(joints, links, [], style), rng)
    drawn = [draw_servo(rng, *load) for load in zip(*carried, strict=True)]
    servos = [replace(servo, gain=servo.gain * excess) for servo in drawn]
    return NominalArm("arm", to_mjcf(joints, links, servos, style), joints)


def draw_style(rng: np.random.Generator, period: float) -> Style:
    """Draw how the model is written; its timestep divides the control period [s]."""
    steps = [step for step in TIMESTEPS if abs(period / step - round(period / step)) < 1e-9]
    return Style(
        timestep=float(rng.choice(steps)),
        integrator=str(rng.choice(["Euler", "implicitfast"])),
        spelling=str(rng.choice(["position", "general"])),
        control=RANGE if rng.random() < 0.5 else None,
    )


def draw_links(rng: np.random.Generator, count: int) -> list[Link]:
    """Draw links of similar size, lighter towards the tip, with centres of mass off the line of the joints."""
    size = draw_log_uniform(rng, LENGTH[0] / SPREAD[0], min(LENGTH[1] / SPREAD[1], LONGEST / count))
    lengths = size * rng.uniform(*SPREAD, count)
    taper = np.linspace(1.0, rng.uniform(0.4, 1.0), count)
    masses = DENSITY * lengths**2 * rng.uniform(0.5, 1.5, count) * taper
    before = [0.05, *lengths[:-1]]
    shape = str(rng.choice(sorted(SHAPES)))
    return [draw_link(rng, shape, *values) for values in zip(before, lengths, masses, strict=True)]


def draw_link(rng: np.random.Generator, shape: str, before: float, length: float, mass: float) -> Link:
    """Draw position, axis and centre of mass of a link of given length [m] and mass [kg]."""
    aside = before * rng.uniform(-0.1, 0.1, 2)
    axis = np.eye(3)[rng.choice(3, p=[0.4, 0.4, 0.2])] * rng.choice([-1, 1])
    centre = length * np.array([*rng.uniform(-0.15, 0.15, 2), rng.uniform(0.35, 0.65)])
    sizes = SHAPES[shape].format(width=length * rng.uniform(0.05, 0.12), half=0.4 * length)
    geom = f'type="{shape}" size="{sizes}" pos="{format_numbers(centre)}" mass="{mass:.6g}"'
    return Link(format_numbers(np.array([*aside, before])), format_numbers(axis), geom)


def measure_joint_loads(bare: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Measure the load of each joint over random postures of an arm without servos.

    Returns:
        Mean inertia [kg m²] and largest gravity torque [N m], shape (n,) each.
    """
    model = mujoco.MjModel.from_xml_string(bare)
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    inertias, torques = [], []
    for _ in range(POSTURES):
        data.qpos[:] = rng.uniform(-REACH, REACH, model.nq)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        inertias.append(np.diag(mass).copy())
        torques.append(np.abs(data.qfrc_bias))
    return np.mean(inertias, axis=0), np.max(torques, axis=0)


def draw_servo(rng: np.random.Generator, inertia: float, gravity: float) -> JointDrive:
    """Draw a servo by its closed loop: bandwidth, damping ratio, and droop under its load."""
    frequency = 2 * np.pi * draw_log_uniform(rng, *BANDWIDTH)
    held = gravity / draw_log_uniform(rng, *DROOP) / frequency**2  # least inertia with which the loop holds the droop
    armature = max(LIGHTEST, inertia * rng.uniform(*ROTOR), held - inertia)
    gain = (inertia + armature) * frequency**2
    loss = 2 * rng.uniform(*RATIO) * frequency * (inertia + armature)
    own = float(rng.choice([0.0, 0.5, 0.9]))  # share of the damping that is inside the servo
    limit = max(rng.uniform(*SPARE) * gravity, draw_log_uniform(rng, *SPEED) * loss)
    return JointDrive(gain, own * loss, limit, armature, (1 - own) * loss, rng.uniform(*FRICTION) * limit)


def draw_log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw from a log-uniform distribution."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def format_numbers(values: np.ndarray) -> str:
    """Format numbers for an MJCF attribute."""
    return " ".join(f"{value:.5g}" for value in values)
