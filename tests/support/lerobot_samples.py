"""Datasets as LeRobot's own writer makes them, of a two-joint arm or of an SO-101, in any unit, with cameras."""

import os

os.environ["HF_HUB_OFFLINE"] = "1"  # before anything imports huggingface_hub
os.environ["HF_DATASETS_DISABLE_PROGRESS_BARS"] = "1"

import importlib.util
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

RATE = 50  # [Hz]
ARM = """<mujoco><compiler angle="radian" autolimits="true"/>
<option timestep="0.002" integrator="implicitfast"/><worldbody>
<body pos="0 0 0.5"><joint name="j1" axis="0 1 0" damping="0.05" armature="0.002" range="-2 2"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/>
<body pos="0.15 0 0"><joint name="j2" axis="0 1 0" damping="0.05" armature="0.002" range="-2 2"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.03" contype="0" conaffinity="0"/>
</body></body></worldbody>
<actuator><position joint="j1" kp="2" kv="0.1"/><position joint="j2" kp="2" kv="0.1"/></actuator></mujoco>"""
JOINTS = ("j1", "j2")
DEPTH = {"depth": "video", "near": "image"}  # cameras that measure depth
LASTING = ("subtask", "plan", "memory", "motion", "task_aug")  # LeRobot's styles of what stays true
MESSAGE = ("role", "content", "style", "timestamp", "camera", "tool_calls")
SO101 = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")

RADIANS = """format = "lerobot"
robot = "arm2"
joints = ["j1", "j2"]
alignment = "action_follows_state"
velocity = "derive"
[read.position]
unit = "rad"
[read.command]
unit = "rad"
"""


def enter_with_arm(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder with `arm.xml` and a cache of its own."""
    import datasets.config

    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", folder / "cache")
    monkeypatch.chdir(folder)
    (folder / "arm.xml").write_text(ARM)
    return folder


def motions(episodes: int = 3, rows: int = 60) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions and commands [rad] of the two-joint arm, (rows, 2) each an episode."""
    model, rng, found = mujoco.MjModel.from_xml_string(ARM), np.random.default_rng(0), []
    for _ in range(episodes):
        data, states, commands, command = mujoco.MjData(model), [], [], np.zeros(2)
        for row in range(rows):
            if row % 25 == 5:
                command = rng.uniform(-1, 1, 2)
            states.append(data.qpos.copy())
            commands.append(command.copy())
            data.ctrl[:] = command
            mujoco.mj_step(model, data, 10)
        found.append((np.array(states), np.array(commands)))
    return found


def write_lerobot(
    root: Path,
    episodes: list[tuple[np.ndarray, np.ndarray]],
    joints: tuple[str, ...] = JOINTS,
    robot: str = "arm2",
    camera: bool = False,
    only_video: bool = False,
    killed: bool = False,
    depth: type | None = None,
    task: Callable[[int, int], str] = lambda episode, row: f"pick {episode % 2}",
) -> Path:
    """Write a dataset by LeRobot itself; with a camera it has a video, a picture, and a text and a matrix as well.

    With a type of depth (uint16 for mm, float32 for m) two cameras measure it, one as a video, one as pictures; LeRobot
    knows them from 0.6 on. One that is killed is what lies there before LeRobot ends it.
    """
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    vector = {"dtype": "float32", "shape": (len(joints),), "names": [f"{joint}.pos" for joint in joints]}
    features = {"observation.state": vector, "action": dict(vector)}
    names = ["height", "width", "channels"]
    if camera:
        features["observation.images.front"] = {"dtype": "video", "shape": (64, 96, 3), "names": names}
    if camera and not only_video:
        features |= {
            "observation.images.wrist": {"dtype": "image", "shape": (16, 16, 3), "names": names},
            "language": {"dtype": "string", "shape": (1,), "names": None},
            "grid": {"dtype": "float32", "shape": (2, 2), "names": None},
        }
    for camera_key, kind in DEPTH.items() if depth else ():
        marked = {"dtype": kind, "shape": (32, 48, 1), "names": names, "info": {"is_depth_map": True}}
        features[f"observation.images.{camera_key}"] = marked
    work = root.with_name(f"{root.name}_under_way") if killed else root
    target = LeRobotDataset.create(
        "nas/test",
        fps=RATE,
        features=features,
        root=work,
        robot_type=robot,
        use_videos=camera or depth is not None,
        video_backend="pyav",
    )
    for number, (states, commands) in enumerate(episodes):
        for row, (state, command) in enumerate(zip(states, commands, strict=True)):
            frame = {"observation.state": state.astype(np.float32), "action": command.astype(np.float32)}
            if camera:
                frame |= {key: value for key, value in pictures(row).items() if key in features}
            if depth:
                frame |= {f"observation.images.{camera_key}": distances(number, row, depth) for camera_key in DEPTH}
            target.add_frame({**frame, "task": task(number, row)})
        target.save_episode()
    if killed:
        shutil.copytree(work, root)
    target.finalize()
    return root


def add_vector(
    root: Path, key: str, values: np.ndarray, names: Sequence[str] | None, dtype: str = "float32", unit: str = ""
) -> Path:
    """Add a vector to a dataset of one data file.

    Args:
        root: The dataset.
        key: Key of the feature.
        values: Its values, shape (N, width).
        names: Names of its components; None stores none.
        dtype: Type of its numbers.
        unit: Unit of its components; empty stores none.
    """
    (path,) = (root / "data").glob("*/*.parquet")
    table, width = pq.read_table(path), values.shape[1]
    cells = pa.FixedSizeListArray.from_arrays(pa.array(values.astype(dtype).ravel()), width)
    table = table.append_column(key, cells if width > 1 else pa.array(values.astype(dtype)[:, 0]))
    pq.write_table(table.replace_schema_metadata(None), path)
    info = json.loads((root / "meta/info.json").read_text())
    entry = {"dtype": dtype, "shape": [width], "names": None if names is None else list(names)}
    info["features"][key] = entry | ({"info": {"unit": unit}} if unit else {})
    (root / "meta/info.json").write_text(json.dumps(info))
    return root


def pictures(row: int) -> dict[str, object]:
    """What the cameras see at a row, its text and matrix."""
    front = np.full((64, 96, 3), 4 * (row % 60), np.uint8)
    text, grid = f"row {row}", np.full((2, 2), row, np.float32)
    return {
        "observation.images.front": front,
        "observation.images.wrist": front[:16, :16],
        "language": text,
        "grid": grid,
    }


def distances(episode: int, row: int, depth: type) -> np.ndarray:
    """What depth cameras see at a row of an episode, in mm or, as floats, in m."""
    slope = 400 + 3 * row + 200 * episode + np.arange(48)[None, :] + np.arange(32)[:, None]
    return (slope if depth is np.uint16 else slope / 1000).astype(depth)[:, :, None]


def annotate(root: Path, said: Callable[[int], Sequence[Mapping[str, object]]]) -> Path:
    """Add language columns to a dataset, as `lerobot-annotate` does: by LeRobot's own writer where it has one.

    Args:
        root: The dataset.
        said: Messages of an episode, each with the time of the frame at which it is said or begins.
    """
    if importlib.util.find_spec("lerobot.annotations") is None:
        return _annotate_by_hand(root, said)
    from lerobot.annotations.steerable_pipeline.executor import Executor
    from lerobot.annotations.steerable_pipeline.reader import iter_episodes
    from lerobot.annotations.steerable_pipeline.staging import EpisodeStaging
    from lerobot.annotations.steerable_pipeline.writer import LanguageColumnsWriter

    records, staged = list(iter_episodes(root)), root / ".annotate_staging"
    for record in records:
        rows = [
            {**row, "timestamp": min(record.frame_timestamps, key=lambda t, at=row["timestamp"]: abs(t - at))}
            for row in said(record.episode_index)
        ]
        EpisodeStaging(staged, record.episode_index).write("plan", rows)
    LanguageColumnsWriter().write_all(records, staged, root)
    Executor._ensure_annotation_metadata_in_info(root)
    shutil.rmtree(staged)
    return root


def _annotate_by_hand(root: Path, said: Callable[[int], Sequence[Mapping[str, object]]]) -> Path:
    """Write the columns that LeRobot 0.6 writes."""
    for path in sorted((root / "data").glob("*/*.parquet")):
        table = pq.read_table(path)
        lasting, events = [], []
        for episode, time in zip(*(table[key].to_pylist() for key in ("episode_index", "timestamp")), strict=True):
            messages = [{key: message.get(key) for key in MESSAGE} for message in said(episode)]
            lasting.append([message for message in messages if message["style"] in LASTING])
            now = [one for one in messages if one not in lasting[-1] and abs(one["timestamp"] - time) < 0.5 / RATE]
            events.append([{key: value for key, value in message.items() if key != "timestamp"} for message in now])
        table = table.append_column("language_persistent", pa.array(lasting))
        pq.write_table(table.append_column("language_events", pa.array(events)), path)
    info = json.loads((root / "meta/info.json").read_text())
    entry = {"dtype": "language", "shape": [1], "names": None}
    info["features"] |= {"language_persistent": entry, "language_events": dict(entry)}
    info["tools"] = [{"type": "function", "function": {"name": "say"}}]
    (root / "meta/info.json").write_text(json.dumps(info))
    return root


def speech(time: float, **arguments: object) -> dict[str, object]:
    """A message that speaks, as LeRobot's pipeline makes it."""
    calls = [{"type": "function", "function": {"name": "say", "arguments": arguments}}]
    return {"role": "assistant", "content": None, "style": None, "timestamp": time, "tool_calls": calls}


def stamp(root: Path, times: Callable[[np.ndarray], np.ndarray]) -> Path:
    """Replace the time stamps of a dataset, by a function of the frame's number."""
    for path in sorted((root / "data").glob("*/*.parquet")):
        table = pq.read_table(path)
        stamps = pa.array(times(table["frame_index"].to_numpy()).astype(np.float32))
        pq.write_table(table.set_column(table.schema.get_field_index("timestamp"), "timestamp", stamps), path)
    return root


def write_calibration(path: Path, joints: tuple[str, ...], turned: tuple[str, ...] = ()) -> dict[str, dict[str, int]]:
    """Write LeRobot's calibration file, every motor with a range of its own."""
    content = {
        joint: {
            "id": index + 1,
            "drive_mode": int(joint in turned),
            "homing_offset": 37 * index,
            "range_min": 700 + 13 * index,
            "range_max": 3300 + 29 * index,
        }
        for index, joint in enumerate(joints)
    }
    path.write_text(json.dumps(content))
    return content


def from_ticks(ticks: np.ndarray, motor: dict[str, int], unit: str) -> np.ndarray:
    """LeRobot's own `_normalize` for a Feetech bus."""
    low, high = motor["range_min"], motor["range_max"]
    if unit == "deg":
        return (ticks - (low + high) / 2) * 360 / 4095
    share = (np.clip(ticks, low, high) - low) / (high - low)
    if unit == "range":
        return (200 * share - 100) * (-1 if motor["drive_mode"] else 1)
    return 100 - 100 * share if motor["drive_mode"] else 100 * share
