"""Warnings of the engine: each simulation hears its own."""

import threading

import mujoco
import numpy as np

from nas_data.mjcf.engine_warnings import collect_warnings


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
