"""What no gains of a box can beat:  branch and bound on cells of rays, in floating point.

`discs` discards by enclosures whose error is of first order in the cell's size, `tangents` and `crossings` linearise
what is left with an error of second order, `polygon` asks whether the linear rows leave anything, `branch` cuts cells.
"""
