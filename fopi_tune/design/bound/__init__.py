"""What no gains of a box can beat:  branch and bound on cells of rays, in floating point.

`integrals` says how much s^-alpha, or the filter of samples, changes over a range of alpha, `cells` how much the loops
of a cell differ (`derivative_cells` those with a derivative; `columns` is what both write), `gain_ranges` which gains
are in the box, `discs` discards by enclosures with an error of first order in the cell's size, `tangents` and
`crossings` (by `implicit`) linearise what is left with an error of second order, `polygon` asks whether the linear rows
leave anything, `branch` cuts cells.
"""
