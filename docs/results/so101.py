"""Make so101.md and its picture from so101.csv and so101_names.csv.

Run `python docs/results/so101.py`.
"""

from pathlib import Path

import numpy as np
from pages import HERE, Row, markdown_table, number, read_table, render, write_page

from nas_data.reports.figures import AblationCurve, draw_error_over_amount
from nas_data.reports.style import to_png

GIVEN = {"0.55", "0.001", "0.000001", "0.9", "0.2"}  # the goal, largest differences, a confidence, and a drift
MOTIONS = ("chirp_sweep", "random_waypoints", "friction_gravity", "pick_place")
COMMIT = "5c76607e"  # of the search
COLUMNS = {"given model": "source", "with the named effects": "names", "and φ": "names + φ"}
MODEL_GAIN = 998.22  # [N·m/rad] of so101_new_calib_nomesh.xml
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
SURE = 0.9  # confidence
LOOPS = ("open_loop", "one_step")


class So101:
    """What the tables say, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        self._runs, self._names = read_table(folder / "so101.csv"), read_table(folder / "so101_names.csv")

    # Held-out motions

    def motions_table(self) -> str:
        """Return the table of errors by held-out motion [°]."""
        rows = [
            [f"`{motion}`", *(number(self._error(motion, one), 2) for one in COLUMNS.values())] for motion in MOTIONS
        ]
        rows.append(["mean", *(number(self._error("mean", one), 2) for one in COLUMNS.values())])
        return markdown_table(["held-out motion", *COLUMNS], rows)

    def share(self) -> str:
        """Return what the names leave of the stock model's mean error."""
        return number(self._error("mean", "names") / self._error("mean", "source"), 2)

    def _error(self, motion: str, method: str) -> float:
        key = ("held-out motions", motion, method, COMMIT)
        (row,) = (r for r in self._runs if (r["experiment"], r["motion"], r["method"], r["commit"]) == key)
        return float(row["open_loop"])

    # Names

    def _found(self, recordings: str) -> list[Row]:
        return [row for row in self._names if row["recordings"] == recordings]

    def names_count(self) -> str:
        """Return how many effects were named in the recordings as they are."""
        rows = [row for row in self._found("so101") if row["effect"] not in ("base", "unexplained")]
        return str(len({(row["effect"], row["joint"]) for row in rows}))

    def gain(self) -> str:
        """Return the one gain of all servos over the model's, and in N·m/rad."""
        (value,) = {float(row["value"]) for row in self._found("so101") if row["effect"] == "servo_stiffness"}
        return f"{number(value, 4)} of the model's, {number(value * MODEL_GAIN, 1)} N·m/rad"

    def names_table(self) -> str:
        """Return the table of named effects by kind: the range of their values, and of their confidences."""
        rows = []
        for effect in dict.fromkeys(row["effect"] for row in self._found("so101")):
            own = [row for row in self._found("so101") if row["effect"] == effect]
            if effect not in ("base", "unexplained"):
                values, sure = ([abs(float(row[key])) for row in own] for key in ("value", "confidence"))
                ends = [f"{number(min(part), 3)} to {number(max(part), 3)}" for part in (values,)]
                unit = f" {own[0]['unit']}".rstrip()
                joints = ", ".join(f"`{row['joint']}`" for row in own) if len(own) < len(JOINTS) else "all six"
                shown = ends[0] if min(values) != max(values) else number(values[0], 4)
                rows.append([f"`{effect}`", joints, shown + unit, f"{number(min(sure), 2)} to {number(max(sure), 2)}"])
        return markdown_table(["effect", "joints", "size", "confidence"], rows)

    def left(self) -> str:
        """Return what is left in the joints, in noise floors."""
        values = [float(row["value"]) for row in self._found("so101") if row["effect"] == "unexplained"]
        return f"{min(values):.0f} to {max(values):.0f}"

    def halves_table(self) -> str:
        """Return the table of gains and dry friction from all motions and from every other one, by joint."""
        parts = ("so101", "every other motion")
        kinds = (("servo_stiffness", 3), ("coulomb_friction", 2))
        rows = [
            [f"`{joint}`", *(self._size(part, kind, joint, n) for kind, n in kinds for part in parts)]
            for joint in JOINTS
        ]
        words = ("gain: all motions", "every other", "dry friction [N·m]: all motions", "every other")
        return markdown_table(["joint", *words], rows)

    def _size(self, recordings: str, effect: str, joint: str, digits: int) -> str:
        for row in self._found(recordings):
            if (row["effect"], row["joint"]) == (effect, joint):
                value, low, high = (number(float(row[key]), digits) for key in ("value", "low", "high"))
                return f"{value} [{low}, {high}]"
        return "not named"

    def sure_names(self, recordings: str) -> str:
        """Return the number of names with a confidence of 0.9 or more."""
        return str(sum(float(row["confidence"] or 0) >= SURE for row in self._found(recordings)))

    # Minutes of data

    def ablation_table(self, preset: str) -> str:
        """Return the table of errors by minutes of data, three seeds each [°]."""
        heads = ["learned", "from", "open loop [°]: median", "min … max", "one step [°]: median", "min … max"]
        rows = []
        for method, minutes in self._amounts(preset):
            cells = [method, f"{minutes:.3g} minute{'' if minutes == 1 else 's'}"]
            for loop in LOOPS:
                low, middle, high = self._spread(preset, method, minutes, loop)
                digits = 2 if loop == "open_loop" else 3
                ends = " … ".join(number(value, digits) if np.isfinite(value) else "diverged" for value in (low, high))
                cells += [number(middle, digits), ends]
            rows.append(cells)
        if preset == "small":
            for row in self._ablation(""):
                errors = [np.degrees(float(row[loop])) for loop in LOOPS]
                rows.append([row["method"], "", number(errors[0], 2), "", number(errors[1], 3), ""])
        return markdown_table(heads, rows)

    def _ablation(self, preset: str) -> list[Row]:
        return [row for row in self._runs if (row["experiment"], row["preset"]) == ("ablation", preset)]

    def _amounts(self, preset: str) -> list[tuple[str, float]]:
        return list(dict.fromkeys((row["method"], float(row["given_minutes"])) for row in self._ablation(preset)))

    def _spread(self, preset: str, method: str, minutes: float, loop: str) -> tuple[float, float, float]:
        rows = [
            row for row in self._ablation(preset) if (row["method"], float(row["given_minutes"])) == (method, minutes)
        ]
        values = np.degrees([float(row[loop]) for row in rows])
        return float(values.min()), float(np.median(values)), float(values.max())

    def _curve(self, method: str, loop: str) -> AblationCurve:
        amounts = np.array([minutes for name, minutes in self._amounts("small") if name == method])
        low, median, high = np.radians([self._spread("small", method, minutes, loop) for minutes in amounts]).T
        return AblationCurve(amounts, low, median, high)

    def _baselines(self, loop: str) -> dict[str, float]:
        return {row["method"]: float(row[loop]) for row in self._ablation("")}


def make_page(folder: Path) -> str:
    """Return the page that the tables of a folder make."""
    return render(folder / "so101.md.j2", So101(folder))


def draw_ablation() -> bytes:
    """Draw errors over minutes of data."""
    found = So101(HERE)
    curves = {loop: {name: found._curve(name, loop) for name in ("source + φ", "ψ")} for loop in LOOPS}
    return to_png(draw_error_over_amount(curves, {loop: found._baselines(loop) for loop in LOOPS}, "minutes"))


PICTURES = {"so101_ablation.png": draw_ablation}

if __name__ == "__main__":
    write_page("so101", make_page(HERE), PICTURES)
