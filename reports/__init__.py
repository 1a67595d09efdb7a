"""Tables out: files and terminal. Knows tables, not dynamics."""

from .audit import print_audit
from .bench import SPEED_ERROR_COLUMNS, print_bench, write_bench
from .files import (
    AGREEMENT_COLUMNS,
    SIMULATION_COLUMNS,
    OutputError,
    require_free,
    write_files,
    write_run,
    write_simulation,
)
from .simulation import print_simulation
from .stress import STRESS_COLUMNS, print_stress, write_stress
from .terminal import print_verdict

__all__ = [
    "AGREEMENT_COLUMNS",
    "SIMULATION_COLUMNS",
    "SPEED_ERROR_COLUMNS",
    "STRESS_COLUMNS",
    "OutputError",
    "print_audit",
    "print_bench",
    "print_simulation",
    "print_stress",
    "print_verdict",
    "require_free",
    "write_bench",
    "write_files",
    "write_run",
    "write_simulation",
    "write_stress",
]
