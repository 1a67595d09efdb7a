"""Tables out: files and terminal. Knows tables, not dynamics."""

from .audit import print_audit
from .baseline import write_baseline
from .bench import SPEED_ERROR_COLUMNS, print_bench, write_bench
from .files import (
    AGREEMENT_COLUMNS,
    MARGIN_COLUMNS,
    SIMULATION_COLUMNS,
    OutputError,
    require_free,
    write_files,
    write_run,
    write_simulation,
)
from .findings import FINDING_COLUMNS
from .history import HistoryError, Night, earlier, load_night, night_files, night_of
from .junit import junit
from .regressions import compare, counts, status
from .simulation import print_simulation
from .stress import STRESS_COLUMNS, print_stress, write_stress
from .summary import print_regressions, summary
from .terminal import print_verdict

__all__ = [
    "AGREEMENT_COLUMNS",
    "FINDING_COLUMNS",
    "MARGIN_COLUMNS",
    "SIMULATION_COLUMNS",
    "SPEED_ERROR_COLUMNS",
    "STRESS_COLUMNS",
    "HistoryError",
    "Night",
    "OutputError",
    "compare",
    "counts",
    "earlier",
    "junit",
    "load_night",
    "night_files",
    "night_of",
    "print_audit",
    "print_bench",
    "print_regressions",
    "print_simulation",
    "print_stress",
    "print_verdict",
    "require_free",
    "status",
    "summary",
    "write_baseline",
    "write_bench",
    "write_files",
    "write_run",
    "write_simulation",
    "write_stress",
]
