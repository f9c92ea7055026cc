"""Errors of serial ports, each with a remedy."""

import errno
from pathlib import Path

from nas_data.errors import AdapterLost, ArmError, NoSuchPort, PortBusy, PortDenied

KINDS = ("ttyUSB*", "ttyACM*", "ttyAMA*", "tty.usb*", "cu.usb*")


def make_port_error(path: str, error: OSError | ValueError) -> ArmError:
    """Return the error for a port that could not be opened."""
    code = getattr(error, "errno", None)
    if code in {errno.ENOENT, errno.ENODEV, errno.ENXIO} or not Path(path).exists():
        return NoSuchPort(f"There is no port {path}; plug the adapter in and give one of: {_list_ports()}.")
    if code in {errno.EACCES, errno.EPERM}:
        return PortDenied(
            f"{path} may not be opened by this user; join the group that owns it "
            "(sudo usermod -aG dialout $USER) and log in again."
        )
    if code in {errno.EBUSY, errno.EAGAIN} or "lock" in str(error):
        return make_busy_error(path)
    return ArmError(f"{path} cannot be used as a serial port; give the adapter's port, one of: {_list_ports()}.")


def _list_ports() -> str:
    """Return the available ports as a list for a sentence."""
    found = sorted(str(path) for kind in KINDS for path in Path("/dev").glob(kind))
    return ", ".join([*found, "virtual"])


def make_busy_error(path: str) -> PortBusy:
    """Return the error for a port that another program uses."""
    return PortBusy(f"{path} is used by another program; close that program (a recorder, a monitor) and try again.")


def make_lost_port_error(path: str) -> AdapterLost:
    """Return the error for an open port that has vanished."""
    return AdapterLost(f"{path} vanished while it was used; plug the adapter in again and check its cable.")
