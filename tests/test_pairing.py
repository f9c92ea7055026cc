"""Pairing adds what the source predicts and nothing else, and what it made says where it comes from."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.recording_samples import GAP, paired_pendulum, pendulum, positions_only, recorded_on, wander, without
from support.simulator_samples import CONTACTS, SO101, hinge, motors, needs_so101, predict_loop

from nas_data.cli import main
from nas_data.dataset.content import hash_content
from nas_data.dataset.features import ACTION, NEXT_STATE, SIM_STATE, STATE, make_state_feature
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.versions import write_version
from nas_data.dataset.write import write
from nas_data.errors import JointMismatch, ModelFileError
from nas_data.gap.write_model import write_effects
from nas_data.pairing import check_fits, check_source, pair, warn_of_ranges
from nas_data.robots.base import find_robot
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.sources import collect_source_files, describe_left_out, find_source, read_kept_files

SIMULATED = Provenance(how="simulated", robot="pendulum")


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def recording():
    return recorded_on(pendulum(*GAP), wander((30, 12, 21)))


def nas(capsys, *arguments) -> dict[str, object]:
    """Run the program, which must succeed, and return its JSON."""
    code = main([*map(str, arguments), "--json"])
    output = capsys.readouterr()
    assert code == 0, output.err
    return json.loads(output.out)


# the numbers


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**31), rate=st.sampled_from([20.0, 49.85, 50.0, 100.0]))
def test_predictions_are_the_plain_loops_rounded_to_float32(seed, rate):
    source = pendulum(rate=rate)
    dataset = recorded_on(pendulum(*GAP, rate=rate), wander((7, 3), seed=seed))
    paired = pair(dataset, source)
    expected = predict_loop(
        find_robot("pendulum").mjcf, 1 / dataset.fps, ("pendulum",), dataset.states, dataset.commands
    )
    assert paired.sim_states.dtype == np.float32
    assert np.array_equal(paired.sim_states, expected.astype(np.float32))


def test_pairing_adds_one_column_and_touches_nothing_else(recording):
    paired = pair(recording, pendulum())
    assert set(paired.features) == {*recording.features, SIM_STATE}
    assert paired.features[SIM_STATE] == make_state_feature(("pendulum",)) == recording.features[NEXT_STATE]
    assert all(paired.columns[key] is recording.columns[key] for key in recording.features)


def test_a_source_without_gap_predicts_what_was_measured():
    paired = pair(recorded_on(pendulum(), wander((60,))), pendulum())
    np.testing.assert_allclose(paired.sim_states, paired.next_states, atol=2e-6)


def test_pairing_again_with_another_source_replaces_the_prediction(recording):
    first = pair(recording, pendulum())
    second = pair(first, pendulum(*GAP))
    assert not np.array_equal(first.sim_states, second.sim_states)
    assert np.array_equal(second.sim_states, pair(recording, pendulum(*GAP)).sim_states)


def test_a_dataset_of_torques_pairs_with_motors(tmp_path):
    path = tmp_path / "motors.xml"
    path.write_text(motors())
    arm = MujocoSimulator.load(path, 0.02, threads=1)
    dataset = recorded_on(arm, wander((20,), size=0.05))
    paired = pair(dataset, arm)
    expected = predict_loop(path, 0.02, ("hinge",), dataset.states, dataset.commands)
    assert np.array_equal(paired.sim_states, expected.astype(np.float32))


# what does not fit


def test_torques_on_position_servos_and_the_reverse_are_refused(tmp_path):
    (tmp_path / "torque.xml").write_text(motors())
    (tmp_path / "servo.xml").write_text(motors().replace("<motor", '<position kp="1"'))
    torque, servo = (MujocoSimulator.load(tmp_path / f"{kind}.xml", 0.02, threads=1) for kind in ("torque", "servo"))
    with pytest.raises(JointMismatch, match=r"commands torques of hinge.*takes positions"):
        pair(recorded_on(torque, wander((5,), size=0.05)), servo)
    with pytest.raises(JointMismatch, match=r"commands positions of hinge.*takes torques"):
        pair(recorded_on(servo, wander((5,))), torque)


def test_another_rate_or_another_order_of_joints_is_refused(tmp_path, recording):
    with pytest.raises(JointMismatch, match=r"100 Hz.*50 Hz"):
        check_fits(recording, pendulum(rate=100.0))
    (tmp_path / "arm.xml").write_text(CONTACTS)
    arm, turned = (
        MujocoSimulator.load(tmp_path / "arm.xml", 0.02, joints, threads=1)
        for joints in (("shoulder", "elbow"), ("elbow", "shoulder"))
    )
    with pytest.raises(JointMismatch, match="elbow, shoulder"):
        pair(recorded_on(arm, wander((5,), joints=2)), turned)


# nas pair


def test_the_command_writes_a_new_version_that_names_its_parent(here, capsys, recording):
    parent = write_version(recording, "swing", SIMULATED)
    before = files(parent)
    told = nas(capsys, "pair", "datasets/swing", "--model", "pendulum")
    folder = Path(told["dataset"])
    assert folder.parent == Path("datasets/swing")
    assert folder.name.startswith("v2-")
    assert files(parent) == before, "a recorded version is never changed"
    assert np.array_equal(read(folder).sim_states, pair(recording, pendulum()).sim_states)
    provenance = read_provenance(folder)
    assert provenance.how == "paired"
    assert [(p.name, p.content_hash) for p in provenance.parents] == [
        (f"swing/{parent.name}", read_provenance(parent).content_hash)
    ]
    assert provenance.content_hash == hash_content(read(folder)) == told["content_hash"]
    assert provenance.source["name"] == "pendulum"
    assert provenance.source["sha256"] == find_robot("pendulum").sha256
    assert provenance.source["engine"] == "mujoco"
    assert provenance.source["effects"] == []
    assert provenance.robot == "pendulum"
    assert told["transitions"] == 63


def test_the_newest_version_is_paired_and_provenance_is_inherited(here, capsys, recording):
    signal = {"excitation": "wander"}
    write_version(recording, "swing", Provenance(how="simulated", robot="pendulum", signal=signal, seeds=(7,)))
    newest = write_version(
        recorded_on(pendulum(*GAP), wander((9,))),
        "swing",
        Provenance(how="simulated", robot="pendulum", signal=signal, seeds=(8,), target={"name": "secret"}),
    )
    folder = Path(nas(capsys, "pair", "datasets/swing", "--model", "pendulum")["dataset"])
    provenance = read_provenance(folder)
    assert read(folder).n_frames == 9
    assert provenance.parents[0].name == f"swing/{newest.name}"
    assert (provenance.signal, provenance.seeds, provenance.target) == (signal, (8,), {"name": "secret"})


def test_pairing_twice_gives_one_version(here, capsys, recording):
    root = write_version(recording, "swing", SIMULATED)
    first = nas(capsys, "pair", root, "--model", "pendulum")["dataset"]
    again = nas(capsys, "pair", root, "--model", "pendulum")["dataset"]
    assert first == again


def test_positions_and_commands_alone_are_completed_and_that_is_recorded(here, capsys, recording):
    bare = positions_only(recording)
    root = write(bare, here / "bare", Provenance(how="imported"))
    (root / "meta/nas.json").unlink()  # LeRobot's own tools write none
    told = nas(capsys, "pair", root, "--model", "pendulum", "--out", "done")
    paired, expected = read(Path("done")), as_transitions(bare)[0]
    assert paired.n_frames == recording.n_frames - recording.n_episodes, "the last frame has no next state"
    assert paired.features[STATE].names == ("pendulum.pos", "pendulum.vel")
    assert np.array_equal(paired.states[:, 0], np.delete(bare.states[:, 0], [29, 41, 62]))
    assert np.array_equal(paired.sim_states, pair(expected, pendulum()).sim_states)
    # a centred estimate of a smooth motion is close to what the simulator knew
    inner = slice(3, 25)
    np.testing.assert_allclose(paired.states[inner, 1], recording.states[inner, 1], atol=0.15)
    derived = read_provenance(Path("done")).derived
    assert {STATE, NEXT_STATE} <= set(derived) <= {STATE, NEXT_STATE, ACTION}
    assert "velocit" in derived[STATE]
    assert told["derived"] == derived
    assert read_provenance(Path("done")).parents[0].content_hash == hash_content(bare)
    assert not (root / "meta/nas.json").exists(), "the parent is untouched"


def test_effects_on_the_command_line_belong_to_the_source(here, capsys, recording):
    root = write_version(recording, "swing", SIMULATED)
    options = [f"{e.name()}:joint=pendulum,{p.name}={getattr(e, p.name)}" for e in GAP for p in e.parameters]
    told = nas(capsys, "pair", root, "--model", "pendulum", *(word for text in options for word in ("--effect", text)))
    folder = Path(told["dataset"])
    paired = read(folder)
    np.testing.assert_allclose(paired.sim_states, paired.next_states, atol=2e-5)
    assert [entry["effect"] for entry in read_provenance(folder).source["effects"]] == [e.name() for e in GAP]
    Path("effects.json").write_text(json.dumps([effect.to_json() for effect in GAP]))
    again = nas(capsys, "pair", root, "--model", "pendulum", "--effects", "effects.json", "--out", "again")
    assert again["content_hash"] == told["content_hash"]


def test_a_gap_report_brings_its_retuned_base_to_the_source_and_to_what_is_kept_of_it(here, capsys, recording):
    root = write_version(recording, "swing", SIMULATED)
    Path("gap").mkdir()
    write_effects(Path("gap"), GAP, {"pendulum.mass": 1.2})
    told = nas(capsys, "pair", root, "--model", "pendulum", "--effects", "gap", "--out", "paired")
    again = nas(capsys, "pair", root, "--model", "pendulum", "--effects", "gap/effects.json", "--out", "again")
    assert again["content_hash"] == told["content_hash"]
    paired = read(Path("paired"))
    assert np.abs(paired.sim_states - paired.next_states).max() > 1e-3, "the target is lighter"
    check_source(paired, find_source(None, (), paired, [Path("paired")]))


# the source is kept


@pytest.mark.parametrize("robot", ["pendulum", "ergojr", "ergojr_penholder"])
@pytest.mark.parametrize("with_effects", [False, True], ids=["plain", "effects"])
def test_the_source_kept_with_a_dataset_predicts_the_same(here, capsys, robot, with_effects):
    joints = find_robot(robot).joints
    arm = MujocoSimulator.load(robot, 0.02, threads=1)
    effect = ("--effect", f"servo_stiffness:joint={joints[0]},factor=0.5") if with_effects else ()
    root = write(recorded_on(arm, wander((15,), len(joints), size=0.6)), here / "raw", Provenance(how="simulated"))
    nas(capsys, "pair", root, "--model", robot, *effect, "--out", "paired")
    assert (here / "paired/meta/source.xml").is_file()
    paired = read(Path("paired"))
    source = find_source(None, (), paired, [Path("paired")])
    np.testing.assert_allclose(pair(paired, source).sim_states, paired.sim_states, rtol=0, atol=1e-6)
    assert (read_provenance(Path("paired")).files or {}).get("meta/source.xml"), "a file like the others: hashed"
    assert main(["verify", "paired"]) == 0


def test_a_kept_file_is_the_file_itself_so_that_its_hash_is_the_sources():
    robot = find_robot("pendulum")
    assert collect_source_files(robot)["source.xml"] == robot.mjcf.read_bytes()


def test_a_source_of_several_files_is_kept_as_one(tmp_path):
    (tmp_path / "part.xml").write_text('<mujoco><option timestep="0.003"/></mujoco>')
    (tmp_path / "arm.xml").write_text(CONTACTS.replace("<worldbody>", '<include file="part.xml"/><worldbody>'))
    kept = collect_source_files(find_robot(tmp_path / "arm.xml"))
    alone = tmp_path / "elsewhere/source.xml"
    alone.parent.mkdir()
    alone.write_bytes(kept["source.xml"])
    one, other = (MujocoSimulator.load(path, 0.02, threads=1) for path in (tmp_path / "arm.xml", alone))
    dataset = recorded_on(one, wander((10,), 2))
    np.testing.assert_allclose(pair(dataset, other).sim_states, pair(dataset, one).sim_states, rtol=0, atol=1e-6)


def tetrahedron(size: float) -> bytes:
    """Return a mesh in a binary STL file."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4") * np.float32(size)
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    body = b"".join(bytes(12) + corners[list(face)].tobytes() + bytes(2) for face in faces)
    return bytes(80) + len(faces).to_bytes(4, "little") + body


def meshed(folder: Path, options: str, size: float = 0.01) -> Path:
    """Write a pendulum whose mass lies in a mesh, with a block beside it to push against."""
    (folder / "m.stl").write_bytes(tetrahedron(size))
    model = hinge(options='kp="1.234567891" kv="0.02"').replace('"hinge"', '"pendulum"')
    shape = f'<geom type="mesh" mesh="m" pos="0.05 0 0" mass="0.0123456789" {options}/>'
    block = '<geom type="box" size="0.02 0.02 0.02" pos="0.08 0 -0.03" contype="2" conaffinity="2"/>'
    model = model.replace("<body>", f"{block}<body>").replace('mass="0.1"/>', f'mass="0.1"/>{shape}')
    model = model.replace("<worldbody>", '<asset><mesh name="m" file="m.stl"/></asset><worldbody>')
    (folder / "meshed.xml").write_text(model)
    return folder / "meshed.xml"


def kept_alone(folder: Path, model: Path) -> Path:
    """Write the kept source into a folder that holds nothing else."""
    folder.mkdir()
    (folder / "source.xml").write_bytes(collect_source_files(find_robot(model))["source.xml"])
    return folder / "source.xml"


def test_a_source_with_meshes_is_kept_without_them_and_moves_the_same(tmp_path):
    model = meshed(tmp_path, 'contype="0" conaffinity="0"')
    alone = kept_alone(tmp_path / "elsewhere", model)
    one, other = (MujocoSimulator.load(path, 0.02, threads=1) for path in (model, alone))
    rng = np.random.default_rng(0)
    states, commands = rng.uniform(-1, 1, (50, 2)), rng.uniform(-1, 1, (50, 1))
    np.testing.assert_allclose(other.predict(states, commands), one.predict(states, commands), rtol=0, atol=1e-9)
    assert describe_left_out(find_robot(model)) is None


@needs_so101
def test_the_kept_copy_of_the_so101_with_meshes_moves_the_same_where_nothing_touches(tmp_path):
    original = SO101.with_name("so101_new_calib_original.xml")
    if not original.is_file():
        pytest.skip("the SO-101 model with meshes is absent")
    (tmp_path / "assets").mkdir()
    for name in re.findall(r'file="([^"]+)"', original.read_text()):
        (tmp_path / "assets" / name).write_bytes(tetrahedron(0.001))
    model = tmp_path / "arm.xml"
    model.write_bytes(original.read_bytes())
    alone = kept_alone(tmp_path / "elsewhere", model)
    one, other = (MujocoSimulator.load(path, 0.02, threads=1) for path in (model, alone))
    rng = np.random.default_rng(0)
    states, commands = rng.uniform(-1, 1, (50, 12)), rng.uniform(-1, 1, (50, 6))
    np.testing.assert_allclose(other.predict(states, commands), one.predict(states, commands), rtol=0, atol=1e-9)


def test_colliding_meshes_are_left_out_and_that_is_said(here, capsys):
    write(recorded_on(pendulum(), wander((20,), size=0.1)), here / "raw", SIMULATED)
    model = meshed(here, 'contype="2" conaffinity="2"')
    told = nas(capsys, "pair", "raw", "--model", model, "--out", "paired")
    assert "1 colliding mesh" in told["warnings"][0]
    assert f"--model {model}" in told["warnings"][0]
    paired = read(Path("paired"))
    model.unlink()
    check_source(paired, find_source(None, (), paired, [Path("paired")]))


def test_warnings_of_a_model_are_not_repeated_of_its_kept_copy(here, capsys):
    write(recorded_on(pendulum(), wander((20,), size=0.1)), here / "raw", SIMULATED)
    model = meshed(here, 'contype="2" conaffinity="2"')
    text = model.read_text().replace("</actuator>", '<adhesion body="suction" ctrlrange="0 1"/></actuator>')
    model.write_text(text.replace("<body>", '<body name="suction">'))
    assert main(["pair", "raw", "--model", "meshed.xml", "--out", "paired"]) == 0
    said = capsys.readouterr().err
    assert said.count("drive no joint directly") == 1 and "of meshed.xml drive" in said


def test_a_source_whose_meshes_matter_is_not_kept_and_that_is_said(here, capsys):
    write(recorded_on(pendulum(), wander((40,), size=1.2)), here / "raw", SIMULATED)
    told = nas(capsys, "pair", "raw", "--model", meshed(here, 'contype="2" conaffinity="2"', 0.1), "--out", "paired")
    assert "--model" in told["warnings"][0]
    assert not Path("paired/meta/source.xml").exists()


def test_another_source_that_predicts_the_same_is_another_version(here, capsys, recording):
    root = write_version(recording, "swing", SIMULATED)
    text = find_robot("pendulum").mjcf.read_text()
    Path("one.xml").write_text(text)
    Path("other.xml").write_text(f"<!-- another -->\n{text}")
    first, second, again = (nas(capsys, "pair", root, "--model", f"{name}.xml") for name in ("one", "other", "one"))
    assert first["content_hash"] == second["content_hash"]
    assert first["dataset"] == again["dataset"]
    assert Path(second["dataset"]).name.startswith("v3-")
    assert Path(second["dataset"], "meta/source.xml").read_bytes() == Path("other.xml").read_bytes()
    assert read_provenance(Path(second["dataset"])).source["name"] == "other"


# warnings


@pytest.mark.parametrize(
    ("compiler", "limits", "said"),
    [
        ("degree", "-1.69 1.69", "outside the model's range -0.0295 to 0.0295 rad; is the model in the unit that its "),
        ("radian", "-1.69 1.69", None),
    ],
)
def test_a_model_in_the_wrong_unit_is_warned_of(here, capsys, compiler, limits, said):
    write(recorded_on(pendulum(), wander((40, 40), size=0.8)), here / "raw", SIMULATED)
    model = hinge().replace('"hinge"', '"pendulum"').replace("axis=", f'range="{limits}" axis=')
    Path("arm.xml").write_text(model.replace("<option", f'<compiler angle="{compiler}"/><option'))
    assert main(["pair", "raw", "--model", "arm.xml", "--out", "paired", "--json"]) == 0
    output = capsys.readouterr()
    warnings = json.loads(output.out)["warnings"]
    assert len(warnings) == (said is not None)
    for warning in warnings:
        assert warning.startswith("measured positions of pendulum reach ")
        assert said in warning
        assert warning in output.err
    for command in (["evaluate", "arm.xml", "raw"], ["gap", "find", "raw", "--model", "arm.xml"]):
        assert main(command) in (0, 2)  # a wrong model may diverge
        assert all(warning in capsys.readouterr().err for warning in warnings)


@pytest.mark.parametrize(
    ("kind", "suffix", "share", "asked"),
    [
        ("revolute", ".xml", 0.02, "is the model in the unit that its compiler's angle= gives?"),
        ("revolute", ".urdf", 0.02, "are its limits in radians, as a URDF has them?"),
        ("prismatic", ".xml", 0.02, "is the model in metres?"),
        ("prismatic", ".urdf", 0.02, "is the model in metres?"),
        ("revolute", ".xml", 0.8, "does the arm move further than its model, or have another zero?"),
        ("revolute", ".urdf", 0.8, "does the arm move further than its model, or have another zero?"),
        ("revolute", ".urdf", 1.0, None),
    ],
)
def test_what_is_asked_of_a_model_whose_range_is_left_depends_on_how_far_and_on_its_format(
    tmp_path, kind, suffix, share, asked
):
    dataset = recorded_on(pendulum(), wander((40, 40), size=0.8))
    limit = share * float(np.abs(dataset.states[:, 0]).max())
    if suffix == ".urdf":
        inertia = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        text = f"""<robot name="r"><link name="base"/><link name="arm"><inertial>{inertia}</inertial></link>
            <joint name="pendulum" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
            <limit lower="{-limit}" upper="{limit}" effort="1" velocity="1"/></joint></robot>"""
    else:
        joint = f'type="{"hinge" if kind == "revolute" else "slide"}" range="{-limit} {limit}" axis='
        text = hinge().replace('"hinge"', '"pendulum"').replace("axis=", joint)
        text = text.replace("<option", '<compiler angle="radian"/><option')
    (tmp_path / f"arm{suffix}").write_text(text)
    found = warn_of_ranges(dataset, find_robot(tmp_path / f"arm{suffix}"))
    assert [sentence.partition("; ")[2] for sentence in found] == ([asked] if asked else [])


OVERLAP = """<mujoco><compiler angle="radian"/><option gravity="0 0 0" integrator="implicitfast"/><worldbody>
<body name="one"><joint name="a" axis="0 1 0" damping="1"/><geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.03"/>
<body name="two" pos="0.2 0 0"><joint name="b" axis="1 0 0" damping="1"/><geom size="0.01"/>
<body name="three"><joint name="c" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.03"/></body></body></body></worldbody>{contact}<actuator>
<position joint="a" kp="20" kv="1"/><position joint="b" kp="20" kv="1"/><position joint="c" kp="20" kv="1"/>
</actuator></mujoco>"""


def test_shapes_that_overlap_in_all_postures_are_warned_of_and_the_remedy_works(here, capsys):
    Path("free.xml").write_text(OVERLAP.format(contact='<contact><exclude body1="one" body2="three"/></contact>'))
    Path("arm.xml").write_text(OVERLAP.format(contact=""))
    assert main(["record", "sim", "--robot", "free.xml", "--episodes", "2", "--seconds", "1", "--out", "raw"]) == 0
    for command in ("pair raw --out paired --model", "evaluate arm.xml raw --model"):
        assert main([*command.split(), "arm.xml"]) == 0
        said = capsys.readouterr().err
        assert "'one' and 'three' of arm.xml overlap in nearly all measured postures, by up to 60 mm" in said
    Path("arm.xml").write_text(OVERLAP.format(contact=re.search("write (<contact>.*</contact>)", said)[1]))
    assert main(["pair", "raw", "--out", "again", "--model", "arm.xml"]) == 0
    assert "overlap" not in capsys.readouterr().err
    assert np.abs(read(here / "again").sim_states - read(here / "again").next_states).max() < 1e-5


def test_without_a_source_the_remedy_is_named(tmp_path):
    dataset = paired_pendulum((5, 5))
    root = write(dataset, tmp_path / "bare", SIMULATED)
    assert read_kept_files(root) == {}
    with pytest.raises(ModelFileError, match=r"bare.*--model"):
        find_source(None, (), dataset, [root])


def test_pairing_needs_no_pairing_column_to_start_from():
    paired = paired_pendulum((5, 8))
    again = pair(without(paired), pendulum())
    assert np.array_equal(again.sim_states, paired.sim_states)
