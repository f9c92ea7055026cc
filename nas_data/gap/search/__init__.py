"""Search for missing effects; docs/search.md has the algorithm with its formulas."""
