"""The fractional loop in continuous time, exactly:  s^-alpha itself, without an approximating filter.

`linear` inverts the linear loop's Laplace transform; `time_stepping` steps through time, for saturation and references
of any shape; `commensurate` is the pseudo-state model for orders that are fractions p/q.
"""
