"""The blind benchmark: effects hidden in independent plants, and the grading of a workflow's report on them."""
