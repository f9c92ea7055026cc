"""The virtual bus speaks Protocol 2.0 byte for byte, and dynamixel-sdk's own parsing agrees."""

import dynamixel_sdk
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nas_data.hardware.virtual_bus.chain import ServoChain
from nas_data.hardware.virtual_bus.device import collide, transmit
from nas_data.hardware.virtual_bus.packet import (
    Instruction,
    Packet,
    Protocol2Reader,
    compute_crc16,
    encode_status,
    stuff,
    unstuff,
)
from nas_data.hardware.virtual_bus.servo import VirtualServo

decode = Protocol2Reader().decode

# Example packets of the e-manual's page on Protocol 2.0: identity, instruction, parameters, bytes on the wire.
EXAMPLES = {
    "ping": (1, 0x01, "", "FF FF FD 00 01 03 00 01 19 4E"),
    "ping to all": (254, 0x01, "", "FF FF FD 00 FE 03 00 01 31 42"),
    "read": (1, 0x02, "84 00 04 00", "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"),
    "write": (1, 0x03, "74 00 00 02 00 00", "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89"),
    "reg write": (1, 0x04, "68 00 C8 00 00 00", "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E"),
    "action": (1, 0x05, "", "FF FF FD 00 01 03 00 05 02 CE"),
    "factory reset": (1, 0x06, "01", "FF FF FD 00 01 04 00 06 01 A1 E6"),
    "reboot": (1, 0x08, "", "FF FF FD 00 01 03 00 08 2F 4E"),
    "sync read": (254, 0x82, "84 00 04 00 01 02", "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA"),
    "sync write": (
        254,
        0x83,
        "74 00 04 00 01 96 00 00 00 02 AA 00 00 00",
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    "bulk read": (
        254,
        0x92,
        "01 90 00 02 00 02 92 00 01 00",
        "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
    ),
    "bulk write": (
        254,
        0x93,
        "01 20 00 02 00 A0 00 02 1F 00 01 00 50",
        "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
    ),
    "status of ping": (1, 0x55, "00 06 04 26", "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"),
    "status of read": (1, 0x55, "00 A6 00 00 00", "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"),
    "status of write": (1, 0x55, "00", "FF FF FD 00 01 04 00 55 00 A1 0C"),
}

identities = st.integers(0, 252)
contents = st.lists(st.sampled_from([b"\xff", b"\xff\xff\xfd", b"\xfd", b"\x00", b"\x01", b"\x80"]), max_size=60).map(
    b"".join
)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_manuals_examples_are_written_and_read_byte_for_byte(name):
    identity, instruction, parameters, wire = EXAMPLES[name]
    packet = Packet(identity, instruction, bytes.fromhex(parameters))
    assert packet.encode() == bytes.fromhex(wire)
    assert decode(bytes.fromhex(wire)) == packet


@given(st.binary(max_size=200))
def test_the_checksum_is_that_of_the_sdk(data):
    assert compute_crc16(data) == dynamixel_sdk.Protocol2PacketHandler().updateCRC(0, data, len(data))


@given(contents | st.binary(max_size=200))
def test_stuffed_content_holds_no_header_and_comes_back(content):
    stuffed = stuff(content)
    assert b"\xff\xff\xfd\x00" not in stuffed
    assert unstuff(stuffed) == content


@given(identities, st.sampled_from(list(Instruction)), contents, st.binary(max_size=8))
def test_a_packet_is_found_in_whatever_surrounds_it(identity, instruction, parameters, noise):
    packet = Packet(identity, instruction, parameters)
    noise = noise.replace(b"\xff", b"")
    found = Protocol2Reader().feed(noise + packet.encode() + noise + packet.encode())
    assert found == [packet, packet]


@given(identities, contents, st.data())
def test_a_packet_may_come_in_pieces(identity, parameters, data):
    whole = Packet(identity, Instruction.WRITE, parameters).encode()
    cut = data.draw(st.integers(0, len(whole)))
    reader = Protocol2Reader()
    assert reader.feed(whole[:cut]) + reader.feed(whole[cut:]) == [Packet(identity, Instruction.WRITE, parameters)]
    assert not reader.waiting


@given(identities, st.binary(min_size=1, max_size=40), st.data())
def test_a_flipped_bit_is_noticed(identity, parameters, data):
    whole = bytearray(Packet(identity, Instruction.WRITE, parameters).encode())
    place = data.draw(st.integers(7, len(whole) - 1))
    whole[place] ^= 1 << data.draw(st.integers(0, 7))
    assert not any(packet.is_valid for packet in Protocol2Reader().feed(bytes(whole)))


class Line:
    """What the SDK takes for a port: it hears what was prepared."""

    def __init__(self, content: bytes):
        self.content, self.is_using = content, False

    def readPort(self, length: int) -> bytes:  # noqa: N802
        head, self.content = self.content[:length], self.content[length:]
        return head

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return not self.content


@given(identities, st.integers(0, 255), st.binary(max_size=60))
def test_the_sdk_understands_our_answers(identity, error, data):
    found, result = dynamixel_sdk.Protocol2PacketHandler().rxPacket(Line(encode_status(identity, error, data)), False)
    assert result == dynamixel_sdk.COMM_SUCCESS
    assert found[4] == identity
    assert found[8] == error
    assert bytes(found[9 : 9 + len(data)]) == data


def ask(chain: ServoChain, identity: int, instruction: int, parameters: str = "") -> list[bytes]:
    replies = chain.respond(Packet(identity, instruction, bytes.fromhex(parameters)))
    return [reply.content for reply in replies]


def answer(chain: ServoChain, identity: int, instruction: int, parameters: str = "") -> tuple[int, bytes]:
    (content,) = ask(chain, identity, instruction, parameters)
    packet = decode(content)
    assert packet.is_valid
    assert packet.id == identity
    return packet.parameters[0], packet.parameters[1:]


@pytest.fixture
def chain() -> ServoChain:
    return ServoChain([VirtualServo(identity) for identity in (1, 2, 3)])


def test_a_ping_tells_model_and_firmware(chain):
    assert answer(chain, 2, 0x01) == (0, (350).to_bytes(2, "little") + b"\x1d")
    assert [decode(content).id for content in ask(chain, 254, 0x01)] == [1, 2, 3]
    assert ask(chain, 9, 0x01) == []


def test_what_is_written_is_read(chain):
    assert answer(chain, 1, 0x03, "1E 00 90 01") == (0, b"")
    assert answer(chain, 1, 0x02, "1E 00 02 00") == (0, b"\x90\x01")


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ("25 00 00 00", 7),  # present position is read-only
        ("1E 00 FF FF", 4),  # a goal beyond 1023
        ("1E 00 FF", 5),  # half a goal
        ("22 00 01", 7),  # an address without a register
        ("60 00 01", 7),  # beyond the table
    ],
)
def test_a_wrong_write_is_refused_and_changes_nothing(chain, parameters, error):
    before = bytes(chain.servos[0].memory)
    assert answer(chain, 1, 0x03, parameters) == (error, b"")
    assert bytes(chain.servos[0].memory) == before


def test_a_goal_beyond_the_angle_limits_is_refused(chain):
    assert answer(chain, 1, 0x03, "08 00 58 02") == (0, b"")  # counterclockwise limit 600
    assert answer(chain, 1, 0x03, "1E 00 59 02") == (6, b"")
    assert answer(chain, 1, 0x03, "1E 00 58 02") == (0, b"")


def test_what_outlives_the_power_is_locked_while_the_torque_is_on(chain):
    assert answer(chain, 1, 0x03, "18 00 01") == (0, b"")
    assert answer(chain, 1, 0x03, "05 00 00") == (7, b"")
    assert answer(chain, 1, 0x03, "18 00 00") == (0, b"")
    assert answer(chain, 1, 0x03, "05 00 00") == (0, b"")


def test_a_registered_write_waits_for_its_action(chain):
    assert answer(chain, 1, 0x04, "1E 00 90 01") == (0, b"")
    assert chain.servos[0].get("goal_position") == 512
    assert chain.servos[0].get("registered") == 1
    assert answer(chain, 1, 0x05) == (0, b"")
    assert chain.servos[0].get("goal_position") == 400
    assert answer(chain, 1, 0x05) == (1, b"")


def test_a_reboot_keeps_what_outlives_the_power_and_clears_errors(chain):
    servo = chain.servos[0]
    answer(chain, 1, 0x03, "05 00 07")
    answer(chain, 1, 0x03, "1E 00 90 01")
    servo.fail(1)
    assert servo.get("torque_limit") == 0
    assert answer(chain, 1, 0x02, "32 00 01 00") == (0x80, b"\x01")
    answer(chain, 1, 0x08)
    assert servo.get("return_delay") == 7
    assert servo.get("goal_position") == 512
    assert servo.get("torque_limit") == 1023
    assert answer(chain, 1, 0x02, "32 00 01 00") == (0, b"\x00")


@pytest.mark.parametrize(("what", "identity"), [("FF", 1), ("01", 3), ("02", 3)])
def test_a_factory_reset_forgets_what_it_is_told_to(chain, what, identity):
    answer(chain, 3, 0x03, "05 00 07")
    assert ask(chain, 3, 0x06, what)
    assert chain.servos[2].get("id") == identity
    assert chain.servos[2].get("return_delay") == 250


def test_a_factory_reset_is_refused_while_the_torque_is_on_or_without_a_choice(chain):
    assert answer(chain, 1, 0x06, "03") == (4, b"")
    answer(chain, 1, 0x03, "18 00 01")
    assert answer(chain, 1, 0x06, "FF") == (7, b"")


def test_sync_and_bulk_reach_each_servo(chain):
    assert ask(chain, 254, 0x83, "1E 00 02 00 01 10 00 03 20 00") == []
    goals = [decode(content).parameters[1] for content in ask(chain, 254, 0x82, "1E 00 02 00 03 01")]
    assert goals == [0x20, 0x10]
    assert ask(chain, 254, 0x93, "01 1E 00 02 00 30 00 02 19 00 01 00 05") == []
    found = [decode(content).parameters for content in ask(chain, 254, 0x92, "01 1E 00 02 00 02 19 00 01 00")]
    assert found == [b"\x00\x30\x00", b"\x00\x05"]


def test_after_a_missing_servo_a_sync_read_falls_silent(chain):
    assert [decode(content).id for content in ask(chain, 254, 0x82, "1E 00 02 00 01 07 03")] == [1]


@pytest.mark.parametrize(("level", "answers"), [(0, (True, False, False)), (1, (True, True, False)), (2, (True,) * 3)])
def test_the_status_level_says_what_is_answered(chain, level, answers):
    chain.servos[0].put("status_level", level)
    asked = [(0x01, ""), (0x02, "1E 00 02 00"), (0x03, "1E 00 90 01")]
    assert tuple(bool(ask(chain, 1, *question)) for question in asked) == answers
    assert chain.servos[0].get("goal_position") == 400


def test_a_damaged_or_unknown_instruction_is_answered_with_its_error(chain):
    (damaged,) = chain.respond(Packet(1, Instruction.PING, is_valid=False))
    assert decode(damaged.content).parameters == b"\x03"
    assert answer(chain, 1, 0x77) == (2, b"")


def test_bytes_take_their_time_on_the_wire(chain):
    replies = chain.respond(Packet(254, Instruction.SYNC_READ, bytes([37, 0, 6, 0, 1, 2, 3])))
    ends = [when for when, _ in transmit(replies, 1_000_000)]
    each = 500e-6 + 17 * 10e-6  # the factory's return delay, then eleven bytes and six of data
    assert ends == pytest.approx([each, 2 * each, 3 * each])


def test_two_servos_of_one_identity_disturb_each_other(chain):
    chain.servos[1].put("id", 1)
    chain.servos[1].put("present_position", 700)
    replies = chain.respond(Packet(1, Instruction.READ, bytes([37, 0, 2, 0])))
    ((_, heard),) = transmit(replies, 1_000_000)
    assert heard == collide(replies[0].content, replies[1].content)
    assert not any(packet.is_valid for packet in Protocol2Reader().feed(heard))
    chain.servos[1].put("return_delay", 0)
    replies = chain.respond(Packet(1, Instruction.READ, bytes([37, 0, 2, 0])))
    assert [
        packet.is_valid for _, heard in transmit(replies, 1_000_000) for packet in Protocol2Reader().feed(heard)
    ] == [True] * 2
