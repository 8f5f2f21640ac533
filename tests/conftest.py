"""What holds for all tests."""

from __future__ import annotations

from hypothesis import settings

# the same examples in every run: what fails once fails again
settings.register_profile("seeded", derandomize=True)
settings.load_profile("seeded")
