"""Jobs on this machine: processes of one thread each; with one worker, this process."""

from nas_data.runs.parallel import ONE_WORKER

EXECUTOR = ONE_WORKER
