"""Facts of the machine that a run was made on."""

from __future__ import annotations

import os
import platform
from pathlib import Path


def machine() -> dict[str, object]:
    """System, processor and its model, cores (of the machine, and those this process may use), memory [GiB]."""
    return {
        "system": " ".join([platform.system(), platform.release().split("-")[0], *platform.libc_ver()]),
        "processor": platform.machine(),
        "model": cpu_model(),
        "cores": os.cpu_count(),
        "usable_cores": len(os.sched_getaffinity(0)),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
    }


def cpu_model(info: Path = Path("/proc/cpuinfo")) -> str:
    """Name, family and model of the first processor; empty where the system does not tell."""
    try:
        lines = [line.split(":", 1) for line in info.read_text(encoding="utf-8").splitlines() if ":" in line]
    except OSError:
        return ""
    facts = {key.strip(): value.strip() for key, value in reversed(lines)}  # the first one wins
    parts = (facts.get("model name"), *(f"{key} {facts[key]}" for key in ("cpu family", "model") if key in facts))
    return ", ".join(part for part in parts if part)
