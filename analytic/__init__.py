"""The closed-form formulas: `stewart` is the text, `dynamics` and `forward` run it on arrays of samples.

Inverse dynamics has back ends (`backends`): NumPy, plain floats, or compiled; `ControlLoop` for one sample at a time.

`simulate` and `constrained` integrate in time, `stability` says how errors grow, `assembly` finds the pose of given leg
lengths.
"""

from .assembly import Assembly, AssemblyError, assemble
from .compiler import NoCompiler
from .constrained import ConstrainedSimulation, simulate_constrained
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
from .forward import Accelerations, forward_dynamics, growth_of_rounding
from .integrate import SimulationError
from .loop import ControlLoop
from .orientation import GimbalLock, cardan_from_quaternion, quaternion_from_cardan
from .printed import inverse_dynamics_printed
from .simulate import Simulation, State, energies, energy_defect, simulate
from .stability import growth_rates, linearised
from .stewart import Leg, Load, Parameters, PlanarParameters, PlatformMotion

__all__ = [
    "Accelerations",
    "Assembly",
    "AssemblyError",
    "ConstrainedSimulation",
    "ControlLoop",
    "GimbalLock",
    "Infeasible",
    "InverseDynamics",
    "Leg",
    "LegCoordinates",
    "Load",
    "NoCompiler",
    "NotDeterminate",
    "Parameters",
    "PlanarParameters",
    "PlatformMotion",
    "Simulation",
    "SimulationError",
    "SingularPose",
    "State",
    "assemble",
    "cardan_from_quaternion",
    "driving_forces",
    "energies",
    "energy_defect",
    "forward_dynamics",
    "growth_of_rounding",
    "growth_rates",
    "inverse_dynamics",
    "inverse_dynamics_printed",
    "inverse_kinematics",
    "linearised",
    "quaternion_from_cardan",
    "simulate",
    "simulate_constrained",
]
