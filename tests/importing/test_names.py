"""Joint names of a log: once or in every row, as text or as bytes; and files of MATLAB and of plain tensors."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from support.import_samples import JOINTS, columns_of, map_text, motion, write_log, write_map

from nas_data.dataset.dataset import Dataset
from nas_data.errors import LogError, MapError
from nas_data.importing.map_file import load_map
from nas_data.recorders.logs import import_logs

NAMED = {
    "same": lambda row: (0, 1),
    "swapped": lambda row: (1, 0),
    "changes": lambda row: (0, 1) if row < 50 else (1, 0),
}


def plain_map(suffix: str, extra: str = "") -> str:
    text = map_text(suffix, extra, velocity='"derive"')
    return text.replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"\n', "")


def imported(folder: Path, log: Path, text: str) -> Dataset:
    return import_logs([log], load_map(write_map(folder, text))).dataset


def ordered(order) -> dict[str, np.ndarray]:
    """A log whose vectors are in another order in some rows, with the names beside them."""
    recording = motion()
    rows = [list(order(row)) for row in range(120)]
    take = np.array(rows)
    each = np.arange(120)[:, None]
    return {
        "t": recording.time,
        "q": recording.position[each, take],
        "goal": recording.command[each, take],
        "names": np.array(JOINTS)[take],
    }


@pytest.mark.parametrize("suffix", [".json", ".parquet", ".npz"])
@pytest.mark.parametrize("order", NAMED)
def test_names_in_every_row_put_the_joints_in_order(tmp_path, order, suffix):
    columns = ordered(NAMED[order])
    top = 'joint_names = "names"\n' + ('entries = "rows"' if suffix == ".json" else "")
    text = plain_map(suffix).replace('entries = "rows"', "").replace("robot =", f"{top}\nrobot =", 1)
    log = write_log(tmp_path / f"log{suffix}", columns)
    dataset = imported(tmp_path, log, text)
    np.testing.assert_allclose(dataset.states[:, :2], motion().position[:-1], atol=1e-6)
    np.testing.assert_allclose(dataset.commands, motion().command[:-1], atol=1e-6)


def test_a_row_that_lacks_a_joint_is_named_in_a_short_sentence(tmp_path):
    columns = ordered(NAMED["same"])
    columns["names"][70, 1] = "knee"
    text = plain_map(".npz").replace("robot =", 'joint_names = "names"\nrobot =', 1)
    with pytest.raises(
        LogError, match=r"row 70 \(counted from 0\) lacks the joint 'elbow'; it has shoulder, knee"
    ) as raised:
        imported(tmp_path, write_log(tmp_path / "log.npz", columns), text)
    assert len(str(raised.value)) < 300


@pytest.mark.parametrize("kind", ["S", "U"])
def test_names_may_be_bytes(tmp_path, kind):
    columns = {**columns_of(motion()), "names": np.array(JOINTS).astype(kind)}
    text = plain_map(".npz").replace("robot =", 'joint_names = "names"\nrobot =', 1)
    assert imported(tmp_path, write_log(tmp_path / "log.npz", columns), text).n_frames == 119
    wrong = {**columns, "names": columns["names"][::-1]}
    with pytest.raises(MapError, match="has the joints elbow, shoulder, but the map shoulder, elbow"):
        imported(tmp_path, write_log(tmp_path / "log.npz", wrong), text)


@pytest.mark.parametrize("each_row", [False, True])
def test_names_of_the_log_are_found_in_its_column_of_names(tmp_path, each_row):
    """Vectors hold the elbow first, and the log calls the joints e and s."""
    columns = {key: values[:, ::-1] if values.ndim == 2 else values for key, values in columns_of(motion()).items()}
    columns["names"] = np.array([["e", "s"]] * 120) if each_row else np.array(["e", "s"])
    log = write_log(tmp_path / "log.npz", columns)
    unnamed = plain_map(".npz").replace('column = "q"', 'column = "q"\nnames = ["s", "e"]')
    with pytest.raises(
        MapError, match=r"no names of components, but the map gives names = \[s, e\]; .*joint_names = …"
    ):
        imported(tmp_path, log, unnamed)
    dataset = imported(tmp_path, log, unnamed.replace("robot =", 'joint_names = "names"\nrobot =', 1))
    np.testing.assert_allclose(dataset.states[:, :2], motion().position[:-1], atol=1e-6)
    np.testing.assert_allclose(dataset.commands, motion().command[:-1], atol=1e-6)


def test_a_file_of_matlab_is_read(tmp_path):
    from scipy.io import savemat

    columns = columns_of(motion())
    savemat(tmp_path / "log.mat", {"log": {**columns, "t": columns["t"][None]}, "mass": 1.5})
    text = plain_map(".mat", 'constants = ["mass"]').replace('column = "', 'column = "log.')
    text = text.replace('constants = ["mass"]', "").replace("robot =", 'constants = ["mass"]\nrobot =', 1)
    result = import_logs([tmp_path / "log.mat"], load_map(write_map(tmp_path, text)))
    np.testing.assert_allclose(result.dataset.states[:, :2], motion().position[:-1], atol=1e-6)
    assert result.provenance.target["episodes"][0]["constants"] == {"mass": 1.5}


def test_an_empty_text_in_a_file_of_matlab_is_no_obstacle(tmp_path):
    from scipy.io import savemat

    notes = np.empty(2, object)
    notes[:] = ["", "slow"]
    savemat(tmp_path / "log.mat", {**columns_of(motion()), "notes": notes})
    assert imported(tmp_path, tmp_path / "log.mat", plain_map(".mat")).n_frames == 119


def test_plain_tensors_are_read_and_nothing_is_run(tmp_path):
    import torch

    columns = {key: torch.from_numpy(values) for key, values in columns_of(motion()).items()}
    torch.save(columns, tmp_path / "log.pt")
    dataset = imported(tmp_path, tmp_path / "log.pt", plain_map(".pt"))
    np.testing.assert_allclose(dataset.states[:, :2], motion().position[:-1], atol=1e-6)

    class Evil:
        def __reduce__(self):
            return Path.touch, (tmp_path / "ran",)

    torch.save({**columns, "evil": Evil()}, tmp_path / "evil.pt")
    (tmp_path / "pickled.pt").write_bytes(pickle.dumps(Evil()))
    torch.save([1.0], tmp_path / "list.pt")
    for name in ("evil", "pickled", "list"):
        with pytest.raises(LogError, match=r"save plain tensors: torch.save"):
            imported(tmp_path, tmp_path / f"{name}.pt", plain_map(".pt"))
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["broken", "seven"])
def test_a_damaged_file_of_matlab_is_refused_with_the_remedy(tmp_path, name):
    content = b"MATLAB 7.3 MAT-file" + b" " * 105 + b"\x00\x02IM" if name == "seven" else b"nothing of the kind " * 20
    (tmp_path / "log.mat").write_bytes(content + b"\0" * 512)
    with pytest.raises(LogError, match=r"log.mat .*-v7"):
        imported(tmp_path, tmp_path / "log.mat", plain_map(".mat"))


def test_a_file_of_matlab_7_3_is_read_once_it_is_saved_as_the_refusal_says(tmp_path):
    """SciPy's compressed files are what MATLAB writes with '-v7'."""
    from scipy.io import savemat

    path = tmp_path / "log.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file" + b" " * 105 + b"\x00\x02IM" + b"\0" * 512)
    with pytest.raises(LogError, match=r"of MATLAB's format 7\.3; load it there, and save it with save\(…, '-v7'\)"):
        imported(tmp_path, path, plain_map(".mat"))
    savemat(path, columns_of(motion()), do_compression=True)
    dataset = imported(tmp_path, path, plain_map(".mat"))
    np.testing.assert_allclose(dataset.states[:, :2], motion().position[:-1], atol=1e-6)


def test_a_wrong_unit_word_is_answered_with_all_that_are_known(tmp_path):
    text = map_text(command='column = "goal"\nunit = "furlong"')
    with pytest.raises(MapError, match=r"'unit' is 'furlong'; choose one of: rad, deg, .*N·m.*A"):
        load_map(write_map(tmp_path, text))
    amperes = map_text(command='column = "goal"\nunit = "A"')
    with pytest.raises(MapError, match="'scale' is missing"):
        load_map(write_map(tmp_path, amperes))
    mapping = load_map(write_map(tmp_path, map_text(command='column = "goal"\nunit = "A"\nscale = 0.5')))
    assert mapping.command.conversion.kinds == ("effort", "effort")
    assert mapping.command.conversion.gain == (0.5, 0.5)
