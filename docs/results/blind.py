"""Make blind.md from the cases in blind.parquet, to which finished cases are added first if asked for.

Run `python docs/results/blind.py`; with cases to add, name their folders, `--seed`, `--setting` and `--commit`.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import tyro
from pages import HERE, markdown_table, render, write_page

from nas_data.benchmarks.blind.catalogue import OUTSIDE

# of cases, `SURE`
GIVEN = {"0.03", "0.2", "0.088", "0.29", "1.4", "0.5", "1.1", "2.5", "1.3", "0.6", "1.5", "0.8", "0.9"}
FAMILIES = {
    "one": "one effect",
    "two": "two effects",
    "three": "three effects",
    "none": "nothing hidden",
    "outside": "outside the catalogue",
}
ALL_FAMILIES = {
    **{name: FAMILIES[name] for name in ("none", "one", "two", "three")},
    "every": "the same effect in every joint",
    "torque": "torques are commanded, episodes begin in motion",
    "outside": FAMILIES["outside"],
}
BESIDE = {"outside_one": "one effect, one cause outside", "outside_two": "two effects, one cause outside"}
KEPT = (
    "case", "arm", "excitation", "true", "marks", "named", "confidences", "parameters", "verdict", "exact",
    "confident_wrong", "unexplained_joint_named", "called_complete", "missing", "seconds", "fresh",
)  # fmt: skip
ADDED = {"called_complete": pa.bool_(), "missing": pa.list_(pa.list_(pa.string()))}
SURE = 0.8  # a wrong name with at least this confidence counts as confidently wrong
TABLE = "blind.parquet"
Case = Mapping[str, object]


class Blind:
    """What the cases say, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        self._cases = pq.read_table(folder / TABLE).to_pylist()

    def _of(self, seed: int, setting: str, family: str | None = None) -> list[Case]:
        cases = [case for case in self._cases if (case["seed"], case["setting"]) == (seed, setting)]
        return [case for case in cases if family in (None, find_family(case))]

    def count(self, seed: int, setting: str) -> str:
        """Return how many cases a seed has."""
        return str(len(self._of(seed, setting)))

    def commit(self, seed: int, setting: str) -> str:
        """Return what a seed's cases were run with."""
        return self._of(seed, setting)[0]["commit"]

    def right(self, seeds: Sequence[int], setting: str, families: Sequence[str]) -> str:
        """Return how many cases of some families are exactly right, of how many."""
        cases = [case for seed in seeds for family in families for case in self._of(seed, setting, family)]
        return f"{sum(case['exact'] for case in cases)} of {len(cases)}"

    def families(self, seed: int, setting: str) -> str:
        """Return the table of a seed's families."""
        by_family = {family: self._of(seed, setting, family) for family in FAMILIES}
        heads = ["family", "cases", "exactly right", "wrong with confidence ≥ 0.8"]
        heads += ["rest on new episodes if right, median", "rest with the true effects, median", "median time [s]"]
        return markdown_table(heads, [tell_family(family, own) for family, own in by_family.items() if own])

    def seeds(self, *seeds: int) -> str:
        """Return the table of the families of some seeds, in all settings."""
        cases = [case for case in self._cases if case["seed"] in seeds]
        by_family = {family: [case for case in cases if find_family(case) == family] for family in ALL_FAMILIES}
        heads = ["family", "cases", "exactly right", "wrong with confidence ≥ 0.8"]
        heads += ["rest on new episodes if right, median", "rest with the true effects, median", "median time [s]"]
        return markdown_table(heads, [tell_family(family, own) for family, own in by_family.items() if own])

    def times(self, seed: int, below: int) -> str:
        """Return the median times of a seed's cases with a number below one, for one, two and three effects [s]."""
        first = [case for case in self._cases if case["seed"] == seed and int(str(case["case"])[-4:]) < below]
        times = [[c["seconds"] for c in first if find_family(c) == family] for family in ("one", "two", "three")]
        return ", ".join(f"{tell_median(own, 0)} s" for own in times)

    def sure(self, *seeds: int) -> str:
        """Return how many names of some seeds with a confidence of 0.9 or more are right, of how many."""
        said = [one for case in self._cases if case["seed"] in seeds for one in case["confidences"]]
        sure = [one["right"] for one in said if one["confidence"] >= 0.9]
        return f"{sum(sure)} of {len(sure)}"

    def found(self, seed: int, setting: str) -> str:
        """Return a list of how right parameters, intervals and confidences of a seed are."""
        return tell_found(self._of(seed, setting))

    def found_of(self, *seeds: int) -> str:
        """Return the same of some seeds, in all settings."""
        return tell_found([case for case in self._cases if case["seed"] in seeds])

    def failures(self, seeds: Sequence[int], setting: str | None = None) -> str:
        """Return the table of cases inside the catalogue that are not right, by default of all settings."""
        cases = [case for case in self._cases if case["seed"] in seeds and setting in (None, case["setting"])]
        wrong = [case for case in cases if not case["exact"] and find_family(case) not in ("outside", *BESIDE)]
        return markdown_table(["case", "hidden (size)", "named (confidence)"], map(tell_failure, wrong))

    def runs(self, setting: str, seeds: Sequence[int]) -> str:
        """Return the table of several seeds: how many of each family are exactly right, and how sure it was."""
        rows = []
        for seed in seeds:
            cases = self._of(seed, setting)
            families = [self._of(seed, setting, family) for family in FAMILIES]
            cells = [f"{sum(case['exact'] for case in own)} of {len(own)}" if own else "" for own in families]
            errors = list_errors(cases)
            held = [bool(e["covered"]) for c in cases for e in c["parameters"] if e["covered"] is not None]
            sure, off = str(sum(map(is_sure_and_wrong, cases))), f"{100 * np.median(errors):.1f} %"
            commit, held_of = f"`{cases[0]['commit']}`", f"{sum(held)} of {len(held)}"
            rows.append([str(seed), commit, *cells, sure, off, held_of])
        heads = ["seed", "commit", *FAMILIES.values(), "wrong with confidence ≥ 0.8"]
        return markdown_table([*heads, "error of parameters, median", "intervals with the true value"], rows)

    def beside(self, seeds: Sequence[int], *settings: str) -> str:
        """Return the table of the cases that hide a cause outside the catalogue, alone or beside effects."""
        rows = []
        for family, label in {"outside": FAMILIES["outside"], **BESIDE}.items():
            cases = [case for seed in seeds for setting in settings for case in self._of(seed, setting, family)]
            rows += [tell_beside(label, family, cases)] if cases else []
        heads = ["hidden", "cases", "found", "wrong names", "wrong with confidence ≥ 0.8", "called complete"]
        return markdown_table([*heads, "intervals with the true value"], rows)

    def outside_runs(self, *seeds: int) -> str:
        """Return the table of seeds with causes outside the catalogue, alone or beside effects, in all settings."""
        rows = []
        for seed in seeds:
            cases = [c for c in self._cases if c["seed"] == seed and find_family(c) in ("outside", *BESIDE)]
            called = [case["called_complete"] for case in cases if case.get("called_complete") is not None]
            held = [bool(e["covered"]) for case in cases for e in case["parameters"] if e["covered"] is not None]
            settings = sorted({case["setting"] for case in cases})
            rows.append(
                [
                    str(seed),
                    f"`{cases[0]['commit']}`",
                    str(len(cases)),
                    self.effects_found((seed,), *settings),
                    self.sure(seed),
                    f"{sum(called)} of {len(called)}",
                    f"{sum(held)} of {len(held)}",
                ]
            )
        heads = ["seed", "commit", "cases", "effects named", "names of 0.9 or more that are right", "called complete"]
        return markdown_table([*heads, "intervals with the true value"], rows)

    def effects_found(self, seeds: Sequence[int], *settings: str) -> str:
        """Return how many effects of the catalogue are named in cases with a cause outside it, of how many."""
        cases = [case for seed in seeds for setting in settings for case in self._of(seed, setting)]
        hidden = sum(effect not in OUTSIDE for case in cases for effect, _ in case["true"])
        return f"{hidden - sum(len(case['missing']) for case in cases)} of {hidden}"

    def methods(self, seed: int, setting: str) -> str:
        """Return the table of the other methods on the cases that they were given, `nas gap` beside them."""
        rows = []
        for family, label in FAMILIES.items():
            both = [case for case in self._of(seed, setting, family) if case["baselines"]]
            answers = {"nas gap": both}
            for case in both:
                for answer in case["baselines"]:
                    answers.setdefault(answer["method"], []).append(answer)
            rows += [tell_method(label, name, given) for name, given in answers.items() if given]
        return markdown_table(
            ["hidden", "method", "cases", "exactly right", "wrong with confidence ≥ 0.8", "rest", "time [s]"], rows
        )


def find_family(case: Case) -> str:
    """Return the family that a case's name begins with."""
    return str(case["case"]).removeprefix("any-").split("-")[0]


def is_sure_and_wrong(case: Case) -> bool:
    """Return whether something wrong was named with a confidence of at least `SURE`."""
    return any(said["confidence"] >= SURE and not said["right"] for said in case["confidences"])


def list_errors(cases: Iterable[Case]) -> list[float]:
    """Return the relative errors of the parameters that were found and that have one."""
    errors = [entry["relative_error"] for case in cases for entry in case["parameters"]]
    return [error for error in errors if error is not None and not np.isnan(error)]


def list_rests(cases: Iterable[Case]) -> list[float]:
    """Return what the delivered models leave on fresh episodes, in noise floors."""
    return [case["fresh"]["after"] / case["fresh"]["floor"] for case in cases if case["fresh"]["after"]]


def tell_found(cases: Sequence[Case]) -> str:
    """Return a list of how right parameters, intervals and confidences of some cases are."""
    parameters = [entry for case in cases for entry in case["parameters"]]
    errors = list_errors(cases)
    held = [bool(entry["covered"]) for entry in parameters if entry["covered"] is not None]
    said = [(entry["confidence"], entry["right"]) for case in cases for entry in case["confidences"]]
    lines = [
        f"- **Parameters** of right names: median error {100 * np.median(errors):.1f} %, largest "
        f"{100 * max(errors):.0f} %; {sum(held)} of {len(held)} 95 % intervals contain the true value."
    ]
    parts = []
    for low, high, words in ((0.8, 2.0, "at 0.8 or more"), (0.5, 0.8, "from 0.5 to 0.8"), (0.0, 0.5, "below 0.5")):
        inside = [right for confidence, right in said if low <= confidence < high]
        parts.append(f"{sum(inside)} of {len(inside)} {words}")
    return "\n".join([*lines, f"- **Confidence**: right names: {', '.join(parts)}."])


def tell_median(values: Sequence[float], digits: int = 2) -> str:
    """Return the median; nothing of none."""
    return f"{np.median(values):.{digits}f}" if values else ""


def tell_family(family: str, cases: Sequence[Case]) -> list[str]:
    """Return a row of the table of families."""
    right = [case for case in cases if case["exact"]]
    least = [case["fresh"]["least"] / case["fresh"]["floor"] for case in right if case["fresh"]["least"]]
    sure, time = str(sum(map(is_sure_and_wrong, cases))), tell_median([case["seconds"] for case in cases], 0)
    if family == "outside":
        named = sum(bool(case["unexplained_joint_named"]) for case in cases)
        explained = sum(case["verdict"] == "explained" for case in cases)
        words = f"(`explained`: {explained or 'none'}; right joint listed as unexplained: {named})"
        return [ALL_FAMILIES[family], str(len(cases)), f"named nothing in {len(right)}", sure, words, "", time]
    counts = [ALL_FAMILIES[family], str(len(cases)), str(len(right)), sure]
    return [*counts, tell_median(list_rests(right)), tell_median(least), time]


def tell_beside(label: str, family: str, cases: Sequence[Case]) -> list[str]:
    """Return a row of the table of causes outside the catalogue."""
    said = [one for case in cases for one in case["confidences"]]
    wrong = [one["confidence"] for one in said if not one["right"]]
    held = [bool(entry["covered"]) for case in cases for entry in case["parameters"] if entry["covered"] is not None]
    found = str(sum(not case["missing"] for case in cases)) if family in BESIDE else ""
    highest = f"{len(wrong)} (highest confidence {max(wrong):.2f})" if wrong else "0"
    called = [case["called_complete"] for case in cases if case.get("called_complete") is not None]
    complete = f"{sum(called)} of {len(called)}" if called else ""
    sure = str(sum(map(is_sure_and_wrong, cases)))
    return [label, str(len(cases)), found, highest, sure, complete, f"{sum(held)} of {len(held)}" if held else ""]


def tell_method(family: str, name: str, answers: Sequence[Case]) -> list[str]:
    """Return a row of the table of methods; rests are those of all cases, right or not."""
    right, sure = sum(bool(one["exact"]) for one in answers), sum(bool(one["confident_wrong"]) for one in answers)
    rest = tell_median(list_rests([one for one in answers if one["fresh"]]))
    return [
        family,
        name,
        str(len(answers)),
        str(right),
        str(sure),
        rest,
        tell_median([a["seconds"] for a in answers], 1),
    ]


def tell_failure(case: Case) -> list[str]:
    """Return which case it is, what was hidden and what was named."""
    family, plant, seed, place = str(case["case"]).removeprefix("any-").removeprefix("torque-").split("-")
    marks = [f"{join(name)} ({mark:.0f})" for name, mark in zip(case["true"], case["marks"], strict=True)]
    said = zip(case["named"], case["confidences"], strict=True)
    named = [f"{join(name)} ({each['confidence']:.2f})" for name, each in said]
    return [f"seed {seed}: {family}, {plant} {int(place)}", ", ".join(marks), ", ".join(named) or "nothing"]


def join(name: Sequence[str | None]) -> str:
    """Return effect and joint."""
    return " ".join(part.replace("_", " ") for part in name if part)


def make_page(folder: Path) -> str:
    """Return the page that the cases of a folder make."""
    return render(folder / "blind.md.j2", Blind(folder))


def add_cases(folders: Iterable[Path], seed: int, setting: str, commit: str) -> None:
    """Add the finished cases of `--out` folders of `nas benchmark gap` to the table; cases of the same name go."""
    table = pq.read_table(HERE / TABLE)
    added = {}
    for folder in folders:
        for path in sorted((folder / "results").glob("*.json")):
            record = json.loads(path.read_text("utf-8"))
            case = {key: record.get(key) for key in KEPT} | {"seed": seed, "setting": setting, "commit": commit}
            case["baselines"] = [{"method": name, **one} for name, one in (record.get("baselines") or {}).items()]
            added[record["case"]] = case
    kept = [case for case in table.to_pylist() if case["case"] not in added]
    schema = table.schema
    for name, kind in ADDED.items():  # tables of earlier versions lack these columns
        schema = schema if name in schema.names else schema.append(pa.field(name, kind))
    new = pa.Table.from_pylist([*kept, *added.values()], schema=schema)
    pq.write_table(new, HERE / TABLE, compression="zstd")


def main(
    folders: tyro.conf.Positional[tuple[Path, ...]] = (), seed: int = 0, setting: str = "xl320", commit: str = ""
) -> None:
    """Make the page, after the cases of some folders have been added.

    Args:
        folders: `--out` folders of `nas benchmark gap`.
        seed: Seed that their cases were drawn with.
        setting: Setting that they were drawn by.
        commit: What they were run with.
    """
    if folders:
        add_cases(folders, seed, setting, commit)
    write_page("blind", make_page(HERE), {})


if __name__ == "__main__":
    tyro.cli(main)
