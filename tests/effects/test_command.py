"""`nas effects` says of the catalogue what the effects' files declare."""

import pytest
from support.command_samples import done, nas

from nas_data import registry
from nas_data.effects.base import find_effect, make_effect

NAMES = registry.list_names("effects")


def test_the_catalogue_has_a_line_for_each_effect_with_its_parameters():
    lines = done("effects").out.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == list(NAMES)
    for line, name in zip(lines, NAMES, strict=False):
        kind = find_effect(name)
        assert all(parameter.name in line and parameter.unit in line for parameter in kind.parameters)
        assert ("joint" in line.split()) == kind.per_joint


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_is_told_in_full(name):
    kind = find_effect(name)
    text = done("effects", name).out
    for told in (kind.equation, kind.signature, kind.source, *kind.confused_with, *(p.name for p in kind.parameters)):
        assert told and told in text
    assert text.startswith(name)


def test_what_machines_are_told_makes_effects():
    told = done("effects", "--json").json["effects"]
    assert [entry["effect"] for entry in told] == list(NAMES)
    for entry in told:
        joint = "m1" if "joint" in entry["places"] else None
        largest = {parameter["name"]: parameter["high"] for parameter in entry["parameters"]}
        assert make_effect(entry["effect"], joint, largest).name() == entry["effect"]
        assert entry["meaning"].endswith(".")
    assert {entry["effect"] for entry in told if not entry["searched"]} == {"object_mass", "object_friction"}


def test_an_unknown_effect_is_answered_with_those_there_are():
    answer = nas("effects", "rust")
    assert answer.code != 0
    assert "rust" in answer.err and "backlash" in answer.err
