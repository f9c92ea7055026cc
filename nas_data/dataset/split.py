"""Division of a dataset into two parts without common episodes."""

from collections.abc import Sequence

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.derive_provenance import Derived, Original, inherit
from nas_data.errors import OptionError

LONGEST = 10_000_000  # episodes in a range; a typing error must not fill the memory


def split(original: Original, chosen: Sequence[int], how: str = "") -> tuple[Derived, Derived]:
    """Divide a dataset by episodes; both parts keep their order.

    Args:
        original: The dataset.
        chosen: Episodes of the first part; the others form the second.
        how: Rule of the choice, for the provenance; if empty, the provenance lists the episodes.

    Raises:
        OptionError: an episode does not exist or is named twice, or a part is empty.
    """
    count = original.dataset.n_episodes
    beyond = [episode for episode in chosen if not 0 <= episode < count]
    if beyond:
        raise OptionError(f"There is no episode {beyond[0]} in {original.root}; it has 0 to {count - 1}.")
    first = sorted(set(chosen))
    if len(first) < len(chosen):
        raise OptionError(f"An episode is named twice in {format_episodes(sorted(chosen))}; name each once.")
    if not 0 < len(first) < count:
        raise OptionError(
            f"{len(first)} of the {count} episodes of {original.root} were chosen; both parts need at least one."
        )
    second = sorted(set(range(count)) - set(first))
    return _make_part(original, first, how), _make_part(original, second, how and f"the others than {how}")


def draw(count: int, share: float, seed: int) -> list[int]:
    """Draw a share of episodes at random, at least one and not all.

    Args:
        count: Number of episodes.
        share: Share to draw, above 0 and below 1.
        seed: Seed of the draw.

    Raises:
        OptionError: the share is out of range, the seed negative, or there are fewer than two episodes.
    """
    if not 0 < share < 1:
        raise OptionError(f"--share is {share:g}; it must lie between 0 and 1, for example 0.8.")
    if seed < 0:
        raise OptionError(f"--seed is {seed}; it must be 0 or more.")
    if count < 2:
        raise OptionError(f"A dataset of {count} episode cannot be divided; at least two are needed.")
    size = min(max(round(share * count), 1), count - 1)
    return sorted(np.random.default_rng(seed).permutation(count)[:size].tolist())


def parse_episodes(text: str) -> list[int]:
    """Parse episodes from the command line: `0,1,2` or `0-11,14`.

    Raises:
        OptionError: the text is not such a list.
    """
    episodes: list[int] = []
    for word in text.split(","):
        first, dash, last = word.strip().partition("-")
        if not (first.isdecimal() and (last.isdecimal() if dash else True)):
            raise OptionError(
                f"'{word.strip()}' in --episodes is not an episode; write numbers and ranges like 0,1,4-7."
            )
        low, high = int(first), int(last if dash else first)
        if high < low or high - low > LONGEST:
            raise OptionError(
                f"'{word.strip()}' in --episodes is not a range; write the smaller number first, like 4-7."
            )
        episodes += range(low, high + 1)
    return episodes


def format_episodes(episodes: Sequence[int]) -> str:
    """Return ascending episodes in the format of `parse_episodes`, for example `0-3,7`."""
    runs: list[list[int]] = []
    for episode in episodes:
        if runs and episode == runs[-1][-1] + 1:
            runs[-1].append(episode)
        else:
            runs.append([episode])
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)


def _make_part(original: Original, episodes: Sequence[int], how: str) -> Derived:
    """Return one part; its provenance names the episodes."""
    rule = f"{count_of(len(episodes), 'episode')}, {how}," if how else f"episodes {format_episodes(episodes)}"
    deed = f"{rule} of {original.parent.name}"
    return Derived(original.dataset.select(episodes), inherit([original], deed, episodes), original.attachments)
