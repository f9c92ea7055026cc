"""Threads that roll out simulations, kept for the next simulator: models come and go by the thousand in a fit."""

import threading

import mujoco.rollout

_kept = threading.local()


def rollout_pool(threads: int) -> mujoco.rollout.Rollout:
    """Return this Python thread's pool of worker threads; 0 threads roll out in the calling one."""
    pools: dict[int, mujoco.rollout.Rollout] = _kept.__dict__.setdefault("pools", {})
    if threads not in pools:
        pools[threads] = mujoco.rollout.Rollout(nthread=threads)
    return pools[threads]
