"""Virtual arms for tests: answers at once, and moves with the goals instead of by the clock."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from nas_data.hardware.virtual_bus.process import VirtualBus
from nas_data.hardware.virtual_bus.terminal import Options
from nas_data.hardware.xl320.arm import Xl320Arm
from nas_data.hardware.xl320.joints import make_ergojr_joints


@contextmanager
def virtual(*faults: str, effects: tuple[str, ...] = (), offsets: tuple[int, ...] = ()) -> Iterator[VirtualBus]:
    """Yield a virtual arm in its own process."""
    options = Options(effects=effects, faults=faults, offsets=offsets, wire_delay=False, lockstep=True)
    with VirtualBus(options) as bus:
        yield bus


@contextmanager
def connected(*faults: str, effects: tuple[str, ...] = (), offsets: tuple[int, ...] = ()) -> Iterator[Xl320Arm]:
    """Yield a driver on a virtual arm."""
    with virtual(*faults, effects=effects, offsets=offsets) as bus, Xl320Arm(bus.port, make_ergojr_joints()) as arm:
        yield arm


def be_patient(monkeypatch: pytest.MonkeyPatch, seconds: float = 1.0) -> None:
    """Let drivers in this process wait so long for each answer: on a busy machine, a virtual arm may be that late."""
    monkeypatch.setattr("nas_data.hardware.xl320.bus.LENIENCE", seconds)


def be_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let recorders in this process go to first poses faster than a real arm should, and hold them for less long."""
    monkeypatch.setattr("nas_data.recorders.arm_motion.APPROACH", 1.5)  # [rad/s]
    monkeypatch.setattr("nas_data.recorders.arm_motion.SETTLE", 0.2)  # [s]


def torques(port: str) -> list[int]:
    """Read the torque of every servo; the port may still be someone else's for a moment."""
    joints = make_ergojr_joints()
    arm = Xl320Arm(port, joints)
    found = [arm.bus.get(identity, "torque_enable") for identity in joints.ids]
    arm.close()
    return found
