"""A planar arm of two joints, and recordings of it made by the program."""

from pathlib import Path

from nas_data.cli import main

ARM = """
<mujoco model="two_joints">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <joint type="hinge" axis="0 1 0" range="-2 2" damping="0.03" armature="0.001"/>
    <geom type="capsule" size="0.01" contype="0" conaffinity="0"/>
    <position kp="0.5" forcerange="-0.3 0.3" ctrlrange="-1.5 1.5"/>
  </default>
  <worldbody>
    <body name="upper" pos="0 0 0.3">
      <joint name="shoulder"/>
      <geom fromto="0 0 0 0.08 0 0" mass="0.03"/>
      <body name="lower" pos="0.08 0 0">
        <joint name="elbow"/>
        <geom fromto="0 0 0 0.07 0 0" mass="0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder"/>
    <position name="elbow" joint="elbow"/>
  </actuator>
</mujoco>
"""


def recorded(arm: Path, out: Path, *options: str) -> Path:
    common = ("--episodes", "8", "--seconds", "2", "--rate", "100", "--quantum", "0.005", "--noise", "0.0009")
    commands = ("--excitation", "babbling:every=50", "--blind")
    assert main(["record", "sim", "--robot", str(arm), *common, *commands, *options, "--out", str(out)]) == 0
    return out
