"""Progress messages: no step is silent for long."""

import time

from nas_data.runs.progress import never_silent


def test_a_long_step_says_how_long_ago_it_began():
    lines: list[str] = []
    with never_silent("reading", lines.append, silence=0.2) as say:
        say("fitting: 12 numbers of 3 joints")
        time.sleep(0.9)
        say("done")
    assert lines[0] == "fitting: 12 numbers of 3 joints" and lines[-1] == "done"
    beats = lines[1:-1]
    assert 2 <= len(beats) <= 4
    assert all(beat.endswith("s since: fitting: 12 numbers of 3 joints") for beat in beats)


def test_before_the_first_message_the_first_step_is_named():
    lines: list[str] = []
    with never_silent("reading the recording", lines.append, silence=0.2):
        time.sleep(0.5)
    assert lines and all(line.endswith("s since: reading the recording") for line in lines)
