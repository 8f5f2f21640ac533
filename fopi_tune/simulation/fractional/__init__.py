"""The fractional loop in continuous time, exactly:  no filter stands in for s^-alpha.

`linear` inverts the linear loop's Laplace transform; `time_stepping` steps through time where saturation or a
reference of any shape forbids that; `commensurate` is the pseudo-state model with orders that are fractions p/q.
"""
