"""A study in a process of its own, for tests that kill it:  python study_process.py STUDY FOLDER WORKERS [retry].

With the word `blocks` 512 draws are a task of their own.
"""

from __future__ import annotations

import sys
from pathlib import Path

from fopi_tune.study import Machines, engine, run
from fopi_tune.study.load import load_study


def main() -> None:
    """Run, and leave the table beside the ledger."""
    file, folder, workers, *words = sys.argv[1:]
    machines = Machines(None, workers) if workers.startswith("tcp:") else Machines(int(workers))
    if "blocks" in words:
        engine.BLOCK = 512
    loaded = load_study(file, registry="cases.study_claims")
    told = lambda counts: print(counts.done + counts.failed, flush=True)  # noqa: E731
    result = run(loaded, Path(folder), machines, retry_failed="retry" in words, told=told)
    (Path(folder) / "table.csv").write_text(result.table.to_csv(), encoding="utf-8")
    print("failures", [name for _, name, _ in result.failures], flush=True)


if __name__ == "__main__":
    main()
