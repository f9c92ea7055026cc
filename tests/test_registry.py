"""The registry: a file that does not define what its folder asks for is answered with what to write."""

import sys
from types import ModuleType

import pytest

from nas_data import registry
from nas_data.effects.base import Effect, find_effect
from nas_data.envs.base import find_task
from nas_data.errors import PluginInvalid
from nas_data.excitations.base import Excitation, find_excitation
from nas_data.robots.base import find_robot

NAME = "odd_one"


@pytest.mark.parametrize(
    ("folder", "find", "content", "said"),
    [
        ("effects", find_effect, {}, r"the effect 'odd_one'; write it as class OddOne\(Effect\)"),
        ("effects", find_effect, {"Effect": Effect, "Odd": type("Odd", (Effect,), {})}, "the effect 'odd_one'"),
        ("excitations", find_excitation, {"Excitation": Excitation}, r"class OddOne\(Excitation\)"),
        ("envs", find_task, {}, "define TASK"),
        ("robots", find_robot, {}, "define ROBOT"),
    ],
)
def test_a_file_without_what_its_folder_asks_for_is_refused(monkeypatch, folder, find, content, said):
    module = ModuleType(f"nas_data.{folder}.{NAME}")
    module.__file__ = f"nas_data/{folder}/{NAME}.py"
    vars(module).update(content)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(registry, "list_names", lambda _: (NAME,))
    with pytest.raises(PluginInvalid, match=rf"{folder}/odd_one\.py does not .*{said}"):
        find(NAME)


@pytest.mark.parametrize("name", ["backlash", "command_delay", "pt1_filter", "x2y"])
def test_the_name_of_a_class_and_of_its_file_determine_each_other(name):
    assert registry.to_snake_case(registry.to_camel_case(name)) == name
