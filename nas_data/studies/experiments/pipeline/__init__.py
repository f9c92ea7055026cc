"""What the experiments share: recordings, models and names of one environment, policies, the authors' numbers."""
