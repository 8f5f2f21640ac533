"""Where the project's files are."""

from __future__ import annotations

from pathlib import Path

import fopi_tune

ROOT = Path(__file__).parents[2]
#: the shipped specs, designed as the loop in continuous time
CONTINUOUS = Path(__file__).parent / "continuous"
#: what `PYTHONPATH` has for the package that the tests have imported: what it compiled is then used again
IMPORTED = Path(fopi_tune.__file__ or "").parents[1]
