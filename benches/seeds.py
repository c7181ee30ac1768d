"""Which seeds a bench draws its scenes with: ``BENCH [COUNT] [--training]``."""

from __future__ import annotations

import argparse

from vffnull.evaluation import scenes

TRAINING = 500
EVALUATION = scenes.EVALUATION.start + 60


def asked(description: str | None) -> range:
    """So many as the command line asks for, 60 by default, of evaluation seeds or of others for tuning."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("count", type=int, nargs="?", default=60)
    parser.add_argument("--training", action="store_true")
    given = parser.parse_args()
    first = TRAINING if given.training else EVALUATION
    return range(first, first + given.count)
