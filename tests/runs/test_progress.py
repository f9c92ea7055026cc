"""Progress messages: no step is silent for long."""

import io
import time

import pytest

from nas_data.log import StderrHandler, show
from nas_data.runs import progress
from nas_data.runs.progress import Counting, begin, report_silence, say


@pytest.fixture
def lines(monkeypatch) -> list[str]:
    """The messages that a program shows."""
    shown: list[str] = []
    show()
    monkeypatch.setattr(StderrHandler, "emit", lambda self, record: shown.append(record.getMessage()))
    return shown


def test_a_long_step_says_how_long_ago_it_began(lines):
    with report_silence("reading", silence=0.2):
        say("fitting: 12 numbers of 3 joints\n  of which none is fixed")
        time.sleep(0.9)
        say("done")
    assert lines[0].startswith("fitting: 12 numbers of 3 joints") and lines[-1] == "done"
    beats = lines[1:-1]
    assert 2 <= len(beats) <= 4
    assert all(beat.endswith("s since: fitting: 12 numbers of 3 joints") for beat in beats)


def test_before_the_first_message_the_first_step_is_named(lines):
    with report_silence("reading the recording", silence=0.2):
        time.sleep(0.5)
    assert lines and all(line.endswith("s since: reading the recording") for line in lines)


def test_a_step_without_a_message_is_named_once_it_takes_long(lines):
    with report_silence("reading", silence=0.2):
        for step in ("one", "two"):
            begin(step)
            time.sleep(0.12)
        time.sleep(0.3)
    assert lines[0] == "    two" and lines[1].endswith("s since: two")


def test_counts_are_no_silence(lines, capsys):
    count = Counting("rolling out")
    with report_silence("reading", silence=0.2):
        for done in range(6):
            count(done, 10)
            time.sleep(0.1)
        assert lines == []
        time.sleep(0.3)
    assert lines[0].endswith("s since: rolling out: 5 of 10")


def test_counts_without_a_terminal_are_a_line_now_and_then(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PAUSE", 0.2)
    began, count = time.monotonic(), Counting("rolling out")
    for done in range(11):
        count(done, 10, "servos up to 40 °C")
        time.sleep(0.05)
    most = (time.monotonic() - began) / 0.2
    told = capsys.readouterr().err
    assert 1 <= told.count("\n") <= most and "\r" not in told
    for line in told.splitlines():
        assert line.startswith("rolling out: ") and "/10 [" in line and line.endswith("servos up to 40 °C]")


def test_what_is_counted_at_once_is_not_told(capsys):
    count = Counting("rolling out")
    for done in (1, 2, 3):
        count(done, 3)
    assert capsys.readouterr().err == ""


class Terminal(io.StringIO):
    """A file that says that it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_line_stands_above_the_bar_of_a_terminal(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr(progress, "PAUSE", 0.0)
    count = Counting("saved")
    count(3, 8)
    say("servo 2 is hot")
    assert "\rservo 2 is hot\n" in terminal.getvalue()
    assert terminal.getvalue().rpartition("\n")[2].startswith("\rsaved:  38%")
    count(8, 8)
    assert terminal.getvalue().endswith("\r"), "the bar is removed at the end"
