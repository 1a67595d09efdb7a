"""Which samples of a long trajectory are compared with the truth: certified numbers take milliseconds each."""

from __future__ import annotations

import numpy as np

MOST_SAMPLES = 1000
SEED = 20160403


def chosen_samples(nt: int, condition: np.ndarray, sin_q_n: np.ndarray) -> np.ndarray:
    """All samples up to 1000; beyond, 1000 seeded ones, the worst conditioned and the steepest."""
    if nt <= MOST_SAMPLES:
        return np.arange(nt)
    picked = np.random.default_rng(SEED).choice(nt, MOST_SAMPLES, replace=False)
    return np.unique([*picked, np.argmax(condition), np.argmin(sin_q_n)])
