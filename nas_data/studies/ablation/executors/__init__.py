"""Executors of a sweep's trials, with the interface of `run_jobs`: the file `a_b.py` holds the executor `a_b` as `run`.

Another cluster needs another file. Jobs are picklable, the function must be importable by name on every machine, and
the jobs' folders must have the same path there.
"""
