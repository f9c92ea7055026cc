"""Endurance: thousands of disturbed packets, a hundred kills; minutes each, and so run apart from the other tests."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from nas_data import errors
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.virtual_bus.options import Options
from nas_data.virtual_bus.process import VirtualBus
from nas_data.xl320.arm import Arm
from nas_data.xl320.ergojr import ergojr_joints

JOINTS = ergojr_joints()
FAULTS = 10_000
KILLS = 100
UNDER_WAY = Path("datasets/rec/recording")
DISTURBED = ("lost_packet:share=0.03", "corrupted_packet:share=0.03", "latency:share=0.01")
SENTENCES = (errors.BadReply, errors.ServoSilent, errors.NobodyAnswers)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_thousands_of_disturbed_packets_yield_no_wrong_value_and_no_hang():
    options = Options(faults=DISTURBED, honest=False, lockstep=True)
    with VirtualBus(options) as bus:
        arm = Arm(bus.port, JOINTS)
        still, longest, sentences = None, 0.0, 0
        while arm.bus.failures < FAULTS:
            began = time.monotonic()
            try:
                reading = arm.read()
            except SENTENCES as error:
                sentences += str(error).endswith(".")
            else:
                still = still or reading.raw  # the torque is off, and no time passes
                assert reading.raw == still
            longest = max(longest, time.monotonic() - began)
        assert longest < 1.0
        assert sentences > 0
        arm.close()


def saved() -> int:
    return read(UNDER_WAY).n_episodes if UNDER_WAY.exists() else 0


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_a_hundred_kills_lose_nothing_that_was_called_saved(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    command = [sys.executable, "-m", "nas_data", "record", "ergojr", "--name", "rec", "--seconds", "0.2"]
    command += ["--excitation", "steps:share=0.1,seconds=0.1", "--episodes", "600"]
    promised = 0
    with VirtualBus(Options(honest=False)) as bus:
        for _ in range(KILLS):
            process = subprocess.Popen([*command, "--port", bus.port], stdout=subprocess.DEVNULL)
            until = time.monotonic() + 120
            while saved() == promised and time.monotonic() < until:
                assert process.poll() is None
                time.sleep(0.05)
            time.sleep(float(rng.uniform(0, 2)))
            promised = saved()
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            assert saved() >= promised > 0
            promised = saved()
            time.sleep(2.5)  # the guard takes the arm over, then gives it back
        subprocess.run([*command, "--port", bus.port, "--finish"], check=True)
    assert read(Path("datasets/rec")).n_episodes == promised
    assert verify(Path("datasets/rec")) == []
