"""Results of a study's cells on the disk:  SQLite in WAL mode, keyed by the hash of each cell's content.

A killed process leaves a valid file.  A cell is in the ledger with its result or not at all; there is no state
"running".  The plan lists the cells that the study has now.  Results of cells that were in an earlier plan are kept and
used when the study has them again.  One process writes.

Each result is kept with the hash of what was recorded.  One that has another hash was damaged on the disk: its cell
counts as not done, and is run again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fopi_tune.errors import DomainError
from fopi_tune.results.saved.writing import obstacle
from fopi_tune.study.model import Cell, Study
from fopi_tune.study.worker import CellResult

#: the file in a study's folder
LEDGER = "ledger.sqlite"
_LOCK = "ledger.lock"
#: `user_version` of the file; format 1 had no digests
_FORMAT = 2
_TABLES = """
CREATE TABLE IF NOT EXISTS results (
    key TEXT PRIMARY KEY, failed INTEGER NOT NULL, document TEXT NOT NULL, reason TEXT NOT NULL, seconds REAL NOT NULL,
    digest TEXT NOT NULL DEFAULT ''
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS plan (position INTEGER PRIMARY KEY, key TEXT NOT NULL, label TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
"""
#: results of format 1 are of other sources of this package, so that none is ever used
_ADD_DIGESTS = "ALTER TABLE results ADD COLUMN digest TEXT NOT NULL DEFAULT '';"


class LedgerError(DomainError):
    """A ledger that cannot be used; the message says which, why and what to do."""


@dataclass(frozen=True)
class Cost:
    """What a study's cells cost, measured in this run.

    Args:
        workers: processes that run cells.
        cell_processor_s: mean processor time of a cell, s.
        left_s: estimated time until all cells have run, s; None where draws of a cell are divided among workers.
    """

    workers: int
    cell_processor_s: float
    left_s: float | None


@dataclass(frozen=True)
class Counts:
    """The progress of a study.

    Args:
        total: cells of the plan.
        done: cells with a result.
        failed: cells that failed.
        cost: what the cells of this run cost so far; None before one has ended.
    """

    total: int
    done: int
    failed: int
    cost: Cost | None = field(default=None, compare=False)

    @property
    def left(self) -> int:
        """Cells that were not run."""
        return self.total - self.done - self.failed


@dataclass(frozen=True)
class Progress:
    """How far a study is, by what its ledger has.

    Args:
        counts: of the cells; a damaged result is none.
        failures: index, label and reason of each failed cell, in order.
        damaged: index and label of each cell whose result was damaged, in order.
    """

    counts: Counts
    failures: tuple[tuple[int, str, str], ...]
    damaged: tuple[tuple[int, str], ...]


class Ledger:
    """An open ledger; made by `open_ledger` and `read_ledger`."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection = connection
        self.path = path

    def plan(self, study: Study, keys: Sequence[str], versions: Mapping[str, str]) -> None:
        """Store which cells the study has now."""
        about = {"name": study.name, "versions": json.dumps(dict(versions), sort_keys=True)}
        with self._transaction() as connection:
            connection.execute("DELETE FROM plan")
            rows = ((cell.index, key, cell.label) for cell, key in zip(study.cells, keys, strict=True))
            connection.executemany("INSERT INTO plan VALUES (?, ?, ?)", rows)
            connection.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", about.items())

    def record(self, results: Iterable[CellResult]) -> None:
        """Store results in one transaction; earlier results of the same cells are replaced."""
        rows = [
            (r.key, int(r.failed), r.document, r.reason, r.seconds, _digest(r.key, int(r.failed), r.document, r.reason))
            for r in results
        ]
        with self._transaction() as connection:
            connection.executemany("INSERT OR REPLACE INTO results VALUES (?, ?, ?, ?, ?, ?)", rows)

    def forget_failed(self, study: Study, versions: Mapping[str, str]) -> None:
        """Delete the results of a study's failed cells, so that they are run again."""
        with self._transaction() as connection:
            keys = ((key,) for key in cell_keys(study.cells, versions))
            connection.executemany("DELETE FROM results WHERE failed = 1 AND key = ?", keys)

    def discard_damaged(self) -> list[tuple[int, str]]:
        """Delete the plan's results that were damaged, so that their cells are run again; their indices and labels."""
        damaged = [(position, label, key) for position, label, key, result in self._rows() if result is None]
        if damaged:
            with self._transaction() as connection:
                connection.executemany("DELETE FROM results WHERE key = ?", [(key,) for _, _, key in damaged])
        return [(position, label) for position, label, _ in damaged]

    def known(self) -> frozenset[str]:
        """Keys of all results."""
        return frozenset(key for (key,) in self._fetch_all("SELECT key FROM results"))

    def counts(self) -> Counts:
        """The progress of the plan; damaged results, which `run` discards first, are not looked for."""
        (total,) = self._fetch_all("SELECT COUNT(*) FROM plan")[0]
        rows_found = dict(
            self._fetch_all("SELECT r.failed, COUNT(*) FROM plan p JOIN results r USING (key) GROUP BY r.failed")
        )
        return Counts(total, rows_found.get(0, 0), rows_found.get(1, 0))

    def failures(self) -> list[tuple[int, str, str]]:
        """Index, label and reason of every failed cell of the plan, in order."""
        query = "SELECT p.position, p.label, r.reason FROM plan p JOIN results r USING (key) WHERE r.failed = 1"
        return self._fetch_all(f"{query} ORDER BY p.position")

    def progress(self) -> Progress:
        """The progress of the plan, with every result read and compared with its hash."""
        done, failures, damaged = 0, [], []
        for position, label, _, result in self._rows():
            if result is None:
                damaged.append((position, label))
            elif result.failed:
                failures.append((position, label, result.reason))
            else:
                done += 1
        return Progress(Counts(self.counts().total, done, len(failures)), tuple(failures), tuple(damaged))

    def results(self) -> Iterator[tuple[int, CellResult]]:
        """Index and result of every cell of the plan that was run, in order.

        Raises:
            LedgerError: it cannot be read, or has something else than what was recorded.
        """
        for position, label, _, result in self._rows():
            if result is None:
                message = f"what {self.path} has of cell {position + 1} ({label}) is damaged"
                raise LedgerError(f"{message}; run the same command again: only that cell is run again")
            yield position, result

    def _rows(self) -> Iterator[tuple[int, str, str, CellResult | None]]:
        """Index, label, key and result of the plan's cells that have one, in order; None for a damaged result."""
        query = "SELECT p.position, p.label, r.key, r.failed, r.document, r.reason, r.seconds, r.digest FROM plan p"
        with self._errors_translated():
            rows_found = self._connection.execute(f"{query} JOIN results r USING (key) ORDER BY p.position")
            for position, label, key, failed, document, reason, seconds, digest in rows_found:
                is_whole = _digest(key, failed, document, reason) == digest
                yield position, label, key, CellResult(key, document, reason, seconds) if is_whole else None

    def document_of(self, index: int) -> str:
        """The result of a cell of the plan, as JSON."""
        query = "SELECT r.document FROM plan p JOIN results r USING (key) WHERE p.position"
        return str(self._fetch_all(f"{query} = {int(index)}")[0][0])

    def seconds(self) -> float:
        """Total computing time of the plan's results, seconds."""
        return float(self._fetch_all("SELECT TOTAL(r.seconds) FROM plan p JOIN results r USING (key)")[0][0])

    @property
    def name(self) -> str:
        """Name of the study."""
        rows_found = self._fetch_all("SELECT value FROM about WHERE name = 'name'")
        return rows_found[0][0] if rows_found else "?"

    def _fetch_all(self, query: str) -> list[Any]:
        with self._errors_translated():
            return self._connection.execute(query).fetchall()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._errors_translated(), self._connection:
            yield self._connection

    @contextlib.contextmanager
    def _errors_translated(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise _unusable_error(self.path, error) from error


@contextlib.contextmanager
def open_ledger(folder: Path) -> Iterator[Ledger]:
    """Open the ledger in a study's folder for writing, and create it where there is none; one process at a time.

    Raises:
        LedgerError: it cannot be read or written, or another process runs this study.
    """
    path = folder / LEDGER
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LedgerError(
            f"cannot make {folder} ({obstacle(folder, error)}); choose another folder with --out"
        ) from None
    if path.is_dir():
        raise LedgerError(
            f"{path} is a folder, where the study's results belong; move it away, or choose another --out"
        )
    with _locked(folder), contextlib.closing(_connect(path, path.as_posix(), uri=False)) as connection:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            # commits survive the end of this process; a power failure may lose the last ones but leaves a valid file
            connection.execute("PRAGMA synchronous = NORMAL")
            older = _ADD_DIGESTS if _check_format(connection, path) == 1 else ""
            # in one transaction: a file with tables but without a format counts as another program's
            connection.executescript(f"BEGIN; {_TABLES} {older} PRAGMA user_version = {_FORMAT}; COMMIT;")
        except sqlite3.Error as error:
            raise _unusable_error(path, error) from error
        yield Ledger(connection, path)


@contextlib.contextmanager
def read_ledger(folder: Path) -> Iterator[Ledger]:
    """Open the ledger in a study's folder for reading, also while the study runs.

    Raises:
        LedgerError: there is none, or it cannot be read.
    """
    path = folder / LEDGER
    if not path.is_file():
        raise LedgerError(f"there is no {LEDGER} in {folder}; name the folder of a study's results")
    if os.access(folder, os.W_OK) and os.access(path, os.W_OK):
        mode = "mode=rw"
    else:
        # what a killed process had done since, or a running one of somebody else, is in the WAL; without one nobody
        # writes, which SQLite needs to know
        mode = "mode=ro" if path.with_name(f"{path.name}-wal").exists() else "immutable=1"
    with contextlib.closing(_connect(path, f"{path.absolute().as_uri()}?{mode}", uri=True)) as connection:
        try:
            if _check_format(connection, path) == 0:
                raise LedgerError(f"{path} has no study yet; it has only just begun, or never did")
            yield Ledger(connection, path)
        except sqlite3.Error as error:
            raise _unusable_error(path, error) from error


def cell_keys(cells: Sequence[Cell], versions: Mapping[str, str]) -> list[str]:
    """The keys of cells: hashes of all that their results depend on."""
    return [cell.key(versions) for cell in cells]


def _digest(*recorded: object) -> str:
    """SHA-256 of what was recorded of a cell: SQLite sees no change within a text or a number."""
    return hashlib.sha256("\0".join(map(str, recorded)).encode()).hexdigest()


def _connect(path: Path, target: str, uri: bool) -> sqlite3.Connection:
    try:
        connection = sqlite3.connect(target, timeout=30.0, uri=uri)
    except sqlite3.Error as error:
        raise _unusable_error(path, error) from error
    # damaged text is seen by its hash, and spoils no other row
    connection.text_factory = lambda text: text.decode(errors="replace")
    return connection


def _check_format(connection: sqlite3.Connection, path: Path) -> int:
    """The format of the file; 0 for a new one."""
    (found,) = connection.execute("PRAGMA user_version").fetchone()
    if found > _FORMAT:
        raise LedgerError(f"{path} was made by a newer fopi-tune (format {found}); update, or choose another --out")
    if not found and connection.execute("SELECT name FROM sqlite_master").fetchall():
        raise LedgerError(f"{path} is a database of something else; choose another folder with --out")
    return int(found)


#: SQLite's primary result code of what is no fault of the file -> what to do, so that nothing is lost
_GO_ON = "and run the same command again: what was done is kept"
_ADVICE = {
    sqlite3.SQLITE_FULL: f"make room on the disk {_GO_ON}",
    sqlite3.SQLITE_IOERR: f"see whether the disk is full or damaged, {_GO_ON}",
    sqlite3.SQLITE_READONLY: f"see that its folder can be written, {_GO_ON}",
    sqlite3.SQLITE_CANTOPEN: f"see that its folder can be written and the disk has room, {_GO_ON}",
    sqlite3.SQLITE_PERM: f"see that its folder can be written, {_GO_ON}",
    sqlite3.SQLITE_BUSY: f"end what else uses it {_GO_ON}",
}


def _unusable_error(path: Path, error: sqlite3.Error) -> LedgerError:
    # extended result codes have the primary one in their lowest byte; errors of the module itself have none
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
    advice = _ADVICE.get(code, "move it away to begin anew, or choose another --out")
    return LedgerError(f"{path} cannot be used ({error}); {advice}")


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold a file lock, which the system releases when the process ends in any way."""
    try:
        import fcntl
    except ImportError:  # without such locks, SQLite's own locks keep the file consistent
        yield
        return
    try:
        descriptor = os.open(folder / _LOCK, os.O_CREAT | os.O_RDWR, 0o644)
    except OSError as error:
        raise LedgerError(
            f"cannot write {folder / _LOCK} ({obstacle(folder / _LOCK, error)}); choose another folder with --out"
        ) from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            message = f"another process runs the study in {folder}; wait for it, or choose another --out"
            raise LedgerError(message) from None
        yield
    finally:
        os.close(descriptor)
