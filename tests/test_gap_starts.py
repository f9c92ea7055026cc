"""How episodes began: the hidden states at their first row, told by what followed."""

from dataclasses import replace

import numpy as np
import pytest
from test_gap_core import QUANTUM, commanded

from nas_data.effects.base import Effect, parse
from nas_data.gap.added import usual_hold
from nas_data.gap.evidence import Evidence
from nas_data.gap.nominal import Nominal
from nas_data.gap.search.final import Final
from nas_data.gap.search.fit import Task
from nas_data.simulators.settled import Hold

FLOOR = np.full(6, QUANTUM / np.sqrt(12))


def played(effect: Effect, hold: Hold) -> tuple[Nominal, Evidence]:
    """What the ErgoJr with an effect measures from poses that it held in one way."""
    evidence = commanded(episodes=4)
    poses = np.random.default_rng(1).uniform(-0.5, 0.5, (4, 6))
    evidence = replace(evidence, starts=poses).begun(hold)
    nominal = Nominal.load("ergojr", evidence)
    positions = nominal.predict(evidence, [effect])
    return nominal, replace(evidence, measured=np.round(positions / QUANTUM) * QUANTUM).begun(Hold.WEIGHT)


@pytest.mark.parametrize("hold", list(Hold))
@pytest.mark.parametrize("text", ["backlash:joint=m2,half_width=0.05", "speed_limit:joint=m2,speed=1.0"])
def test_the_start_is_told_by_the_first_second(text: str, hold: Hold):
    effect = parse(text)
    nominal, evidence = played(effect, hold)
    told = Task(nominal, evidence, FLOOR).begun([effect], {})
    assumed = np.sqrt(evidence.mean_squares(nominal.predict(evidence, [effect])))[:, 1] / FLOOR[1]
    rest = np.sqrt(told.evidence.mean_squares(nominal.predict(told.evidence, [effect])))[:, 1] / FLOOR[1]
    assert np.all(rest < 1.5)
    assert hold != Hold.NOTHING or (assumed > 1.5).any(), "the assumption matters, or this test shows nothing"


def test_a_model_without_memory_has_one_start():
    effect = parse("coulomb_friction:joint=m2,torque=0.02")
    nominal, evidence = played(effect, Hold.NOTHING)
    task = Task(nominal, evidence, FLOOR)
    assert not nominal.simulator([effect]).remembers
    assert (task.begun([effect], {}).evidence.holds == Hold.WEIGHT).all()
    positions = [nominal.predict(evidence.begun(hold), [effect]) for hold in Hold]
    assert all(np.array_equal(positions[0], other) for other in positions)


@pytest.mark.parametrize("hold", [Hold.WEIGHT, Hold.NOTHING])
def test_how_all_episodes_began_is_told_by_the_fitted_ones(hold: Hold):
    effect = parse("joint_compliance:joint=m2,stiffness=0.8")
    nominal, evidence = played(effect, hold)
    task = Task(nominal, evidence, FLOOR)
    assert usual_hold(task, Final((effect,), {}, ())) == hold
