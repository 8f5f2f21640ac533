"""Export formats of a digital controller beside C:  a controller and a word -> {file name: content}.

All are of the same stored coefficients in double precision as the C code, and do the same arithmetic, but `cmsis`,
which is the linear filter alone.
"""

from fopi_tune.digital.targets.export import Target, export_target

__all__ = ["Target", "export_target"]
