"""Gymnasium environments, plain and augmented: one file per task, registered under `nas/` on import."""

import gymnasium

from nas_data import registry
from nas_data.envs.base import environment_id

for _name in registry.names("envs"):
    gymnasium.register(
        id=environment_id(_name), entry_point="nas_data.envs.loop.arm_env:ArmEnv", kwargs={"task": _name}
    )
