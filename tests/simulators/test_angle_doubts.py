"""A model whose angles may be misread is told of by every command that loads it."""

import json

import pytest

from nas_data.cli import main
from nas_data.robots.base import find_robot

ARM = """<mujoco>{compiler}<worldbody><body><joint name="j" axis="0 1 0" range="{limits}" damping="1"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body></worldbody>
<actuator><position joint="j" kp="5"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("compiler", "limits", "said"),
    [
        (
            "",
            "-1.57 1.57",
            "the range of j, -1.57 to 1.57, is read in degrees, because the file gives no unit: if radians ",
        ),
        ('<compiler autolimits="true"/>', "-3.1 3.1", 'write <compiler angle="radian"/>'),
        (
            '<compiler angle="radian"/>',
            "-90 90",
            'is read in radians: if degrees are meant, write <compiler angle="degree"/>',
        ),
        ("", "-6.28319 6.28319", "is read in degrees, because the file gives no unit"),
        ('<compiler angle="degree"/>', "-1.57 1.57", None),
        ('<compiler angle="radian"/>', "-6.28319 6.28319", None),
        ('<compiler angle="radian"/>', "-1.57 1.57", None),
        ("", "-90 90", None),
    ],
)
def test_a_range_that_no_joint_has_is_doubted_once(tmp_path, capsys, compiler, limits, said):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(compiler=compiler, limits=limits))
    for _ in range(2):
        find_robot(path)
    heard = capsys.readouterr().err
    assert heard.count("nas: warning:") == (said is not None)
    assert (said or "") in heard


@pytest.mark.parametrize("remedy", ["radian", "degree"])
def test_the_remedy_silences_the_doubt(tmp_path, capsys, remedy):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(compiler=f'<compiler angle="{remedy}"/>', limits="-1.57 1.57"))
    find_robot(path)
    assert capsys.readouterr().err == ""


def test_an_included_file_may_state_the_unit(tmp_path, capsys):
    (tmp_path / "unit.xml").write_text('<mujoco><compiler angle="degree"/></mujoco>')
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(compiler='<include file="unit.xml"/>', limits="-1.57 1.57"))
    find_robot(path)
    assert capsys.readouterr().err == ""


def test_a_command_without_a_recording_tells_it_and_json_stays_json(tmp_path, capsys):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(compiler="", limits="-1.57 1.57"))
    options = ["--rate", "50", "--seconds", "1", "--episodes", "1", "--out", str(tmp_path / "d"), "--json"]
    assert main(["record", "sim", "--robot", str(path), *options]) == 0
    heard = capsys.readouterr()
    assert "is read in degrees" in heard.err
    assert json.loads(heard.out)
