"""What no gains of a box can beat:  branch and bound on cells of rays, in floating point.

`cells` says how much the loops of a cell differ, `discs` discards by enclosures with an error of first order in the
cell's size, `tangents` and `crossings` linearise what is left with an error of second order, `polygon` asks whether the
linear rows leave anything, `branch` cuts cells.
"""
