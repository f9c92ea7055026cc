"""A small run of everything: record, pair, learn the gap, train policies, write one page."""

from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.commands.base import Command, CommandResult
from nas_data.runs.progress import say


@dataclass(frozen=True, kw_only=True)
class Demo(Command):
    """Record a simulated robot, name and learn its simulator's gap, train policies, and write a page.

    Takes about twelve minutes on two cores. The same command resumes an interrupted run.

    Example: nas demo --out demo
    """

    out: Path = Path("demo")
    """Folder for all output; the page is report.html in it."""
    quick: bool = False
    """Run all stages within a minute, at sizes too small to learn anything."""
    names: bool = True
    """Whether to name effects with `nas gap` and to train a policy with them. --quick leaves both out, too."""

    def run(self) -> CommandResult:
        """Run every stage that is not finished yet."""
        from nas_data.studies.demo.plan import FULL, QUICK, run_demo

        plan = QUICK if self.quick else FULL
        results = run_demo(plan if self.names else replace(plan, named=0), self.out, say)
        data = {
            name: {"seconds": done.seconds, "when": done.when, "load": done.load, **done.data}
            for name, done in results.items()
        }
        return CommandResult("\n".join(line for done in results.values() for line in done.summary), data)
