"""Everything once, small: record, pair, learn the gap, learn policies, show it on one page."""

from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.commands.base import Command, CommandResult
from nas_data.runs.progress import say


@dataclass(frozen=True, kw_only=True)
class Demo(Command):
    """Record a simulated robot, name and learn what its simulator lacks, learn policies with it, and write a page.

    Takes about twelve minutes on two cores. Started again, it goes on where it was
    interrupted.

    Example: nas demo --out demo
    """

    out: Path = Path("demo")
    """Folder for everything that the demo makes; the page is report.html in it."""
    quick: bool = False
    """Go through the stages within a minute, at sizes at which nothing is learned yet."""
    names: bool = True
    """Let `nas gap` name what the source lacks, and learn a policy on the names; left out where --quick is given."""

    def run(self) -> CommandResult:
        """Run every stage that is not done yet."""
        from nas_data.studies.demo.plan import FULL, QUICK, run_demo

        plan = QUICK if self.quick else FULL
        results = run_demo(plan if self.names else replace(plan, named=0), self.out, say)
        data = {
            name: {"seconds": done.seconds, "when": done.when, "load": done.load, **done.data}
            for name, done in results.items()
        }
        return CommandResult("\n".join(line for done in results.values() for line in done.summary), data)
