"""The virtual bus speaks Feetech's protocol byte for byte, and its servos follow their registers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nas_data.hardware.virtual_bus.arm import MountedServo, VirtualArm
from nas_data.hardware.virtual_bus.chain import ServoChain
from nas_data.hardware.virtual_bus.device import transmit
from nas_data.hardware.virtual_bus.feetech_packet import FeetechPacket, FeetechReader, encode_status
from nas_data.hardware.virtual_bus.kinds.base import Reason, find_kind
from nas_data.hardware.virtual_bus.kinds.sts3215 import (
    ACCELERATION_UNIT,
    TICK,
    decode_sign_magnitude,
    encode_sign_magnitude,
)
from nas_data.hardware.virtual_bus.packet import Packet
from nas_data.hardware.virtual_bus.servo import VirtualServo
from nas_data.robots.base import find_robot

# Example packets of Feetech's protocol manual: identity, instruction or error, parameters, bytes on the wire.
EXAMPLES = {
    "ping": (1, 0x01, "", "FF FF 01 02 01 FB"),
    "answer to a ping": (1, 0x00, "", "FF FF 01 02 00 FC"),
    "read": (1, 0x02, "38 02", "FF FF 01 04 02 38 02 BE"),
    "answer to a read": (1, 0x00, "18 05", "FF FF 01 04 00 18 05 DD"),
    "write": (1, 0x03, "2A 00 08 00 00 E8 03", "FF FF 01 09 03 2A 00 08 00 00 E8 03 D5"),
    "sync read": (254, 0x82, "38 08 01 02", "FF FF FE 06 82 38 08 01 02 36"),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_manuals_examples_are_written_and_read_byte_for_byte(name):
    identity, instruction, parameters, wire = EXAMPLES[name]
    packet = FeetechPacket(identity, instruction, bytes.fromhex(parameters))
    assert packet.encode() == bytes.fromhex(wire)
    assert FeetechReader().decode(bytes.fromhex(wire)) == packet


@given(st.integers(0, 253), st.integers(0, 255), st.binary(max_size=60), st.binary(max_size=8))
def test_a_packet_is_found_in_whatever_surrounds_it(identity, instruction, parameters, noise):
    packet, noise = FeetechPacket(identity, instruction, parameters), noise.replace(b"\xff", b"")
    assert FeetechReader().feed(noise + packet.encode() + noise + packet.encode()) == [packet, packet]


@given(st.binary(min_size=1, max_size=30), st.data())
def test_a_bit_that_flips_is_noticed(parameters, data):
    whole = bytearray(FeetechPacket(3, 2, parameters).encode())
    place = data.draw(st.integers(4, len(whole) - 1))
    whole[place] ^= 1 << data.draw(st.integers(0, 7))
    assert not FeetechReader().decode(bytes(whole)).is_valid


@given(st.integers(-2047, 2047))
def test_sign_and_magnitude_come_back(value):
    assert decode_sign_magnitude(encode_sign_magnitude(value, 11), 11) == value


@pytest.fixture
def chain() -> ServoChain:
    return ServoChain([VirtualServo(identity, kind=find_kind("sts3215")) for identity in (1, 2, 3)])


def ask(chain: ServoChain, identity: int, instruction: int, parameters: str = "", sound: bool = True) -> list[bytes]:
    packet = Packet(identity, instruction, bytes.fromhex(parameters), sound)
    return [reply.content for reply in chain.respond(packet)]


def test_servos_answer_as_the_manual_says(chain):
    assert ask(chain, 2, 0x01) == [encode_status(2)]
    assert ask(chain, 2, 0x02, "03 02") == [encode_status(2, 0, (777).to_bytes(2, "little"))]
    assert ask(chain, 1, 0x03, "2A 00 08") == [encode_status(1)]
    assert ask(chain, 1, 0x02, "2A 02") == [encode_status(1, 0, bytes([0, 8]))]
    assert [content[2] for content in ask(chain, 254, 0x82, "2A 02 03 01")] == [3, 1]
    assert [content[2] for content in ask(chain, 254, 0x82, "2A 02 01 07 03")] == [1], "a missing one ends it"
    assert ask(chain, 254, 0x83, "2A 02 01 00 04 03 00 02") == []
    assert [servo.get("goal_position") for servo in chain.servos] == [0x400, 0, 0x200]
    assert ask(chain, 1, 0x02, "2A 02", sound=False) == ask(chain, 1, 0x77) == ask(chain, 9, 0x01) == []


def test_an_answer_carries_the_status_and_takes_its_time(chain):
    chain.servos[0].fail(Reason.OVERLOAD)
    ((after, content),) = transmit(chain.respond(Packet(1, 0x02, bytes([56, 2]))), 1_000_000)
    assert content[4] == 32
    assert after == pytest.approx(500e-6 + 8 * 10e-6)


@pytest.mark.parametrize(
    ("registers", "expected"),
    [
        ({}, {"powered": False, "stiffness": 2.0, "strength": 1.0, "deadband": TICK}),
        ({"torque_enable": 1, "p_gain": 16}, {"powered": True, "stiffness": 1.0}),
        ({"homing_offset": (1 << 11) | 30, "goal_position": 100}, {"goal": 70}),
        ({"goal_position": 4000, "highest_position": 3000}, {"goal": 3000}),
        ({"acceleration": 10, "goal_speed": 100}, {"acceleration": 10 * ACCELERATION_UNIT, "speed": 100 * TICK}),
        ({"acceleration": 0}, {"acceleration": np.inf, "speed": np.inf}),
        ({"acceleration": 254}, {"acceleration": 50 * ACCELERATION_UNIT}),
        ({"acceleration": 254, "maximum_acceleration": 254}, {"acceleration": np.inf}),
        ({"torque_limit": 500, "cw_dead_zone": 5}, {"strength": 0.5, "deadband": 5 * TICK}),
        ({"torque_enable": 1, "hardware_error": 32}, {"powered": True, "strength": 0.2}),
        ({"torque_enable": 1, "hardware_error": 4}, {"powered": False}),
        ({"torque_enable": 1, "hardware_error": 4, "unloading": 0}, {"powered": True}),
    ],
)
def test_registers_mean_what_the_table_says(registers, expected):
    servo = VirtualServo(1, kind=find_kind("sts3215"))
    for name, value in registers.items():
        servo.put(name, value)
    assert {name: getattr(servo.drive, name) for name in expected} == pytest.approx(expected)


@pytest.mark.parametrize("name", ["xl430_w250", "xl330_m288"])
def test_a_dynamixel_of_the_x_series_adds_its_offset_and_lets_go_where_it_fails(name):
    servo = VirtualServo(1, kind=find_kind(name))
    servo.put("homing_offset", 256**4 - 30)
    assert servo.drive.goal == 30
    servo.put("torque_enable", 1)
    servo.fail(Reason.OVERHEAT)
    assert not servo.drive.powered
    assert servo.get("hardware_error") == 4


def moved(seconds: float, **registers: int) -> np.ndarray:
    """Return where the shoulder's pan of an SO-101 is [rad] after a goal of half a radian, every 20 ms."""
    robot = find_robot("so101_follower")
    common = {"torque_enable": 1, "p_gain": 16, "goal_position": 2047, "torque_limit": 1000}
    names = enumerate(robot.joints, 1)
    mounted = [MountedServo(joint=j, kind="sts3215", id=i, zero=2047.0, sign=1, registers=common) for i, j in names]
    arm = VirtualArm.of((), str(robot.mjcf), mounted, np.zeros(6))
    arm.body.advance_to(0.5)
    for name, value in registers.items():
        arm.servos[0].put(name, value)
    arm.servos[0].put("goal_position", 2047 + round(0.5 / TICK))
    path = []
    for step in range(round(seconds / 0.02)):
        arm.body.advance_to(0.5 + 0.02 * (step + 1))
        path.append((arm.servos[0].get("present_position") - 2047) * TICK)
    return np.array(path)


def test_a_servo_goes_where_it_is_told_as_fast_and_as_softly_as_its_registers_say():
    plain = moved(1.0)
    assert plain[-1] == pytest.approx(0.5, abs=0.03)
    slow = moved(1.0, goal_speed=round(0.3 / TICK))
    assert np.diff(slow)[20:40] / 0.02 == pytest.approx(np.full(20, 0.3), abs=0.1)
    soft = moved(1.0, acceleration=20)
    assert soft[10] < 0.5 * plain[10]
    assert soft[-1] == pytest.approx(0.5, abs=0.05)
    assert moved(1.0, torque_limit=150)[10] < plain[10] - 0.05
    lazy = moved(1.0, cw_dead_zone=32, ccw_dead_zone=32)[-1]
    assert abs(plain[-1] - 0.5) + 0.01 < abs(lazy - 0.5) < 33 * TICK
