"""MuJoCo's warnings, heard by us: by itself it prints them and writes MUJOCO_LOG.TXT into the user's folder."""

import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import mujoco

UNSTABLE = "unstable"  # the word in every warning after which MuJoCo resets a simulation


@dataclass
class Ears:
    """Everyone who listens: the engine knows one listener, however many threads simulate.

    Attributes:
        lists: What each block has heard so far, and the thread that it runs in.
        before: Who had asked the engine before the first block began.
        lock: Held while blocks come and go.
    """

    lists: list[tuple[int, list[str]]] = field(default_factory=list)
    before: Callable[[str], None] | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)

    def hear(self, warning: str) -> None:
        """Give a warning to the block of the thread that caused it; to all where that is the engine's own thread."""
        listening = list(self.lists)
        own = [heard for thread, heard in listening if thread == threading.get_ident()]
        for heard in own[-1:] or [heard for _, heard in listening]:
            heard.append(warning)

    def enter(self, heard: list[str]) -> None:
        """Start a block."""
        with self.lock:
            if not self.lists:
                self.before = mujoco.get_mju_user_warning()
                mujoco.set_mju_user_warning(self.hear)
            self.lists.append((threading.get_ident(), heard))

    def leave(self, heard: list[str]) -> None:
        """End a block; after the last, who had asked before hears again."""
        with self.lock:
            self.lists = [entry for entry in self.lists if entry[1] is not heard]
            if not self.lists:
                mujoco.set_mju_user_warning(self.before)


ears = Ears()


@contextmanager
def heard_warnings() -> Iterator[list[str]]:
    """Collect what MuJoCo warns of inside the block; who had asked to hear it before hears it again afterwards."""
    heard: list[str] = []
    ears.enter(heard)
    try:
        yield heard
    finally:
        ears.leave(heard)


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
