"""The closed-form formulas: `stewart` is the text, `dynamics` runs it on arrays of samples."""

from .dynamics import (
    InverseDynamics,
    LegCoordinates,
    NotDeterminate,
    SingularPose,
    driving_forces,
    inverse_dynamics,
    inverse_kinematics,
)
from .stewart import Leg, Load, Parameters, PlatformMotion

__all__ = [
    "InverseDynamics",
    "Leg",
    "LegCoordinates",
    "Load",
    "NotDeterminate",
    "Parameters",
    "PlatformMotion",
    "SingularPose",
    "driving_forces",
    "inverse_dynamics",
    "inverse_kinematics",
]
