"""The closed-form formulas: `stewart` is the text, `dynamics` runs it on arrays of samples."""

from .dynamics import (
    Infeasible,
    InverseDynamics,
    LegCoordinates,
    NotDeterminate,
    SingularPose,
    driving_forces,
    inverse_dynamics,
    inverse_kinematics,
)
from .stewart import Leg, Load, Parameters, PlanarParameters, PlatformMotion

__all__ = [
    "Infeasible",
    "InverseDynamics",
    "Leg",
    "LegCoordinates",
    "Load",
    "NotDeterminate",
    "Parameters",
    "PlanarParameters",
    "PlatformMotion",
    "SingularPose",
    "driving_forces",
    "inverse_dynamics",
    "inverse_kinematics",
]
