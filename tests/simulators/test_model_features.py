"""One arm written in every way there is moves alike, in both engines, or is refused in a sentence."""

import pytest
from support.model_features import PAGE, WAYS, page, played, verdict
from support.simulator_samples import EACH_ENGINE


@pytest.mark.parametrize("engine", EACH_ENGINE)
@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_each_way_of_writing_an_arm_moves_as_commanded_or_is_refused(way, engine):
    told = {True: {"refused"}, False: {"right", "converted", "held"}}
    assert verdict(way, engine) in told[way.group == "untold"]


@pytest.mark.parametrize("way", [way for way in WAYS if way.group == "untold"], ids=lambda way: way.name)
def test_what_cannot_be_told_is_refused_by_the_actuator_and_its_kind(way):
    said = played(way, "mujoco")
    assert isinstance(said, str) and "; " in said and said.endswith(".")
    kind = way.name.split("`")[1] if "`" in way.name else "add one"
    assert kind in said or "integrator" in said


@pytest.mark.bullet
def test_the_page_holds_the_table_that_these_tests_make():
    assert PAGE.read_text(encoding="utf-8") == page(), "run: python tests/support/model_features.py"
