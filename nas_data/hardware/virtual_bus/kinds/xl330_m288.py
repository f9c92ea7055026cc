"""ROBOTIS XL330-M288-T, the servo of a Koch arm's elbow, wrist and gripper; source: e-manual, X series."""

from nas_data.hardware.virtual_bus.kinds.xl430_w250 import XSeries

KIND = XSeries(model=1200, gain=400, voltages=(35, 70), supply=5.0, torque=0.52, current=1.47)
