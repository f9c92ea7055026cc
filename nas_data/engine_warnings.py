"""MuJoCo's warnings, heard by us: by itself it prints them and writes MUJOCO_LOG.TXT into the user's folder."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import mujoco

UNSTABLE = "unstable"  # the word in every warning after which MuJoCo resets a simulation


@contextmanager
def heard_warnings() -> Iterator[list[str]]:
    """Collect what MuJoCo warns of inside the block; who had asked to hear it before hears it again afterwards."""
    heard: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield heard
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def heard_instability() -> Iterator[list[str]]:
    """Collect warnings of unstable simulations; others, which do not spoil the result, go to stderr."""
    unstable: list[str] = []
    with heard_warnings() as heard:
        yield unstable
    unstable += [warning for warning in heard if UNSTABLE in warning]
    pass_on(heard)


def pass_on(heard: Iterable[str]) -> None:
    """Say warnings on stderr, each once, but those of unstable simulations."""
    for warning in sorted({warning for warning in heard if UNSTABLE not in warning}):
        print(f"MuJoCo: {warning}", file=sys.stderr)
