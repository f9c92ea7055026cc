"""The Poppy Ergo Jr as a plug-in of LeRobot: robot `ergojr` and teleoperator `ergojr_excitation`."""

from lerobot_robot_ergojr.config_ergojr import ErgoJrConfig, ErgoJrExcitationConfig
from lerobot_robot_ergojr.ergojr import ErgoJr
from lerobot_robot_ergojr.excitation import ErgoJrExcitation

__all__ = ["ErgoJr", "ErgoJrConfig", "ErgoJrExcitation", "ErgoJrExcitationConfig"]
