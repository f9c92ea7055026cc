"""The log: programs show it on stderr, a library leaves that to its caller."""

import subprocess
import sys


def test_a_caller_who_configures_nothing_sees_warnings_alone():
    code = """
from nas_data.log import warn, warn_once
from nas_data.runs.progress import say
say("half done")
warn(["the arm is long"])
for _ in range(2):
    warn_once("the arm is red")
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stderr == "nas: warning: the arm is long\nnas: warning: the arm is red\n"
    assert told.stdout == ""


def test_a_program_shows_each_line_once_whatever_the_root_logger_shows():
    code = """
import logging
from nas_data.log import show
from nas_data.runs.progress import say
logging.basicConfig()
show()
show()
say("half done: 50 %s")
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stderr == "half done: 50 %s\n"
