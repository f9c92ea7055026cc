"""Work side by side: the same results in the same order, and each simulation hears its own warnings."""

import threading

import mujoco
import numpy as np
import pytest
from support.evidence_samples import commanded

from nas_data.effects.base import parse
from nas_data.gap import side_by_side as module
from nas_data.gap.nominal import Nominal
from nas_data.gap.side_by_side import is_sharing_cores, map_in_parallel
from nas_data.mjcf.engine_warnings import collect_warnings


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "count_cores", lambda: 2)


def test_results_keep_their_order_and_work_spreads_once():
    seen = map_in_parallel(
        lambda item: (item, is_sharing_cores(), map_in_parallel(lambda inner: inner + item, [1, 2])), range(9)
    )
    assert [item for item, _, _ in seen] == list(range(9))
    assert all(shares for _, shares, _ in seen)
    assert [inner for _, _, inner in seen] == [[1 + item, 2 + item] for item in range(9)]
    assert not is_sharing_cores()


def test_an_error_reaches_the_caller():
    def fail(item: int) -> int:
        raise ValueError(f"item {item}")

    with pytest.raises(ValueError, match="item 0"):
        map_in_parallel(fail, range(3))


def test_rollouts_are_the_same_to_the_bit():
    evidence = commanded()
    nominal = Nominal.load("ergojr", evidence)
    effects = [parse(f"coulomb_friction:joint=m{joint},torque=0.02") for joint in (2, 3, 4, 5)]
    together = map_in_parallel(lambda effect: nominal.predict(evidence, [effect]), effects)
    assert all(
        np.array_equal(nominal.predict(evidence, [effect]), found)
        for effect, found in zip(effects, together, strict=True)
    )


def test_each_thread_hears_its_own_warnings_and_who_asked_before_hears_again():
    """A thread whose simulation is sound is not told of another's that diverges."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint axis='1 0 0'/><geom size='.1'/></body></worldbody></mujoco>"
    )
    begun, done = threading.Barrier(2), threading.Barrier(2)
    heard: dict[str, list[str]] = {}

    def listen(name: str, speed: float) -> None:
        data = mujoco.MjData(model)
        data.qvel[:] = speed
        with collect_warnings() as warnings:
            begun.wait()
            mujoco.mj_step(model, data)
            done.wait()
        heard[name] = warnings

    before: list[str] = []
    mujoco.set_mju_user_warning(before.append)
    try:
        threads = [threading.Thread(target=listen, args=pair) for pair in [("sound", 0.0), ("lost", np.nan)]]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert heard["lost"]
        assert not heard["sound"]
        assert not before
        data = mujoco.MjData(model)
        data.qvel[:] = np.nan
        mujoco.mj_step(model, data)
        assert before
    finally:
        mujoco.set_mju_user_warning(None)
