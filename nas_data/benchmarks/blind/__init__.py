"""The blind benchmark: hidden effects on independent plants, and the grading of what a workflow says about them."""
