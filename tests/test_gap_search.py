"""The search's own rules: what is lent, what does not matter yet, when a base strays, the same effect everywhere."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from nas_data.gap.search.detail import detailed
from nas_data.gap.search.hop import hopped, hops
from nas_data.gap.search.prune import absorbed, doubted_again, simplified
from nas_data.gap.search.rivals import confronted, contenders, lead, outdone
from nas_data.gap.search.state import Search
from nas_data.gap.search.steps import stepped
from nas_data.gap.search.sweep import LOOKS, chaotic, concerned, look, swept
from nas_data.gap.search.unknowns import Unknowns, free_base
from test_gap_core import QUANTUM, measured
from test_gap_workflow import ARM, recorded

from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.gap.evidence import Evidence
from nas_data.gap.nominal import Nominal
from nas_data.gap.search import choose as choose_module
from nas_data.gap.search import hop as hop_module
from nas_data.gap.search.choose import begun_anew, choose, looked_along, lost, persisted
from nas_data.gap.search.fit import Task, fit
from nas_data.gap.search.hypothesis import Hypothesis, labels, lent_slopes, place, relieves, strained
from nas_data.recorders.recipe import Recipe

FLOOR = np.full(6, QUANTUM / np.sqrt(12))
FRICTION = "viscous_friction:joint=m2,coefficient=0.02"


def fitted(effects: str, hidden: str = FRICTION, factors: dict[str, float] | None = None):
    """A hypothesis fitted to two episodes of the ErgoJr."""
    nominal, evidence = measured(hidden, factors)
    task = Task(nominal, evidence, FLOOR).select([0, 1])
    chosen = (parse(effects),) if effects else ()
    unknowns = Unknowns(chosen, free_base(nominal.base, chosen))
    found = fit(task, unknowns, unknowns.start(), steps=4)
    assert found is not None
    return task, found


def test_slopes_are_lent_by_what_the_numbers_stand_for():
    _, found = fitted(FRICTION)
    nominal, _ = measured()
    pair = (parse("backlash:joint=m3,half_width=0.02"), *found.effects)
    unknowns = Unknowns(pair, free_base(nominal.base, pair))
    lent = lent_slopes(found, unknowns)
    names = labels(unknowns)
    assert names[0] == ("backlash", "m3", "half_width") and 0 not in lent
    for index, slope in lent.items():
        assert np.array_equal(slope, found.slopes[labels(found.unknowns).index(names[index])])
    assert 1 in lent and 1 not in lent_slopes(found, unknowns, fresh=1)
    assert lent_slopes(None, unknowns) == {}


def test_small_errors_do_not_matter_while_large_ones_are_left():
    nominal, evidence = measured("viscous_friction:joint=m2,coefficient=0.2")
    unknowns = Unknowns((), nominal.base)
    task = Task(nominal, evidence, FLOOR)
    focused = task.focused(unknowns, unknowns.start())
    left = np.sqrt(evidence.mean_squares(nominal.predict(evidence)).mean(0))
    assert np.sqrt(focused.tolerated)[1] == pytest.approx(np.hypot(FLOOR[1], 0.1 * left[1]), rel=0.05)
    assert left[1] > 20 * FLOOR[1], "there is a large error, or this test shows nothing"
    assert np.array_equal(task.tolerated, FLOOR**2)
    assert np.array_equal(focused.select([0]).coarseness, focused.coarseness)


def test_a_base_that_strays_is_seen():
    _, near = fitted("", hidden="", factors={"m2.gain": 1.06})
    _, far = fitted("", hidden="", factors={"m2.gain": 1.24})
    assert strained(Hypothesis(near, np.zeros((1, 6)))) == set()
    assert strained(Hypothesis(far, np.zeros((1, 6)))) == {"m2"}
    assert not relieves(Hypothesis(near, np.zeros((1, 6))), Hypothesis(near, np.zeros((1, 6))))


@pytest.mark.parametrize("fine", [False, True])
def test_the_physics_steps_of_a_recording_are_told_after_both_were_fitted(fine):
    """Base parameters that were fitted to the wrong steps speak for them."""
    nominal, evidence = measured(factors={"m2.gain": 1.05, "m3.damping": 0.95}, timestep=2.5e-4 if fine else None)
    unknowns = Unknowns((), nominal.base)
    wrong = Task(nominal, evidence, FLOOR, fine=not fine).focused(unknowns, unknowns.start())
    found = fit(wrong, unknowns, unknowns.start(), steps=5)
    task, better = stepped(wrong, found)
    assert task.fine == fine
    assert task.timestep == (5e-4 if fine else 2e-3)
    assert stepped(task, better)[0].fine == fine


def test_friction_may_be_less_than_the_models_own_and_hardly_more():
    """More of it has a name."""
    friction = next(base for base in measured()[0].base if base.kind == "frictionloss")
    damping = next(base for base in measured()[0].base if base.kind == "damping")
    assert friction.tolerance(-0.1) == damping.tolerance(-0.1) == damping.tolerance(0.1) > 2 * friction.tolerance(0.1)
    for factor in (0.85, 1.15):
        _, found = fitted("", hidden="", factors={"m2.frictionloss": factor})
        near = found.factors["m2.frictionloss"] == pytest.approx(factor, abs=0.04)
        assert near == (factor < 1)


def test_a_rival_must_be_ahead_by_what_it_has_more_of():
    coulomb, stribeck = (
        parse("coulomb_friction:joint=m2,torque=0.02"),
        parse("stribeck_friction:joint=m2,torque=0.02,kinetic_ratio=0.5,stribeck_velocity=0.3"),
    )
    load, limit = parse("load_friction:joint=m2,ratio=0.2"), parse("torque_limit:joint=m2,torque=0.1")
    assert 0 < lead(stribeck, coulomb) < lead(coulomb, stribeck)
    assert lead(load, limit) == 0 < lead(limit, coulomb) == lead(limit, load)


def test_what_came_second_takes_the_place_of_what_it_beats():
    """Friction was kept where damping is hidden; the search remembers that damping was tried."""
    nominal, evidence = measured("viscous_friction:joint=m2,coefficient=0.05")
    search = Search(Task(nominal, evidence, FLOOR), Task(nominal, evidence, FLOOR))
    friction, damping = parse("coulomb_friction:joint=m2,torque=0.01"), parse(FRICTION)
    search.rivals[place(friction)] = [damping]
    kept = search.fitted((friction,), {})
    better = outdone(search, kept)
    assert [effect.name() for effect in better.effects] == ["viscous_friction"]
    assert better.effects[0].coefficient == pytest.approx(0.05, rel=0.1)
    assert contenders(search, better.effects[0], ())[0].name() == "coulomb_friction"
    assert outdone(search, better) is better


SHARED = (
    parse("stribeck_friction:joint=m2,torque=0.03,kinetic_ratio=0.99,stribeck_velocity=0.5"),
    parse("coulomb_friction:joint=m2,torque=0.001"),
)


@pytest.mark.parametrize("named", [SHARED, SHARED[:1]])
def test_friction_that_does_not_fall_with_speed_is_dry_whether_two_names_share_it_or_not(named):
    nominal, evidence = measured("coulomb_friction:joint=m2,torque=0.03")
    task = Task(nominal, evidence, FLOOR).select([0, 1])
    search = Search(task, task)
    unknowns = Unknowns(named, free_base(nominal.base, named))
    kept = search.judged(fit(task, unknowns, unknowns.start(), steps=0))
    (friction,) = simplified(search, kept).effects
    assert friction.name() == "coulomb_friction"
    assert friction.torque == pytest.approx(0.03, rel=0.03)


def test_friction_that_falls_with_speed_stays_what_it_is():
    hidden = "stribeck_friction:joint=m2,torque=0.05,kinetic_ratio=0.3,stribeck_velocity=0.3"
    nominal, evidence = measured(hidden)
    task = Task(nominal, evidence, FLOOR).select([0, 1])
    search = Search(task, task)
    kept = search.fitted((parse(hidden),), {})
    (dry,) = absorbed(search, kept, kept.effects[0], {"coulomb_friction"})
    assert [effect.name() for effect in dry.effects] == ["coulomb_friction"]
    assert absorbed(search, kept, kept.effects[0], {"load_friction"}) == []  # no special case of it
    assert simplified(search, kept) is kept


@pytest.mark.parametrize(
    ("wrong", "hidden"),
    [("torque_limit:joint=m2,torque=0.15", "load_friction"), ("load_friction:joint=m2,ratio=0.3", "torque_limit")],
)
def test_what_a_hook_expresses_and_what_a_file_does_meet_where_they_are_confused(wrong: str, hidden: str):
    """Neither was a rival of the other when the wrong one was added."""
    effects = {"load_friction": "load_friction:joint=m2,ratio=0.2", "torque_limit": "torque_limit:joint=m2,torque=0.1"}
    nominal, evidence = measured(effects[hidden])
    task = Task(nominal, evidence, FLOOR).select([0, 1])
    search = Search(task, task)
    kept = search.fitted((parse(wrong),), {})
    assert outdone(search, kept) is kept
    confronted(search, kept)
    assert hidden in {rival.name() for rival in contenders(search, kept.effects[0], ())}
    assert [effect.name() for effect in outdone(search, kept).effects] == [hidden]


def test_servos_that_all_lack_the_same_are_named_together(tmp_path: Path):
    """Both gains are a tenth of the model's, as where a model's gain was made up to hold still."""
    arm = tmp_path / "arm.xml"
    arm.write_text(ARM.replace('kp="0.5"', 'kp="5"'))
    target = tmp_path / "target.xml"
    target.write_text(ARM)
    dataset = recorded(target, tmp_path / "data")
    assert main(["gap", str(dataset), "--model", str(arm), "--out", str(tmp_path / "report")]) == 0
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert {(entry["effect"], entry["joint"]) for entry in report["effects"]} == {
        ("servo_stiffness", "shoulder"),
        ("servo_stiffness", "elbow"),
    }
    for entry in report["effects"]:
        assert entry["parameters"]["factor"]["value"] == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(("hidden", "apart"), [("payload:mass=0.04", False), ("payload:mass=0.04,y=0.04,z=0.06", True)])
def test_the_place_of_a_payload_is_sought_where_the_data_tell_it(hidden: str, apart: bool):
    nominal, evidence = measured(hidden)
    task = Task(nominal, evidence, FLOOR)
    search = Search(task.select([0, 1, 2]), task.select([3]))
    plain = search.fitted((parse("payload:mass=0.03"),), {}, renewals=1)
    assert plain is not None
    assert set(plain.effects[0].to_json()["parameters"]) == {"mass"}
    (found,) = detailed(search, plain).effects
    assert (set(found.to_json()["parameters"]) == {"mass", "x", "y", "z"}) == apart
    if apart:
        assert (found.y, found.z) == pytest.approx((0.04, 0.06), abs=0.02)


@pytest.mark.parametrize(
    ("rest", "losses", "expected"),
    [
        ((8.0, 6.0), (0.0, -1000.0, -1040.0), True),
        ((8.0, 6.0), (0.0, -1000.0, -1060.0), False),  # it brings enough
        ((8.0, 1.2), (0.0, -1000.0, -1040.0), False),  # one joint is nearly explained
        ((1.2, 6.0), (0.0, -1000.0, -1040.0), True),  # a joint that stood still says nothing
    ],
)
def test_a_search_that_is_lost_ends(rest, losses, expected):
    null, before, kept = (SimpleNamespace(loss=loss) for loss in losses)
    joints = ("still" if rest[0] < 5 and rest[1] > 5 else "pan", "lift")
    train = SimpleNamespace(nominal=SimpleNamespace(joints=joints))
    search = SimpleNamespace(null=null, train=train, lively={*joints} - {"still"}, ratio=lambda h: np.array(rest))
    assert lost(search, before, kept) == expected


@pytest.mark.parametrize(
    ("rest", "losses", "anew", "looked", "rounds"),
    [
        ([50.0, 1.0], [-200, -400, -410], None, None, 2),  # the second brought little: kept, but nothing dropped after
        ([50.0, 1.0], [-200, -205], None, None, 1),
        ([50.0, 1.0], [-200, -205], -210, None, 1),  # nor does it bring much to begin anew
        ([50.0, 1.0], [-200, -205, -310], -300, None, 2),  # it does, and what it found is fitted on
        ([50.0, 1.0], [-200, -205, -310], -210, -300, 2),  # it does not, but a look along the parameters does
        ([4.0, 1.0], [-200], None, None, 0),  # near enough
    ],
)
def test_a_fit_far_from_what_was_recorded_goes_on_while_that_brings_much(
    monkeypatch, rest, losses, anew, looked, rounds
):
    """Losses begin with that of what is kept; with nothing added it is 0."""
    left = [SimpleNamespace(effects=("play",), loss=loss) for loss in losses]
    other = None if anew is None else SimpleNamespace(effects=("play",), loss=anew)
    along = None if looked is None else SimpleNamespace(effects=("play",), loss=looked)
    following = dict(zip(map(id, left), left[1:], strict=False)) | {id(other): left[-1], id(along): left[-1]}
    said, doubted = [], []
    search = SimpleNamespace(
        train=SimpleNamespace(nominal=SimpleNamespace(joints=("m1", "m2"))),
        lively={"m1", "m2"},
        null=SimpleNamespace(loss=0),
        ratio=lambda h: np.array(rest),
        refined=lambda h: following[id(h)],
        continued=lambda h: h,
        report=lambda word, h: said.append(h),
    )
    monkeypatch.setattr(choose_module, "swept", lambda search, h: h)
    monkeypatch.setattr(choose_module, "needed", lambda search, h: doubted.append(h) or h)
    monkeypatch.setattr(choose_module, "begun_anew", lambda search, h: other)
    monkeypatch.setattr(choose_module, "looked_along", lambda search, h: along if h.loss > -210 else None)
    assert persisted(search, left[0]) is left[rounds]
    assert said == doubted == ([other] if anew == -300 else [along] if looked else left[1:rounds])


@pytest.mark.parametrize(("reached", "taken"), [(-300, True), (-205, False)])
def test_a_look_that_brings_little_leaves_the_search_as_it_was(monkeypatch, reached, taken):
    kept, seen = (SimpleNamespace(effects=("play",), loss=loss) for loss in (-200, reached))
    search = SimpleNamespace(null=SimpleNamespace(loss=0), sub="task", held="held", continued=lambda h: h)

    def refined(h):
        search.sub = search.held = "focused elsewhere"
        return h

    search.refined = refined
    monkeypatch.setattr(choose_module, "swept", lambda search, h, anyway: seen if anyway else h)
    assert looked_along(search, kept) is (seen if taken else None)
    assert (search.sub, search.held) == (("focused elsewhere",) * 2 if taken else ("task", "held"))


def test_what_is_begun_anew_may_lose_one_effect_and_keeps_none_that_is_not_worth_it():
    losses = {("play", "friction", "payload"): -900.0, ("play", "friction"): -899.0, ("friction", "payload"): -500.0}
    asked = []

    def fitted(effects, factors, near=None, steps=6, renewals=0):
        asked.append((effects, factors, near))
        return SimpleNamespace(effects=effects, loss=losses[effects]) if effects in losses else None

    search = SimpleNamespace(fitted=fitted)
    found = begun_anew(search, SimpleNamespace(effects=("play", "friction", "payload")))
    assert found.effects == ("play", "friction")
    assert len(asked) == 4 and all(factors == {} and near is None for _, factors, near in asked)
    assert begun_anew(search, SimpleNamespace(effects=("tilt",))) is None  # it diverges


@pytest.mark.parametrize(
    ("joints", "gone", "spare", "expected"),
    [
        ("abc", 1, {1}, [0, 1]),  # few: all are doubted again
        ("abcdefghi", 2, {2, 5}, [4]),  # many: the other that could be spared
        ("abcdefaac", 7, {7}, [0, 6]),  # and those of its joint
        ("abcdefgh-", 1, {1}, [7]),  # and the whole arm's
        ("abcdefgh-", 8, {8}, list(range(8))),  # which concerns all
    ],
)
def test_many_effects_are_not_all_doubted_again(joints, gone, spare, expected):
    effects = [SimpleNamespace(joint=None if joint == "-" else joint) for joint in joints]
    assert doubted_again(effects, gone, spare) == expected


WIDE_PLAY = tuple(
    parse(f"backlash:joint={joint},half_width={width}")
    for joint, width in (("pan", 0.07), ("elbow_flex", 0.07), ("wrist_flex", 0.025))
)


def striking(steps: int) -> Task:
    """What Striker's arm does whose play is 0.15 rad wide in three joints."""
    recorded, _ = Recipe(
        environment="nas/Striker-v0", dynamics="backlash", episodes=6, steps=steps, holds=(1,)
    ).record()
    evidence = Evidence.of(recorded)
    nominal = Nominal.load("striker", evidence)
    return Task(nominal, evidence.with_objects(recorded, nominal.simulator()), np.full(7, 1e-3), fine=False)


def test_a_look_along_the_parameters_finds_wide_play_that_no_slope_leads_to():
    task = striking(steps=30)
    unknowns = Unknowns(WIDE_PLAY, free_base(task.nominal.base, WIDE_PLAY))

    def widths(numbers: np.ndarray) -> list[float]:
        return [effect.half_width for effect in unknowns.effects_at(numbers)]

    gone_down = fit(task, unknowns, unknowns.start())
    assert gone_down is not None and max(widths(gone_down.numbers)) < 0.12
    found, reached = look(task, unknowns, unknowns.start(), [0, 1, 2])
    assert reached < gone_down.loss
    assert widths(found) == pytest.approx([0.15] * 3, rel=0.02)


def test_play_that_seems_to_lie_in_its_middle_is_found_from_half_its_width():
    """A look that is not close is enough where an arm is not chaotic: slopes lead on from there."""
    recipe = Recipe(environment="nas/Pusher-v0", dynamics="backlash", episodes=6, steps=100, holds=(1,))
    recorded, _ = recipe.record()
    evidence = Evidence.of(recorded)
    nominal = Nominal.load("pusher", evidence)
    task = Task(nominal, evidence.with_objects(recorded, nominal.simulator()), np.full(3, 1e-3), fine=False)
    half = (parse("coulomb_friction:joint=j1,torque=1"), parse("backlash:joint=j1,half_width=0.075"))
    unknowns = Unknowns(half, free_base(nominal.base, half))
    stuck = fit(task, unknowns, unknowns.start())
    assert stuck is not None and stuck.effects[1].half_width < 0.1
    found, _ = look(task, unknowns, unknowns.start(), [0, 1], LOOKS[:1])
    on = fit(task, unknowns, found)
    assert on is not None and on.effects[1].half_width == pytest.approx(0.15, rel=0.02)


def test_an_arm_that_play_throws_to_and_fro_is_chaotic_and_a_servoed_one_is_not():
    task = striking(steps=100)
    unknowns = Unknowns(WIDE_PLAY, free_base(task.nominal.base, WIDE_PLAY))
    assert chaotic(task, SimpleNamespace(fit=SimpleNamespace(unknowns=unknowns, numbers=unknowns.start())))
    servoed, found = fitted("backlash:joint=m2,half_width=0.02", "viscous_friction:joint=m2,coefficient=0.2")
    assert not chaotic(servoed, SimpleNamespace(fit=found))


@pytest.mark.parametrize(("rest", "numbers"), [((4.0, 4.9), []), ((4.0, 6.0), [1, 2]), ((6.0, 4.0), [0, 2])])
def test_parameters_are_looked_along_in_joints_that_are_far_from_explained(rest, numbers):
    texts = ("backlash:joint=m1,half_width=0.02", "backlash:joint=m2,half_width=0.02", "base_tilt:roll=0.02,pitch=0")
    h = SimpleNamespace(fit=SimpleNamespace(unknowns=Unknowns(tuple(map(parse, texts)), ())))
    search = SimpleNamespace(
        train=SimpleNamespace(nominal=SimpleNamespace(joints=("m1", "m2"))),
        lively={"m1", "m2"},
        ratio=lambda h: np.array(rest),
    )
    found = concerned(search, h)
    assert [place for place in found if place < 2] == [place for place in numbers if place < 2]
    assert any(place >= 2 for place in found) == bool(numbers)
    assert found or swept(search, h) is h


@pytest.fixture(scope="module")
def stuck():
    """A search for a speed limit and a delay of 10 ms, and the fit in which it stays with half the delay."""
    commands = np.random.default_rng(0).uniform(-0.7, 0.7, (4, 6, 1)).repeat(50, axis=1)
    driven = np.ones(commands.shape[:2], bool)
    evidence = Evidence(("pendulum",), 0.01, np.zeros((4, 1)), commands, np.zeros_like(commands), driven, np.arange(4))
    nominal = Nominal.load("pendulum", evidence)
    limit, delay = parse("speed_limit:joint=pendulum,speed=1.7"), parse("command_delay:delay=0.0045")
    truth = nominal.predict(evidence, [limit, parse("command_delay:delay=0.01")])
    task = Task(nominal, replace(evidence, measured=truth.round(4)), np.full(1, 1e-4))
    search = Search(task, task)
    there = search.fitted((limit, delay), {}, steps=12, renewals=4)
    assert there.effects[1].delay < 0.007, "slopes lead there, or these tests show nothing"
    return search, there


def test_a_delay_hops_to_the_physics_step_that_no_slope_leads_to(stuck):
    search, there = replace(stuck[0]), stuck[1]
    free = hopped(search, there)
    assert free.effects[1].delay == pytest.approx(0.01, abs=2e-5)
    assert search.ratio(free) < 1 < 10 < search.ratio(there)
    assert not search.sub.fine
    assert hopped(search, free) is free
    assert hopped(search, search.null) is search.null


def test_a_delay_hops_also_from_where_the_last_fit_ends(stuck, monkeypatch):
    search, there = replace(stuck[0]), stuck[1]
    monkeypatch.setattr(choose_module, "is_full", lambda search, kept: True)
    monkeypatch.setattr(choose_module, "persisted", lambda search, kept: there)
    assert choose(search).effects[1].delay == pytest.approx(0.01, abs=2e-5)


def test_a_hop_is_judged_after_a_full_fit(stuck, monkeypatch):
    search, there = replace(stuck[0]), stuck[1]
    short = []

    def short_fits_gain_little(*given, steps, renewals):
        found = fit(*given, steps=steps, renewals=renewals)
        if renewals:
            return found
        short.append(found.misfit)
        return replace(found, misfit=short[0] + 1e-6 * (found.misfit - short[0]))

    monkeypatch.setattr(hop_module, "fit", short_fits_gain_little)
    assert hopped(search, there).effects[1].delay == pytest.approx(0.01, abs=2e-5)
    assert short, "a hop is tried by short fits, or this test shows nothing"


def test_hops_are_whole_physics_steps_within_the_parameters_bounds():
    pair = (parse(FRICTION), parse("command_delay:delay=0.0051"))
    delays = [effects[1].delay for effects in hops(pair, 0.002)]
    assert delays == pytest.approx([0.002, 0.004, 0.008, 0.01, 0.012])
    assert all(effects[0] == pair[0] for effects in hops(pair, 0.002))
    assert list(hops(pair[:1], 0.002)) == []
