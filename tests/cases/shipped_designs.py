"""Designs of the shipped specs that several tests read, each computed once a process."""

from __future__ import annotations

from functools import cache

from cases.project import CONTINUOUS

import fopi_tune as ft


@cache
def design_of(name: str, proof: bool = True) -> ft.Design:
    """The design of `specs/<name>.yaml`."""
    return ft.tune(CONTINUOUS / f"{name}.yaml", proof=proof)
