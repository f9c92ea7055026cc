"""Arms of the setting `any` whose model has a position gain of 3 to 50 times the true one in every joint."""

from dataclasses import replace

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Conditions, Hidden, Identity
from nas_data.benchmarks.blind.designs import draw_design, draw_log_uniform
from nas_data.benchmarks.blind.settings import any as any_setting

EXCESS = (3.0, 50.0)  # the model's gain over the true one: such gains are set to hold a pose
EFFECT = "servo_stiffness"


def draw_gain_excess(identity: Identity) -> float:
    """Return the ratio of a case's model gain to the true gain."""
    return draw_log_uniform(identity.stream("excess"), *EXCESS)


def draw(identity: Identity) -> tuple[NominalArm, Conditions]:
    """Draw as `any` does and raise the gains of the model, not its damping."""
    conditions = any_setting.draw_conditions(identity)
    return draw_design(identity.stream("arm"), conditions.period, draw_gain_excess(identity)), conditions


def make_gain_effects(identity: Identity, arm: NominalArm) -> tuple[Hidden, ...]:
    """Return the hidden gain factors of the true servos."""
    return tuple(Hidden(EFFECT, joint, {"factor": 1 / draw_gain_excess(identity)}) for joint in arm.joints)


SETTING = replace(
    any_setting.SETTING,
    draw=draw,
    inside={name: kind for name, kind in any_setting.SETTING.inside.items() if name != EFFECT},
    given=make_gain_effects,
)
