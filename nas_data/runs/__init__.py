"""Run long computations: stages that resume, worker processes, hashes of the code that determines a result."""
