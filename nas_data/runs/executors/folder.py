"""Jobs on any number of machines that share a disk: each process takes jobs that no other process has taken."""

from nas_data.runs.parallel import Workers

EXECUTOR = Workers(shared=True)
