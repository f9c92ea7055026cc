"""The moves of the search: none makes a hypothesis worse, and each finds what it is there for."""

from dataclasses import replace

import numpy as np
import pytest
from support.evidence_samples import QUANTUM, measured
from support.search_samples import NOISE, afresh, arm, begun, described, fitted, names

from nas_data import registry
from nas_data.effects.base import parse
from nas_data.errors import UnknownName
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.gap.search.constants import TIE
from nas_data.gap.search.fit import fit
from nas_data.gap.search.hypothesis import Description, Hypothesis, effect_key
from nas_data.gap.search.moves import (
    add,
    drop,
    line_scan,
    optional_parameters,
    replace_by_rival,
    restart,
    share_value,
    shift_delay,
    simplify,
    swap,
)
from nas_data.gap.search.moves.base import find_move
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters, select_free_base
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.search import Search
from nas_data.gap.search.tie_break import break_tie
from nas_data.recorders.recipe import Recipe

FLOOR = np.full(6, QUANTUM / np.sqrt(12))
MOVES = registry.list_names("gap.search.moves")
DEAR = {"add", "swap", "replace_by_rival"}  # which tests of their own show to improve a hypothesis
VISCOUS, DRY = "viscous_friction:joint=j2,coefficient=0.03", "coulomb_friction:joint=j1,torque=0.03"
BAND = "deadband:joint=j1,half_width=0.02"


@pytest.fixture(scope="module")
def rubbing() -> Search:
    """A search for viscous friction in one joint and dry friction in the other."""
    return begun(arm(), VISCOUS, DRY)


@pytest.fixture(
    scope="module", params=["a dead band for dry friction", pytest.param("too much", marks=pytest.mark.slow)]
)
def half_way(request: pytest.FixtureRequest, rubbing: Search) -> tuple[Search, Hypothesis]:
    """A search, and a fitted hypothesis that is not the right one."""
    search = afresh(rubbing)
    effects = {
        "a dead band for dry friction": (BAND, VISCOUS),
        "too much": (VISCOUS, DRY, "joint_offset:joint=j2,offset=0.001"),
    }[request.param]
    return search, fitted(search, *effects)


# Candidates


def test_a_candidate_that_gains_much_is_fitted_further_though_another_is_ahead(rubbing: Search, monkeypatch):
    """The first-order estimate of a limit may be so far from its value that few steps do not reach it."""
    search = afresh(rubbing)
    quick = {VISCOUS: 500.0, BAND: 130.0, DRY: 20.0}  # gain after few steps [nats]
    gained = {parse(text): gain for text, gain in quick.items()}

    def improve(h: Hypothesis, gain: float) -> Hypothesis:
        return replace(h, heldout_misfit=h.heldout_misfit - gain)

    def fit_briefly(description: Description, *_: object, **__: object) -> Hypothesis:
        return improve(replace(search.null, description=description), gained[description.effects[-1]])

    monkeypatch.setattr(search, "fit_description", fit_briefly)
    monkeypatch.setattr(search, "fit_further", lambda h: improve(h, 0.0 if h.effects[-1] == parse(VISCOUS) else 1000.0))
    monkeypatch.setattr(optional_parameters, "apply", lambda search, h: h)
    around = search.nominal.fit
    candidates = [Candidate(effect, search.null.score, around.theta) for effect in gained]
    ranked = add.fit_candidates(search, search.null, around, candidates)
    assert [h.effects[-1] for h in ranked] == [parse(text) for text in (BAND, VISCOUS, DRY)]


# The contract


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow if name in DEAR else ()) for name in MOVES])
def test_a_move_makes_no_hypothesis_worse(name: str, half_way: tuple[Search, Hypothesis]):
    """In the objective in which the search then is; some moves change it."""
    search, h = afresh(half_way[0]), half_way[1]
    moved = find_move(name)(search, h)
    assert moved.fit.objective == search.task.objective
    assert moved.score <= search.rescore(h).score
    assert moved.is_finite
    assert np.all(np.isfinite(moved.fit.theta))
    assert search.null.fit.objective == search.nominal.fit.objective == search.task.objective


@pytest.mark.parametrize("name", [name for name in MOVES if name != "add"])
def test_a_move_leaves_the_model_alone_as_it_is(name: str, rubbing: Search):
    search = afresh(rubbing)
    assert find_move(name)(search, search.null) is search.null


def test_a_move_that_there_is_not_is_refused_with_those_that_there_are():
    with pytest.raises(UnknownName, match="share_value"):
        find_move("shuffle")


# What each is there for


def test_an_effect_of_each_joint_is_added_at_once(rubbing: Search):
    search = afresh(rubbing)
    assert names(add.apply(search, search.null).effects) == names([parse(VISCOUS), parse(DRY)])


def test_what_takes_the_place_of_a_kept_effect_is_added_alone(rubbing: Search):
    """An optional parameter can make another effect needless, so that a candidate has no more effects than before."""
    search = afresh(rubbing)
    kept, best, instead = (
        search.fit_description(described(*effects), {}) for effects in ((BAND,), (BAND, VISCOUS), (DRY,))
    )
    assert best.score < kept.score and instead.score < kept.score
    assert add.add_best(search, kept, [best, instead]) is best


def test_what_does_nothing_is_dropped(rubbing: Search):
    search = afresh(rubbing)
    idle = ("backlash:joint=j1,half_width=0.0005", "joint_offset:joint=j2,offset=0.0001")
    kept = fitted(search, VISCOUS, DRY, *idle, freed=["j1.armature"])
    left = drop.apply(search, kept)
    assert names(left.effects) == names([parse(VISCOUS), parse(DRY)])
    assert not left.description.freed
    assert drop.apply(search, left) is left


def test_what_the_model_has_by_itself_is_dropped():
    """A limit as the model's own, and a gain within the bounds of the model's own gain."""
    limited = arm().replace('kp="0.5"', 'kp="0.5" forcelimited="true" forcerange="-0.2 0.2"')
    search = begun(limited, VISCOUS, factors={"j1.gain": 1.12})
    spare = ("servo_stiffness:joint=j1,factor=1.12", "torque_limit:joint=j1,torque=0.199")
    kept = fitted(search, VISCOUS, *spare)
    assert min(drop.estimate_losses(search, kept)[effect] for effect in kept.effects[1:]) < 10
    assert names(drop.apply(search, kept).effects) == names([parse(VISCOUS)])


def test_a_stand_in_is_swapped_for_what_it_stands_for(rubbing: Search):
    search = afresh(rubbing)
    better = swap.apply(search, fitted(search, BAND, VISCOUS))
    assert names(better.effects) == names([parse(VISCOUS), parse(DRY)])
    assert effect_key(parse(BAND)) in {effect_key(rival) for rival in search.rivals[effect_key(parse(DRY))]}


def test_a_beaten_effect_that_does_better_beside_the_others_comes_back(rubbing: Search):
    search = afresh(rubbing)
    search.rivals[effect_key(parse(BAND))] = [parse(DRY)]
    kept = fitted(search, BAND, VISCOUS)
    better = replace_by_rival.apply(search, kept)
    assert names(better.effects) == names([parse(VISCOUS), parse(DRY)])
    assert replace_by_rival.list_rivals(search, better.effects[-1], ())[0].name() == "deadband"
    assert replace_by_rival.apply(search, better) is better


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "hidden"),
    [("torque_limit:joint=m2,torque=0.15", "load_friction"), ("load_friction:joint=m2,ratio=0.3", "torque_limit")],
)
def test_what_a_hook_expresses_and_what_a_file_does_meet_where_they_are_confused(wrong: str, hidden: str):
    """Neither was a rival of the other when the wrong one was added."""
    effects = {"load_friction": "load_friction:joint=m2,ratio=0.2", "torque_limit": "torque_limit:joint=m2,torque=0.1"}
    nominal, evidence = measured(effects[hidden])
    task = FitTask(nominal, evidence, FLOOR)
    search = Search.begin(task.select([0, 1]), task.select([2]))
    kept = search.fit_description(described(wrong), {})
    assert kept is not None and not search.rivals
    assert names(replace_by_rival.apply(search, kept).effects) == [(hidden, "m2")]


@pytest.mark.parametrize(
    "hidden",
    [
        "coulomb_friction:joint={},torque=0.02",
        pytest.param("deadband:joint={},half_width=0.02", marks=pytest.mark.slow),
    ],
)
def test_what_all_joints_have_alike_is_found_to_be_one_value(hidden: str):
    alike = [hidden.format(joint) for joint in ("j1", "j2", "j3")]
    search = begun(arm(joints=3), *alike)
    kept = fitted(search, *alike)
    one = share_value.apply(search, kept)
    name = kept.effects[0].name()
    assert one.description.shared == {name}
    assert one.description.price < kept.description.price and one.score < search.rescore(kept).score
    (value,) = {getattr(effect, effect.parameters[0].name) for effect in one.effects}
    assert value == pytest.approx(0.02, rel=0.02)
    assert share_value.apply(search, one) is one, "and stays it"


@pytest.mark.slow
def test_what_joints_have_each_of_their_own_is_shared_by_none():
    own = [f"coulomb_friction:joint=j{n},torque={torque}" for n, torque in ((1, 0.01), (2, 0.02), (3, 0.03))]
    search = begun(arm(joints=3), *own)
    kept = fitted(search, *own)
    assert share_value.apply(search, kept) is kept
    forced = fitted(search, *own, shared=["coulomb_friction"])
    assert share_value.apply(search, forced).description.shared == frozenset()


@pytest.mark.parametrize(("place", "apart"), [("", False), (",x=0.04,z=0.06", True)])
def test_a_payload_off_its_link_gets_a_place(place: str, apart: bool):
    search = begun(arm(), f"payload:mass=0.04{place}")
    (found,) = optional_parameters.apply(search, fitted(search, "payload:mass=0.03")).effects
    assert (set(found.to_json()["parameters"]) == {"mass", "x", "y", "z"}) == apart
    if apart:
        assert (found.x, found.z) == pytest.approx((0.04, 0.06), abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "apart"), [("payload:mass=0.04", False), ("payload:mass=0.04,y=0.04,z=0.06", True)])
def test_the_place_of_a_payload_is_sought_where_the_data_tell_it(hidden: str, apart: bool):
    nominal, evidence = measured(hidden)
    task = FitTask(nominal, evidence, FLOOR)
    search = Search.begin(task.select([0, 1, 2]), task.select([3]))
    plain = fitted(search, "payload:mass=0.03")
    assert set(plain.effects[0].to_json()["parameters"]) == {"mass"}
    (found,) = optional_parameters.apply(search, plain).effects
    assert (set(found.to_json()["parameters"]) == {"mass", "x", "y", "z"}) == apart
    if apart:
        assert (found.y, found.z) == pytest.approx((0.04, 0.06), abs=0.02)


STRIBECK = "stribeck_friction:joint=j1,torque={},kinetic_ratio={},stribeck_velocity={}"


@pytest.mark.parametrize(
    "beside", [(), pytest.param(("coulomb_friction:joint=j1,torque=0.001",), marks=pytest.mark.slow)]
)
def test_friction_that_does_not_fall_with_speed_is_dry_whether_two_names_share_it_or_not(beside: tuple[str, ...]):
    search = begun(arm(), DRY)
    kept = fitted(search, STRIBECK.format(0.03, 0.99, 0.5), *beside)
    (friction,) = simplify.apply(search, kept).effects
    assert friction.name() == "coulomb_friction"
    assert friction.torque == pytest.approx(0.03, rel=0.03)


def test_dry_friction_takes_the_place_of_friction_under_load_that_is_no_better():
    search = begun(arm(), DRY)
    kept = fitted(search, "load_friction:joint=j1,ratio=0.05")
    (friction,) = simplify.apply(search, kept).effects
    assert friction.name() == "coulomb_friction"
    assert friction.torque == pytest.approx(0.03, rel=0.05)


@pytest.mark.slow
def test_friction_that_falls_with_speed_stays_what_it_is():
    hidden = STRIBECK.format(0.05, 0.3, 0.3)
    search = begun(arm(), hidden)
    kept = fitted(search, hidden)
    assert simplify.apply(search, kept) is kept


@pytest.mark.parametrize("stiffness", [3.0, None])
def test_stops_of_play_are_rigid_again_unless_they_yield(stiffness):
    hidden = "backlash:joint=j2,half_width=0.03" + (f",stiffness={stiffness}" if stiffness else "")
    search = begun(arm(), hidden)
    kept = fitted(search, "backlash:joint=j2,half_width=0.025,stiffness=8")
    (play,) = simplify.apply(search, kept).effects
    if stiffness:
        assert play.stiffness == pytest.approx(stiffness, rel=0.1)
    else:
        assert play == parse(f"backlash:joint=j2,half_width={play.half_width}")
        assert play.half_width == pytest.approx(0.03, rel=0.02)
    assert not search.rivals, "rigid play is no other name"


@pytest.mark.slow
def test_what_the_model_bent_to_is_undone_by_beginning_anew(rubbing: Search):
    """Each joint's gain went as far as it may for the dead band; without it, they let go of each other."""
    search = afresh(rubbing)
    kept = fitted(search, VISCOUS, DRY, "backlash:joint=j1,half_width=0.001")
    anew = restart.apply(search, kept)
    assert names(anew.effects) == names([parse(VISCOUS), parse(DRY)])


# Delays, which act in whole physics steps


@pytest.fixture(scope="module")
def stuck() -> tuple[Search, Hypothesis]:
    """A search for a speed limit and a delay of 10 ms, and the fit in which it stays with half the delay."""
    commands = np.random.default_rng(0).uniform(-0.7, 0.7, (2, 4, 1)).repeat(40, axis=1)
    counts = np.ones(commands.shape[:2], bool)
    evidence = EpisodeBatch(
        ("pendulum",), 0.01, np.zeros((2, 1)), commands, np.zeros_like(commands), counts, np.arange(2)
    )
    nominal = Nominal.load("pendulum", evidence)
    limit, delay = parse("speed_limit:joint=pendulum,speed=1.7"), parse("command_delay:delay=0.0045")
    truth = nominal.predict(evidence, [limit, parse("command_delay:delay=0.01")])
    task = FitTask(nominal, replace(evidence, measured=truth.round(4)), np.full(1, NOISE))
    search = Search.begin(task, task)
    found = search.fit_description(described().with_effects([limit, delay]), {}, steps=12, jacobian_refreshes=4)
    assert found is not None
    there = search.relinearise(found)
    assert there.effects[1].delay < 0.007, "slopes lead there, or these tests show nothing"
    return search, there


def test_a_delay_is_shifted_to_the_physics_step_that_no_slope_leads_to(stuck: tuple[Search, Hypothesis]):
    search, there = afresh(stuck[0]), stuck[1]
    free = shift_delay.apply(search, there)
    assert free.effects[1].delay == pytest.approx(0.01, abs=2e-5)
    assert search.floor_ratios(free) < 1 < 10 < search.floor_ratios(there)
    assert not search.task.fine
    assert free.score < search.rescore(there).score
    assert shift_delay.apply(search, free) is free
    assert shift_delay.apply(search, search.null) is search.null


def test_shifts_are_whole_physics_steps_within_the_parameters_bounds():
    pair = (parse(VISCOUS), parse("command_delay:delay=0.0051"))
    delays = [effects[1].delay for effects in shift_delay.generate_shifts(pair, 0.002)]
    assert delays == pytest.approx([0.002, 0.004, 0.008, 0.01, 0.012])
    assert all(effects[0] == pair[0] for effects in shift_delay.generate_shifts(pair, 0.002))
    assert list(shift_delay.generate_shifts(pair[:1], 0.002)) == []


# Play, which makes chaos and dips

WIDE_PLAY = tuple(
    parse(f"backlash:joint={joint},half_width={width}")
    for joint, width in (("pan", 0.07), ("elbow_flex", 0.07), ("wrist_flex", 0.025))
)


def recorded(name: str, steps: int, episodes: int = 6) -> FitTask:
    """Return what an environment's arm does whose play is 0.15 rad wide, its own physics steps known."""
    sizes = {"episodes": episodes, "steps": steps, "holds": (1,)}
    dataset, _ = Recipe(environment=f"nas/{name.capitalize()}-v0", dynamics="backlash", **sizes).record()
    evidence = EpisodeBatch.of(dataset)
    nominal = Nominal.load(name, evidence)
    floor = np.full(len(nominal.joints), 1e-3)
    return FitTask(nominal, evidence.with_objects(dataset, nominal.simulator()), floor, fine=False)


@pytest.mark.slow
def test_a_scan_along_the_parameters_finds_wide_play_that_no_slope_leads_to():
    task = recorded("striker", steps=30)
    parameters = FreeParameters(WIDE_PLAY, select_free_base(task.nominal.base, WIDE_PLAY))

    def widths(theta: np.ndarray) -> list[float]:
        return [effect.half_width for effect in parameters.effects_at(theta)]

    gone_down = fit(task, parameters, parameters.initial_theta())
    assert gone_down is not None and max(widths(gone_down.theta)) < 0.12
    found, reached = line_scan.scan(task, parameters, parameters.initial_theta(), [0, 1, 2])
    assert reached < gone_down.loss
    assert widths(found) == pytest.approx([0.15] * 3, rel=0.02)


@pytest.mark.slow
def test_play_that_seems_to_lie_in_its_middle_is_found_from_half_its_width():
    """A scan that is not close is enough where an arm is not chaotic: slopes lead on from there."""
    task = recorded("pusher", steps=100)
    half = (parse("coulomb_friction:joint=j1,torque=1"), parse("backlash:joint=j1,half_width=0.075"))
    parameters = FreeParameters(half, select_free_base(task.nominal.base, half))
    nearest = fit(task, parameters, parameters.initial_theta())
    assert nearest is not None and nearest.effects[1].half_width < 0.1
    found, _ = line_scan.scan(task, parameters, parameters.initial_theta(), [0, 1], line_scan.SCANS[:1])
    on = fit(task, parameters, found)
    assert on is not None and on.effects[1].half_width == pytest.approx(0.15, rel=0.02)


def test_an_arm_that_play_throws_to_and_fro_is_chaotic_and_a_servoed_one_is_not(rubbing: Search):
    task = recorded("striker", steps=60, episodes=3)
    parameters = FreeParameters(WIDE_PLAY, select_free_base(task.nominal.base, WIDE_PLAY))
    thrown = fit(task, parameters, parameters.initial_theta(), steps=0)
    assert thrown is not None
    assert line_scan.is_chaotic(task, Hypothesis(described().with_effects(WIDE_PLAY), thrown, np.zeros((1, 7)), 0.0))
    assert not line_scan.is_chaotic(rubbing.task, rubbing.null)


def test_an_effect_that_is_replaced_on_all_episodes_stays_a_rival(rubbing: Search):
    search = afresh(rubbing)
    search.rivals[effect_key(parse(BAND))] = [parse(DRY)]
    better = break_tie(search, search.train, fitted(search, BAND, VISCOUS))
    assert names(better.effects) == names([parse(VISCOUS), parse(DRY)])
    assert effect_key(parse(BAND)) in {effect_key(rival) for rival in search.rivals[effect_key(parse(DRY))]}


def test_the_simpler_of_two_effects_is_kept_where_the_data_do_not_decide():
    offset, play, friction = parse("joint_offset:joint=j1,offset=0.05"), parse(BAND), parse(DRY)
    assert replace_by_rival.compute_tie_price(offset, play) == TIE
    assert replace_by_rival.compute_tie_price(play, offset) == -TIE
    assert replace_by_rival.compute_tie_price(offset, friction) == 0
    assert replace_by_rival.compute_tie_price(play, parse("torque_limit:joint=j1,torque=0.1")) == 0
