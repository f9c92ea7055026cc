"""What several files of tests start from."""

from collections.abc import Callable, Iterator
from dataclasses import astuple
from pathlib import Path

import pytest
from hypothesis import settings
from support import forked_programs
from support.command_samples import Place, furnish
from support.recording_samples import paired_pendulum

from nas_data import log
from nas_data.dataset.dataset import Dataset
from nas_data.hardware.virtual_bus import process
from nas_data.recorders import watchdog
from nas_data.runs import code_hash

# The same draws every time, so that a change is judged by itself; --hypothesis-profile=default draws more and new ones.
settings.register_profile("repeatable", derandomize=True, max_examples=30)
settings.load_profile("repeatable")


# files whose fixtures or single tests take longest, from the longest on
LONGEST = ("gap/test_gate.py", "api/test_api.py", "gap/test_learned.py", "gap/test_floor.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files: one that a worker took last would keep the others waiting."""
    order = {Path(__file__).parent / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path, len(order)))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what needs PyBullet where it is not installed: for Python 3.12 it is an extra."""
    if item.get_closest_marker("bullet"):
        pytest.importorskip("pybullet", reason="PyBullet is not installed")


@pytest.fixture(scope="session", autouse=True)
def shown_log() -> None:
    """Show the log on stderr as the program does, also of the functions that tests call."""
    log.show()


@pytest.fixture(scope="session", autouse=True)
def patient_guard() -> Iterator[None]:
    """Let guards of recorders in this process wait: a machine that stalls for a second must not end the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(watchdog, "HANG", 60.0)
        yield


@pytest.fixture(scope="session", autouse=True)
def forked_programs_of_arms() -> Iterator[None]:
    """Fork virtual arms and guards that this process starts; some tests start them as users do."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (process, watchdog):
            patch.setattr(module, "subprocess", forked_programs.INSTEAD)
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of datasets in which a user works."""
    monkeypatch.chdir(tmp_path)
    return Path("datasets")


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """Return a place with a dataset, a model and a checkpoint, which no test changes."""
    return furnish(tmp_path_factory.mktemp("place"))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder to work in."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture(scope="module")
def one_thread() -> Iterator[None]:
    """Let torch use one thread: the same bits on every machine."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def small_ppo(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands that train policies learn from rollouts of 256 frames."""
    from nas_data.policies.policy import Hyperparameters

    small = Hyperparameters(arms=4, rollout=256, minibatches=2, epochs=1)
    monkeypatch.setattr(Hyperparameters.__init__, "__defaults__", astuple(small))


@pytest.fixture(scope="module")
def swings() -> Dataset:
    """Return paired episodes of a pendulum."""
    return paired_pendulum((60,) * 24)


@pytest.fixture
def edited(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str, str], None]:
    """Return what lets a module read as if its text were another, the last one that was named."""
    analyse, source = code_hash.analyse_module, code_hash.read_source

    def edit(module: str, old: str, new: str) -> None:
        text = source(module).replace(old, new)
        assert text != source(module)
        monkeypatch.setattr(code_hash, "read_source", lambda name: text if name == module else source(name))
        edited = analyse.__wrapped__(module)
        monkeypatch.setattr(code_hash, "analyse_module", lambda name: edited if name == module else analyse(name))

    return edit
