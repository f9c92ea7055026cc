"""Tables of policies as text."""

from collections.abc import Mapping, Sequence

from nas_data.policies.evaluate import Group, Returns, summarise_spread
from nas_data.text_table import format_table

HEADERS = ("policy", "seeds", "return: median", "min … max", "mean ± sd", "success: median", "min … max")


def format_group_row(group: Group) -> tuple[str, ...]:
    """Return one table row for policies that differ only in their seed."""
    returns, success = summarise_spread(group.returns), summarise_spread(group.success_rates)
    return (
        group.name,
        str(len(group.scores)),
        f"{returns['median']:.2f}",
        f"{returns['min']:.2f} … {returns['max']:.2f}",
        f"{returns['mean']:.2f} ± {returns['sd']:.2f}",
        f"{success['median']:.0%}",
        f"{success['min']:.0%} … {success['max']:.0%}",
    )


def format_policy_table(groups: Sequence[Group], baselines: Mapping[str, Returns]) -> str:
    """Return groups, then untrained baselines, as aligned text."""
    rows = [format_group_row(group) for group in groups]
    rows += [
        (name, "", f"{score.mean_return:.2f}", "", "", f"{score.success_rate:.0%}", "")
        for name, score in baselines.items()
    ]
    return format_table(HEADERS, rows)
