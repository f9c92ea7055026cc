"""Entries of a provenance's target that belong to episodes: the servos' registers, and the logs of an import."""

from collections.abc import Iterable, Mapping, Sequence

REGISTERS = "registers"  # history: entries with `from_episode` and `joints`
EPISODES = "episodes"  # one entry an episode

Target = Mapping[str, object]
Tables = Mapping[str, Mapping[str, int]]  # control table of each joint: by joint, then by register


def select_episodes(target: Target | None, episodes: Sequence[int], count: int) -> Target | None:
    """Return a target that describes some of its episodes, in their new order.

    Args:
        target: Target of a provenance.
        episodes: For each new episode, its number in the target; a number may appear more than once.
        count: Number of episodes of the dataset that the target belongs to.
    """
    if target is None:
        return None
    selected = dict(target)
    history = read_history(target)
    if history:
        selected[REGISTERS] = write_history([find_joints(history, episode) for episode in episodes])
    entries = selected.pop(EPISODES, None)
    if isinstance(entries, list) and len(entries) == count:
        selected[EPISODES] = [entries[episode] for episode in episodes]
    return selected


def join_targets(parts: Sequence[tuple[Target | None, int]]) -> Target | None:
    """Return the target of consecutive datasets: what all share, and the entries by episode; None if nothing is left.

    Episodes without known registers have an empty table if others have some.

    Args:
        parts: Target and number of episodes of each dataset.
    """
    targets = [dict(target or {}) for target, _ in parts]
    shared = [{key: item for key, item in target.items() if key not in (REGISTERS, EPISODES)} for target in targets]
    joined: dict[str, object] = dict(shared[0]) if all(other == shared[0] for other in shared) else {}
    histories = [read_history(target) for target in targets]
    if any(histories):
        counts = [count for _, count in parts]
        joined[REGISTERS] = write_history(
            find_joints(history, episode) if history else {}
            for history, count in zip(histories, counts, strict=True)
            for episode in range(count)
        )
    entries = [target.get(EPISODES) for target in targets]
    if all(isinstance(one, list) and len(one) == count for one, (_, count) in zip(entries, parts, strict=True)):
        joined[EPISODES] = [entry for one in entries for entry in one]  # type: ignore[attr-defined]
    return joined or None


def read_history(target: Target) -> list[tuple[int, Tables]]:
    """Return the history of the servos' registers: first episode and values by joint; empty if there is none."""
    history = target.get(REGISTERS)
    return [(int(entry["from_episode"]), entry["joints"]) for entry in history] if isinstance(history, list) else []


def find_joints(history: Sequence[tuple[int, Tables]], episode: int) -> Tables:
    """Return the registers by joint in an episode; the first known ones before the history begins."""
    return next((joints for start, joints in reversed(history) if start <= episode), history[0][1])


def write_history(registers: Iterable[object]) -> list[dict[str, object]]:
    """Return the history of the registers by joint of consecutive episodes."""
    history: list[dict[str, object]] = []
    for episode, joints in enumerate(registers):
        if not history or history[-1]["joints"] != joints:
            history.append({"from_episode": episode, "joints": joints})
    return history
