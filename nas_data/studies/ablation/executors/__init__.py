"""Executors, which run the trials of a sweep as `run_jobs` does: the file `a_b.py` holds the executor `a_b` as `run`.

Another cluster needs one more file. Jobs are picklable, the function must be importable by name on every machine, and
the jobs' folders must have the same path there.
"""
