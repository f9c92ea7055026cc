"""Films of an episode: the measured arm and its models in one scene, as pictures, as a film and in Rerun."""

import json
import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.command_samples import SIMULATED, nas
from support.recording_samples import recorded_on, wander
from support.simulator_samples import CONTACTS, PLAY

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.versions import write_version
from nas_data.errors import MissingPackage, OptionError
from nas_data.metrics import Errors
from nas_data.open_loop import roll_out_source
from nas_data.reports.films.film import Film, select_frames
from nas_data.reports.films.motion import follow, shorten_names
from nas_data.reports.films.scene import COLOURS, Scene
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.offscreen import OffscreenRenderer

# two links in a vertical plane, the second turned by a finger that follows it, with a mesh, a floor and a light
ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option integrator="{integrator}"/>
  <asset><mesh name="tip" file="tip.obj"/><material name="red" rgba="1 0 0 1"/></asset>
  <worldbody>
    <light pos="0 0 1"/>
    <geom type="plane" size="1 1 .1" pos="0 0 -.3"/>
    <geom type="box" size=".03 .03 .03"/>
    <body>
      <joint name="a" axis="0 1 0" armature="0.01" damping="{damping}"/>
      <geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.012" material="red"/>
      <body pos="0.15 0 0">
        <joint name="b" axis="0 1 0" armature="0.01" damping="{damping}"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01"/>
        <body pos="0.1 0.02 0">
          <joint name="finger" axis="0 1 0" armature="0.001"/>
          <geom type="mesh" mesh="tip" contype="0" conaffinity="0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="finger" joint2="b" polycoef="0 -1 0 0 0"/></equality>
  <actuator><position joint="a" kp="5"/><position joint="b" kp="5"/></actuator>
</mujoco>
"""
TIP = "v 0 0 0\nv .04 0 0\nv 0 .02 0\nv 0 0 .02\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
SIZE = (240, 320)


@pytest.fixture(scope="module")
def screen():
    """Skip what draws where the machine cannot."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    try:
        OffscreenRenderer(model, mujoco.MjData(model), (16, 16)).close()
    except MissingPackage as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two models of one arm with a mesh, and a recording of the second."""
    folder = tmp_path_factory.mktemp("films")
    (folder / "tip.obj").write_text(TIP)
    for name, damping, integrator in (("stock", 0.1, "Euler"), ("corrected", 1.5, "implicitfast")):
        (folder / f"{name}.xml").write_text(ARM.format(damping=damping, integrator=integrator))
    plant = MujocoSimulator.load(folder / "corrected.xml", 1 / 50, ("a", "b"), threads=1)
    write_version(recorded_on(plant, wander((60, 40), joints=2)), "arm", SIMULATED, folder)
    return folder


@pytest.fixture(scope="module")
def motion(folder):
    dataset = Dataset.load(folder / "arm", (1,))
    return follow(dataset, 1, [str(folder / "stock.xml"), str(folder / "corrected.xml")])


def test_models_move_and_err_as_evaluate_says(motion, folder):
    simulator = MujocoSimulator.load(folder / "stock.xml", 1 / 50, ("a", "b"), threads=1)
    (rolled,) = roll_out_source(motion.dataset, simulator)
    measured, stock, corrected = motion.ghosts
    np.testing.assert_array_equal(stock.states[1:], rolled)
    np.testing.assert_array_equal(measured.states[1:], motion.dataset.next_states)
    expected = Errors.of(("a", "b"), [rolled], [motion.dataset.next_states]).overall
    assert np.sqrt(np.mean(stock.errors[1:, 0] ** 2)) == pytest.approx(expected)
    assert stock.errors[0, 0] == 0
    assert corrected.errors.max() < 0.05 * stock.errors.max()
    assert motion.worst == np.argmax(stock.errors[:, 0])


def test_a_caption_says_how_far_a_slide_is_off_in_millimetres(tmp_path):
    """A hinge and a slide are never averaged; what is said is the error of each kind."""
    for name, stiffness in (("stock", "50"), ("stiff", "200")):
        slide = 'type="slide" axis="1 0 0" armature="0.5"'
        text = ARM.format(damping=0.1, integrator="implicitfast").replace(
            'file="tip.obj"', 'vertex="0 0 0 .04 0 0 0 .02 0 0 0 .02"'
        )
        text = text.replace('name="b" axis="0 1 0" armature="0.01"', f'name="b" {slide}')
        (tmp_path / f"{name}.xml").write_text(text.replace('joint="b" kp="5"', f'joint="b" kp="{stiffness}"'))
    plant = MujocoSimulator.load(tmp_path / "stiff.xml", 1 / 50, ("a", "b"), threads=1)
    write_version(recorded_on(plant, wander((60,), joints=2, size=0.05)), "arm", SIMULATED, tmp_path)
    motion = follow(Dataset.load(tmp_path / "arm"), 0, [str(tmp_path / "stock.xml")])
    angle, length = np.abs(motion.ghosts[1].states[40, :2] - motion.ghosts[0].states[40, :2])
    assert length > 1e-4
    assert motion.ghosts[1].error_text(40, motion.units) == f"{np.degrees(angle):.2f}°, {1e3 * length:.2f} mm off"


def test_each_ghost_stands_where_its_joints_are_and_followers_follow(motion):
    scene = Scene(motion)
    scene.show(17)
    for number, ghost in enumerate(motion.ghosts):
        a, b, finger = (scene.data.joint(f"{number}/{name}").qpos[0] for name in ("a", "b", "finger"))
        np.testing.assert_allclose((a, b), ghost.states[17, :2], atol=1e-12)
        assert finger == pytest.approx(-b)
    assert not scene.model.geom_contype.any() and not scene.model.geom_conaffinity.any()
    assert scene.model.nu == scene.model.neq == 0


def test_a_model_without_shapes_is_drawn_as_rods_from_joint_to_joint(tmp_path):
    bare = re.sub(r"<geom [^>]*/>", "", ARM.replace('<joint name="', '<inertial pos=".05 0 0" mass=".1" '
                  'diaginertia="1e-4 1e-4 1e-4"/><joint name="'))  # fmt: skip
    (tmp_path / "tip.obj").write_text(TIP)
    (tmp_path / "bare.xml").write_text(bare.format(damping=0.1, integrator="Euler"))
    plant = MujocoSimulator.load(tmp_path / "bare.xml", 1 / 50, ("a", "b"), threads=1)
    write_version(recorded_on(plant, wander((60,), joints=2)), "arm", SIMULATED, tmp_path)
    scene = Scene(follow(Dataset.load(tmp_path / "arm"), 0, [str(tmp_path / "bare.xml")]))
    scene.show(0)
    drawn = scene.model.geom_bodyid[scene.shown]
    assert set(scene.owner[drawn]) == {0, 1}
    assert np.isfinite(scene.camera(90.0, -20.0, 1.5).distance)
    longest = scene.model.geom_size[scene.shown, 1].max()
    assert 2 * longest == pytest.approx(0.15), "from joint a to joint b"


def test_a_play_of_the_model_is_drawn_in_the_middle(tmp_path):
    path = tmp_path / "play.xml"
    path.write_text(PLAY)
    plant = MujocoSimulator.load(path, 1 / 50, ("j",), threads=1)
    moved = follow(recorded_on(plant, wander((20,))), 0, [str(path)])
    scene = Scene(moved)
    scene.show(9)
    assert scene.data.joint("0/j").qpos[0] == pytest.approx(moved.ghosts[0].states[9, 0])
    assert scene.data.joint("0/j_play").qpos[0] == 0


def test_objects_go_where_each_ghost_has_them(tmp_path):
    path = tmp_path / "contacts.xml"
    path.write_text(CONTACTS)
    plant = MujocoSimulator.load(path, 1 / 50, ("shoulder", "elbow"), threads=1)
    moved = follow(recorded_on(plant, wander((10,), joints=2)), 0, [str(path)])
    assert Scene(moved).model.nq == 2 * 9


def test_what_does_not_move_is_drawn_once_and_each_arm_in_its_colour(motion):
    scene = Scene(motion)
    owners = scene.owner[scene.model.geom_bodyid]
    assert [int((scene.shown & (owners == number)).sum()) for number in range(3)] == [5, 3, 3]
    for number in (0, 1, 2):
        moving = (owners == number) & (scene.model.geom_bodyid > 0)
        np.testing.assert_allclose(scene.model.geom_rgba[moving, :3], np.tile(COLOURS[number], (3, 1)), atol=1e-6)
        assert (scene.model.geom_rgba[moving, 3] == 1).all() == (number == 0)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (120.0, -15.0), (90.0, -89.0)])
def test_the_camera_sees_every_posture(motion, azimuth, elevation):
    scene, aspect = Scene(motion), 4 / 3
    camera = scene.camera(azimuth, elevation, aspect)
    turn, lift = np.radians([azimuth, elevation])
    forward = np.array([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)])
    right = np.array([np.sin(turn), -np.cos(turn), 0])
    seen = scene.corners() - (camera.lookat - camera.distance * forward)
    slope = np.tan(np.radians(scene.model.vis.global_.fovy / 2)) * (seen @ forward)
    assert (seen @ forward > 0).all()
    beside = np.stack([np.abs(seen @ right) / aspect, np.abs(seen @ np.cross(right, forward))]) / slope
    assert 0.75 < beside.max() < 1


def test_a_picture_shows_every_arm_in_its_colour(screen, motion):
    film = Film(motion, "arm", SIZE, azimuth=90, elevation=0)
    try:
        picture = film.picture(motion.worst).astype(int)
    finally:
        film.close()
    assert picture.shape == (*SIZE, 3)
    scene = picture[film.size[0] // 2 :]
    red, blue = scene[..., 0], scene[..., 2]
    grey = (np.ptp(scene, axis=2) < 25) & (scene.mean(axis=2) < 150)
    assert grey.sum() > 100
    assert ((red - blue) > 60).sum() > 100
    assert ((blue - red) > 30).sum() > 20


def test_a_film_and_its_picture_are_written_by_one_command(screen, folder, here, capfd):
    import av

    models = ["--model", folder / "stock.xml", "--model", folder / "corrected.xml"]
    small = ["--width", 320, "--height", 240, "--rate", 10]
    answer = nas("render", folder / "arm", *models, "--episode", 1, *small, "--out", "film/a.mp4", "--json")
    assert answer.code == 0, answer.err
    assert answer.json["arms"] == ["measured", "stock", "corrected"]
    assert answer.json["frames"] == 9
    assert capfd.readouterr() == ("", ""), "the engine is quiet about options that differ"
    with av.open("film/a.mp4") as film:
        video = film.streams.video[0]
        assert (video.width, video.height, video.average_rate) == (320, 240, 10)
        assert sum(1 for _ in film.decode(video)) == 9
    assert sorted(path.name for path in Path("film").iterdir()) == ["a.mp4", "a.png"]
    again = nas("render", folder / "arm", *models, "--out", "film/a.mp4")
    assert (again.code, again.out) == (2, "")
    assert "film/a.png exists; choose another --out" in again.err


def test_a_picture_that_the_graphics_cannot_draw_is_refused_and_a_smaller_one_drawn(screen, folder, here):
    command = ["render", folder / "arm", "--model", folder / "stock.xml", "--out", "a.png"]
    answer = nas(*command, "--width", 100_000)
    assert (answer.code, answer.out) == (2, "")
    assert "cannot draw an image of 100000 × " in answer.err
    assert "choose a smaller width or height, such as 960 × 720" in answer.err
    assert len(answer.err.splitlines()) == 1
    assert not list(Path().iterdir())
    assert nas(*command, "--width", 960, "--height", 720).code == 0


def test_a_machine_that_cannot_draw_is_told_what_to_install(folder, here, monkeypatch):
    from nas_data.simulators import offscreen

    monkeypatch.setattr(offscreen, "BACKENDS", {sys.platform: ()})
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    answer = nas("render", folder / "arm", "--model", folder / "stock.xml")
    assert answer.code == 2
    assert "apt install libegl1 (or libosmesa6)" in answer.err
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--out film.gif", "must end in .mp4"),
        ("--at 99", "--at 99 is outside episode 0, which lasts 1.2 s"),
        ("--start 99", "--start 99 is outside episode 0, which lasts 1.2 s"),
        ("--speed 0", "--speed 0 must be a number above 0"),
        ("--episode 7", "no episode 7"),
        ("--model nothing.xml", "no model file nothing.xml"),
        ("--width 321", "give even numbers such as"),
        ("--azimuth nan", "--azimuth nan must be a number of degrees"),
        ("--elevation inf", "--elevation inf must be a number of degrees"),
    ],
)
def test_bad_options_are_answered_in_a_sentence(folder, here, words, said):
    model = () if "--model" in words else ("--model", folder / "stock.xml")
    answer = nas("render", folder / "arm", *model, *words.split())
    assert (answer.code, answer.out) == (2, "")
    assert said in answer.err
    assert len(answer.err.splitlines()) == 1
    assert not list(Path().iterdir())


def test_a_dataset_without_a_source_asks_for_a_model(folder, here):
    answer = nas("render", folder / "arm")
    assert answer.code == 2
    assert "give one with --model MODEL.xml" in answer.err


def test_a_film_keeps_the_pace_of_the_episode(motion):
    every_other = select_frames(motion, 0.2, 0.4, rate=25, speed=1)
    assert every_other.tolist() == list(range(10, 31, 2))
    assert select_frames(motion, 0, None, rate=50, speed=0.5).tolist()[:4] == [0, 0, 1, 2]
    with pytest.raises(OptionError, match="--rate 0"):
        select_frames(motion, 0, None, rate=0, speed=1)


def test_models_are_named_by_what_tells_them_apart():
    assert shorten_names(["arm.xml", "runs/b/arm2.xml"]) == ["arm", "arm2"]
    assert shorten_names(["runs/a/model.xml", "runs/b/model.xml"]) == ["a/model", "b/model"]
    assert shorten_names(["runs/gap/model.xml"]) == ["gap/model"]
    assert shorten_names(["model.xml"]) == ["model"]
    assert shorten_names(["arm.xml", "arm.xml"]) == ["arm (1)", "arm (2)"]
    assert shorten_names([]) == ["source"]


def test_rerun_gets_what_lerobots_viewer_logs_and_the_ghosts(folder, here):
    rerun = pytest.importorskip("rerun", reason="Rerun is not installed")
    models = ["--model", folder / "stock.xml", "--model", folder / "corrected.xml"]
    answer = nas("view", folder / "arm", *models, "--episode", 1, "--out", "a.rrd", "--json")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["arms"] == ["measured", "stock", "corrected"]
    recording = rerun.dataframe.load_recording("a.rrd")
    assert recording.application_id() == "arm/episode_1"
    schema = recording.schema()
    assert {"frame_index", "timestamp"} <= {column.name for column in schema.index_columns()}
    entities = {column.entity_path for column in schema.component_columns()}
    signals = {"/action", "/state", "/sim_state/stock", "/sim_state/corrected", "/error/stock", "/error/corrected"}
    assert signals <= entities
    assert any(entity.startswith("/ghosts/corrected/") for entity in entities)
    table = recording.view(index="frame_index", contents="/state").select().read_all().to_pandas()
    dataset = Dataset.load(folder / "arm", (1,))
    logged = np.stack(table[next(name for name in table.columns if name.startswith("/state"))])
    np.testing.assert_allclose(logged[:-1], dataset.states, atol=1e-6)


def test_a_window_of_rerun_needs_a_screen(folder, here, monkeypatch):
    pytest.importorskip("rerun", reason="Rerun is not installed")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    answer = nas("view", folder / "arm", "--model", folder / "stock.xml")
    assert answer.code == 2
    assert "--out FILE.rrd" in answer.err


def test_without_rerun_the_extra_is_named(folder, here, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    answer = nas("view", folder / "arm", "--model", folder / "stock.xml", "--out", "a.rrd")
    assert answer.code == 2
    assert "pip install 'nas_data[viz]'" in answer.err
