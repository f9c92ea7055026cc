"""Audit for radians that a map declares as degrees: all numbers lie within a few degrees of zero."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.recording import Recording
from nas_data.importing.map import LogQuantity, Map

SMALLEST_LIKELY = 3.5  # [°]; a whole log within this many degrees of zero holds radians
AT_REST = 0.02  # [°]; a log that spans less does not move, whatever its unit


def check(recording: Recording, mapping: Map) -> list[AuditFinding]:
    """Refuse numbers that are unlikely to be degrees."""
    read = [(mapping.position, recording.positions)]
    if mapping.commands_positions:
        read.append((mapping.command, recording.commands))
    found = []
    for quantity, values in read:
        degrees = _logged_degrees(quantity, values)
        if not degrees.size or np.ptp(degrees, axis=0).max() < AT_REST or np.abs(degrees).max() > SMALLEST_LIKELY:
            continue
        what = (
            f"the {quantity.name} stays within {np.abs(degrees).max():.3g} as logged, in all joints: as degrees the "
            "robot hardly moved"
        )
        radians = "--unit rad" if mapping.layout.format == "lerobot" else f"unit = 'rad' in [read.{quantity.name}]"
        remedy = f"if these are radians, say {radians}, if they are degrees, add allow = ['unit_slip'] to [audit]"
        found.append(AuditFinding("unit_slip", recording.label, what, remedy, error=True))
    return found


def _logged_degrees(quantity: LogQuantity, values: np.ndarray) -> np.ndarray:
    """Return the values that the map reads as degrees, shape (N, k)."""
    in_degrees = [unit == "deg" for unit in quantity.conversion.units]
    return quantity.conversion.raw(values)[:, in_degrees]
