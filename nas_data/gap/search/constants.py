"""Tuned constants of the search, in one place."""

# Scores [nats]
PRICE = 12.0  # of an effect or a freed parameter of the model
PARAMETER_PRICE = 3.0  # of every further parameter of an effect, and of an effect that MJCF alone cannot express
TIE = 1.0  # difference that says nothing
FAR_BEHIND = 60.0  # difference that decides even between short fits or first-order estimates

# Shares of a gain or an error
NEGLIGIBLE_GAIN = 0.05  # below it, a further gain does not count
ERROR_SHARE = 0.1  # of a present error: tolerated, or by which another start must be better
GAIN_SHARE = 0.5  # of a gain: by which one end must lead, or a first-order estimate may fall behind

# Held-out error of a joint [noise floors]
AT_FLOOR = 1.15  # below it, a joint needs no effect
AT_USUAL_ERROR = 1.05  # the same beside a baseline, of which each joint has 1 on average
EXPLAINED = 1.5  # below it, a joint is explained
FAR_ABOVE = 5.0  # above it, a joint is far from explained
EXCITED_RATIO = 10.0  # a joint that moves further than this in an episode is excited
BEYOND_PRIOR = 2.5  # [standard deviations] above it, a base parameter contradicts its prior

# Counts
MAX_LEADERS = 2  # best of a ranking that are pursued where each costs many fits
MAX_ALTERNATIVES = 3  # most alternatives that are fitted further
MAX_ROUNDS = 3  # most repetitions of a move or fit
SIMPLE_SIZE = 3  # parts of a simple hypothesis, joints at which one climbs first, joints from which a value is shared
PARTS_PER_JOINT = 2  # above it, nearly everything is missing
SHORTLIST = 6  # most alternatives that are fitted for a few steps
LARGE_SIZE = 8  # parts above which only the most doubtful ones are compared, or several dropped at a time

# Episodes of the search
SEARCH_EPISODES = 6
SEARCH_ROWS = 1800  # fewest rows, for short episodes
ODD_ERROR = 3.0  # times the median error of a joint above which an episode is added

# Fits
CORRELATION = 0.15  # [s] correlation time of a rollout's errors; its rows count as one observation
CONVERGED_GAIN = 1e-3  # [nats per observation] expected gain below which a fit has converged
SHORT_WINDOW = 1.0  # [s] of the first plain fit; open-loop errors of a wrong model grow fast
