"""Films of an episode: the measured arm and its models as ghosts in one scene."""
