"""Causes outside the catalogue: each moves a plant as its formula says; cases and grades of their families."""

from dataclasses import replace

import numpy as np
import pytest
from support.blind_samples import answered, entry_of, report_of, shorten, shortened, steps

from nas_data.benchmarks.blind.arms import GRAVITY, JointDrive, Link, NominalArm, Style, to_mjcf
from nas_data.benchmarks.blind.case import FAMILIES, FELT, Base, Hidden, Identity, Truth
from nas_data.benchmarks.blind.catalogue import INSIDE, OUTSIDE
from nas_data.benchmarks.blind.draw import EffectSampler, draw_case, find_felt_joints
from nas_data.benchmarks.blind.fresh import ModelErrors
from nas_data.benchmarks.blind.grade import grade_names
from nas_data.benchmarks.blind.plants.base import find_plant, make_chain, stack_arms
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.drive import Drive
from nas_data.benchmarks.blind.plants.hiding import BEND_LOSS, ROOT, hide
from nas_data.benchmarks.blind.plants.motion import REFRESH, PlantState
from nas_data.benchmarks.blind.record import CaseFailure, CaseRecord, GradedCase
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.benchmarks.blind.tables import make_tables, print_tables
from nas_data.errors import OptionError

PERIOD, GAIN, LIMIT, MASS, LENGTH = 0.01, 0.4, 0.3, 0.02, 0.1
SERVO = JointDrive(GAIN, 0.0, LIMIT, 0.002, 0.03, 0.0)
STYLE = Style(0.002, "implicitfast", "position", 1.57)
BESIDE = ("outside_one", "outside_two")


def plain_arm(joints: int, servo: JointDrive = SERVO) -> NominalArm:
    """Return a stretched arm along x whose joints all turn about y, without dry friction."""
    geom = f'type="box" size="0.05 0.01 0.01" pos="{LENGTH / 2} 0 0" mass="{MASS}"'
    places = ["0 0 0", *[f"{LENGTH} 0 0"] * (joints - 1)]
    names = tuple(f"j{row + 1}" for row in range(joints))
    links = [Link(place, "0 1 0", geom) for place in places]
    return NominalArm("plain", to_mjcf(names, links, [servo] * joints, STYLE), names)


def truth_of(joints: int, *hidden: Hidden) -> Truth:
    return Truth(Base.nominal(joints), hidden)


def rest(arm: NominalArm, hidden: Hidden, pose: np.ndarray, plant: str = "numpy") -> np.ndarray:
    """Return where an arm comes to rest under a constant command."""
    commands = np.broadcast_to(pose, (1, 200, len(pose)))
    truth = truth_of(len(pose), hidden)
    return find_plant(plant)(arm, [truth], commands, pose[None], PERIOD)[0, 0, -1, : len(pose)]


def weight_torques(arm: NominalArm, pose: np.ndarray) -> np.ndarray:
    """Return the torques [N m] that hold the nominal arm in a pose."""
    body = hide(Constants.of(arm.model()), truth_of(len(pose)))
    return make_chain(stack_arms([body], 1)).dynamics(pose[None], np.zeros((1, len(pose))))[1][0]


def test_a_servo_weakens_as_its_filtered_loss_grows():
    """At rest with a constant error: torque = wanted / (1 + rise (wanted / limit)² (1 − exp(−t / time)))."""
    arm, rise, time, error = plain_arm(1), 4.0, 2.0, 0.5
    body = hide(Constants.of(arm.model()), truth_of(1, Hidden("heat", "j1", {"rise": rise, "time": time})))
    state = PlantState(Drive.of(stack_arms([body], 1)), np.full((1, 400, 1), error), PERIOD, np.zeros((1, 2)))
    fixed, weightless = np.full((1, 1, 1), 1e9), np.zeros((1, 1))
    given = []
    for _ in range(3000):
        before = state.v
        state.advance(fixed, weightless)
        given.append(1e9 * (state.v - before)[0, 0] / REFRESH)
    wanted = GAIN * error
    at = REFRESH * (np.arange(3000) + 0.5)
    warmth = rise * (wanted / LIMIT) ** 2 * (1 - np.exp(-at / time))
    np.testing.assert_allclose(given, wanted / (1 + warmth), rtol=2e-3)
    assert (np.diff(given) < 0).all() and 0 <= state.warmth <= rise


def test_a_servo_that_asks_for_its_limit_gets_no_more_than_a_cold_one():
    drive = Drive.of(stack_arms([hide(Constants.of(plain_arm(2).model()), truth_of(2))], 1))
    drive.heat_rise[:], drive.sag[:] = 5.0, 3.0
    wanted = np.array([[LIMIT, -LIMIT]])
    assert np.allclose(drive.heating(wanted), 5.0)
    assert np.allclose(drive.drop(wanted), 3.0 * LIMIT), "a joint's own torque does not count"


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=pytest.mark.bullet)])
def test_a_coupled_joint_follows_the_one_before_and_pushes_back(plant):
    """At rest, the servo angle is q2 − c q1; the belt returns −c times its torque to the first joint."""
    arm, ratio, pose = plain_arm(2), 0.3, np.array([-0.4, 0.9])
    q = rest(arm, Hidden("coupling", "j2", {"ratio": ratio}), pose, plant)
    second = GAIN * (pose[1] - (q[1] - ratio * q[0]))
    torques = np.array([GAIN * (pose[0] - q[0]) - ratio * second, second])
    np.testing.assert_allclose(torques, weight_torques(arm, q), atol=2e-5)


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=pytest.mark.bullet)])
def test_an_eccentric_gear_leads_and_changes_the_ratio(plant):
    arm, pose = plain_arm(1), np.array([0.7])
    values = {"amplitude": 0.1, "count": 3.0, "phase": 0.4}
    q = rest(arm, Hidden("eccentric_gear", "j1", values), pose, plant)
    turn = 3.0 * q + 0.4
    torque = (1 - 0.1 * 3.0 * np.cos(turn)) * GAIN * (pose - (q - 0.1 * np.sin(turn)))
    np.testing.assert_allclose(torque, weight_torques(arm, q), atol=2e-5)


@pytest.mark.parametrize(
    "hidden",
    [
        Hidden("coupling", "j2", {"ratio": 0.3}),
        Hidden("eccentric_gear", "j2", {"amplitude": 0.1, "count": 3.0, "phase": 0.4}),
    ],
    ids=lambda hidden: hidden.effect,
)
def test_gears_neither_make_nor_take_energy(hidden):
    """Without losses, kinetic energy and that of the servos' springs and of the weight is constant."""
    arm = plain_arm(2, replace(SERVO, damping=0.0, limit=9.0))
    body = hide(Constants.of(arm.model()), truth_of(2, hidden))
    numbers = stack_arms([body], 1)
    chain, drive = make_chain(numbers), Drive.of(numbers)
    state = PlantState(drive, np.full((1, 100, 2), 0.5), PERIOD, np.array([[0.0, -0.6, 0.0, 0.0]]))
    energies = []
    for _ in range(400):
        mass, bias = chain.dynamics(*state.middle())
        state.advance(mass, bias)
        full = chain.dynamics(state.q, state.v)[0][0] + np.diag(drive.armature[0])
        own = drive.gear(state.q, state.v, state.q, state.v)[0]
        heights = [-LENGTH / 2 * np.sin(state.q[0, 0]), 0.0]
        heights[1] = 2 * heights[0] - LENGTH / 2 * np.sin(state.q[0].sum())
        energies.append(
            state.v[0] @ full @ state.v[0] / 2 + GAIN * np.square(0.5 - own).sum() / 2 + GRAVITY * MASS * sum(heights)
        )
    assert np.ptp(energies) < 0.03 * (GAIN * (0.5**2 + 1.1**2) / 2)


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=pytest.mark.bullet)])
def test_the_supply_sags_under_the_torques_of_the_other_joints(plant):
    """At rest: torque = wanted / (1 + resistance · sum of the others' wanted torques)."""
    arm, pose, resistance = plain_arm(3), np.array([0.2, -0.5, 0.3]), 4.0
    q = rest(arm, Hidden("supply_sag", None, {"resistance": resistance}), pose, plant)
    wanted = GAIN * (pose - q)
    others = np.abs(wanted).sum() - np.abs(wanted)
    np.testing.assert_allclose(wanted / (1 + resistance * others), weight_torques(arm, q), atol=2e-5)
    assert (np.abs(wanted) < LIMIT).all() and others.min() * resistance > 0.1


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=pytest.mark.bullet)])
def test_a_bending_link_sags_beyond_the_encoder(plant):
    """In the plane of the joint: stiffness · bend = weight torque of what is beyond, and the servo bears all of it."""
    arm, stiffness, pose = plain_arm(1), 0.1, np.array([0.3])
    heading = find_heading(arm)
    q = float(
        rest(arm, Hidden("bending_link", None, {"link": 0, "stiffness": stiffness, "heading": heading}), pose, plant)[0]
    )
    torque = GRAVITY * MASS * LENGTH / 2
    bend = next_bend(q, stiffness, (1 - ROOT) * torque)
    held = -torque * (ROOT * np.cos(q) + (1 - ROOT) * np.cos(q + bend))  # weight turns a joint about y to +q
    assert GAIN * (pose[0] - q) == pytest.approx(held, abs=2e-5)
    assert bend > 0.05


def next_bend(q: float, stiffness: float, torque: float) -> float:
    """Solve stiffness · bend = torque · cos(q + bend) by iteration."""
    bend = 0.0
    for _ in range(200):
        bend += 0.5 * (torque * np.cos(q + bend) / stiffness - bend)
    return float(bend)


def find_heading(arm: NominalArm) -> float:
    """Return the heading [rad] at which the first link bends about its joint's axis."""
    constants = Constants.of(arm.model())
    headings = np.linspace(0, 2 * np.pi, 721)
    along = []
    for heading in headings.tolist():
        hidden = Hidden("bending_link", None, {"link": 0, "stiffness": 1.0, "heading": heading})
        along.append(hide(constants, truth_of(1, hidden)).axes[1] @ constants.axes[0])
    return float(headings[np.argmax(along)])


def test_a_link_that_hardly_bends_is_rigid():
    arm, (commands, poses) = plain_arm(3), steps(1, 0.4, hold=20)
    truths = [
        truth_of(3),
        *(
            truth_of(3, Hidden("bending_link", None, {"link": 1, "stiffness": size, "heading": 0.3}))
            for size in (2.0, 0.1)
        ),
    ]
    plain, stiff, soft = find_plant("numpy")(arm, truths, commands[..., :3], poses[:, :3], PERIOD)
    errors = [np.abs(one - plain)[..., :3].max() for one in (stiff, soft)]
    assert errors[0] < 0.2 * errors[1] and errors[1] > np.radians(0.2)


def test_a_bending_link_keeps_mass_and_measures_the_driven_joints():
    constants = Constants.of(plain_arm(3).model())
    body = hide(constants, truth_of(3, Hidden("bending_link", None, {"link": 1, "stiffness": 0.5, "heading": 0.1})))
    assert body.driven == (0, 1, 3) and body.masses.sum() == pytest.approx(3 * MASS)
    assert body.gain[2] == 0.5 and body.servo_damping[2] == BEND_LOSS * 0.5
    np.testing.assert_allclose(body.inertias.sum(axis=0), constants.inertias.sum(axis=0))
    assert np.isclose(body.axes[2] @ body.centres[2], 0.0), "it bends across its length"


@pytest.mark.parametrize("family", BESIDE)
@pytest.mark.parametrize("setting", ["xl320", "any", "torque", "far", "poor"])
def test_one_cause_outside_stands_beside_effects_of_the_catalogue(family, setting):
    sort = find_setting(setting)
    for number in range(4):
        identity = Identity(family, "numpy", number, 2, setting=setting)
        hider = EffectSampler(identity, sort, *sort.draw(identity))
        groups: list = []
        for pool in hider.pools:
            groups.append(hider._draw_other([one for group in groups for one in group], pool))
        kinds = [group[0].effect in sort.outside for group in groups]
        assert kinds == [False] * FAMILIES[family].inside + [True]
        assert all(group[0].effect in ({**sort.inside, **sort.outside}) for group in groups)


def test_a_joint_without_one_before_it_is_not_coupled():
    sort = find_setting("torque")
    lone = next(
        identity
        for identity in (Identity("outside", "numpy", number, 5, setting="torque") for number in range(40))
        if len(sort.draw(identity)[0].joints) == 1
    )
    assert "coupling" not in EffectSampler(lone, sort, *sort.draw(lone)).pools[0]
    identity = Identity("outside", "numpy", 0, 0)
    xl320 = find_setting("xl320")
    hider = EffectSampler(identity, xl320, *xl320.draw(identity))
    joints = {hider._draw_other([], ["coupling"])[0].joint for _ in range(60)}
    assert joints == set(hider.arm.joints[1:])


def test_a_setting_without_such_causes_says_so():
    sort = replace(find_setting("xl320"), outside={})
    identity = Identity("outside_one", "numpy", 0, 0)
    with pytest.raises(OptionError, match="family 'outside_one'"):
        EffectSampler(identity, sort, *sort.draw(identity))


def test_a_cause_is_felt_at_its_own_joint_or_wherever_a_cause_of_the_arm_is():
    change, joints = np.array([5.0, 2.0, 9.0]), ("a", "b", "c")
    assert find_felt_joints(change, joints, Hidden("heat", "c", {}), 0) == ("c",)
    assert find_felt_joints(change, joints, Hidden("coupling", "c", {}), 1) == ("c",)
    assert find_felt_joints(change, joints, Hidden("supply_sag", None, {}), 0) == ("a", "c")
    assert FELT == 3.0


@pytest.mark.slow
def test_a_case_with_a_cause_beside_is_the_same_each_time(monkeypatch):
    shorten(monkeypatch)
    identity = {"family": "outside_one", "plant": "numpy", "number": 0, "seed": 1, "setting": "small"}
    case, again = shortened(**identity), draw_case(**identity)
    assert case.answer() == again.answer()
    np.testing.assert_array_equal(case.recorded.readings, again.recorded.readings)
    inside, outside = case.answer().effects
    assert inside.effect in INSIDE and inside.felt_joints is None
    assert outside.effect in OUTSIDE and outside.felt_joints


def hidden_beside(felt: list[str], outside: str = "heat") -> list[dict]:
    return [
        {"effect": "backlash", "joint": "m3", "parameters": {"half_width": 0.02}, "mark": 5.0, "marked_joint": "m3"},
        {"effect": outside, "joint": "m2", "parameters": {}, "mark": 9.0, "marked_joint": "m2", "felt_joints": felt},
    ]


RIGHT = entry_of("backlash", "m3", {"half_width": 0.02}, confidence=0.9)
WRONG = entry_of("torque_limit", "m2", {"torque": 0.1}, confidence=0.4)


def graded(effects: list, complete: dict[str, float | None], felt=("m2",), verdict="partly_explained"):
    report = report_of(effects, verdict, [{"joint": "m2", "ratio_to_noise": 3.0, "goes_with": "position"}])
    report["joints"] = {joint: {"complete": value} for joint, value in complete.items()}
    return grade_names(answered(hidden_beside(list(felt)), family="outside_one", joints=["m2", "m3"]), report)


def test_the_catalogues_effects_are_found_whatever_is_named_beside_them():
    clean = graded([RIGHT], {"m2": 0.3, "m3": 1.0})
    assert clean.found and clean.exact and clean.wrong_confidences == () and not clean.called_complete
    assert clean.verdict_right and clean.unexplained_joint_named
    both = graded([RIGHT, WRONG], {"m2": 0.3})
    assert both.found and not both.exact and not both.confident_wrong
    assert both.extra == (("torque_limit", "m2"),) and both.wrong_confidences == (0.4,)
    assert [row.covered for row in both.parameters] == [True]
    missed = graded([WRONG], {})
    assert not missed.found and not missed.called_complete
    assert not graded([entry_of("backlash", "m2", {"half_width": 0.02})], {}).found, "another joint"


def test_a_joint_that_a_cause_acts_on_must_not_be_called_complete():
    assert graded([RIGHT], {"m2": 0.8}).called_complete
    assert not graded([RIGHT], {"m2": None, "m3": 1.0}).called_complete
    assert graded([RIGHT], {"m2": 0.1, "m3": 0.9}, felt=("m2", "m3")).called_complete
    plain = grade_names(answered(hidden_beside([])[:1]), report_of([RIGHT], "explained"))
    assert plain.called_complete is None


def test_the_table_of_causes_counts_each_and_all():
    answer = answered(hidden_beside(["m2"]))
    grades = [graded([RIGHT], {"m2": 0.3}), graded([RIGHT, WRONG], {"m2": 0.9}), graded([WRONG], {"m2": 0.9})]
    errors = {"floor": 0.001, "after": 0.002, "before": 0.01}
    records = [
        CaseRecord(
            case=f"case {number}", identity=Identity("outside_one", "numpy", number, 0), arm=answer.arm,
            excitation="steps", drawing_seconds=1.0, outcome=GradedCase(one, 1.0, ModelErrors(**errors)),
        )
        for number, one in enumerate(grades)
    ]  # fmt: skip
    tables = make_tables(records)
    total, cause = tables["outside"]
    assert (total["cause"], cause["cause"]) == ("all", "heat")
    assert total["cases"] == 3 and total["found"] == pytest.approx(2 / 3)
    assert total["wrong_names"] == 2 and total["highest"] == 0.4 and total["confident_wrong"] == 0
    assert total["called_complete"] == pytest.approx(2 / 3) and total["names"] == {"torque_limit": 2}
    assert total["covered"] == 1.0
    broken = replace(records[0], outcome=CaseFailure("no idea"))
    total = make_tables([*records, broken])["outside"][0]
    assert total["cases"] == 4 and total["found"] == 0.5, "a failed case finds nothing"
    assert not tables["power"], "beside another cause, a size does not say whether an effect is found"
    assert "torque_limit 2" in print_tables(tables)
