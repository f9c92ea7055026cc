"""Results of policies with a given return."""

from nas_data.policies.policy import DivergedEpisodes, EvaluationTime, PolicyResult, PolicyScore


def scored(mean_return: float) -> PolicyResult:
    """Return a result of ten episodes, half of which reached the goal."""
    score = PolicyScore(mean_return, mean_return, 0.5, 100.0, 0, 10)
    return PolicyResult({}, {}, score, (mean_return,) * 10, 1.0, 1.0, EvaluationTime(1.0, 1.0), DivergedEpisodes(0, 0))
