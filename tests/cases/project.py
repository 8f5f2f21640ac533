"""Where the project's files are."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
#: the shipped specs, designed as the loop in continuous time
CONTINUOUS = Path(__file__).parent / "continuous"
