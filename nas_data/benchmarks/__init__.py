"""Speed benchmarks, and `blind`, which scores identified effects against sealed cases."""
