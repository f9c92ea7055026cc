"""Studies that run the whole pipeline: the paper's experiments, ablations, the demo."""
