"""Reference answers in time of the exact fractional loop, against which filters and other simulators are judged.

`exact_linear` inverts the linear loop's Laplace transform; `exact_time` steps through time where saturation or a
reference of any shape forbids that; `commensurate` is the pseudo-state model with orders that are fractions p/q.
`simulate` runs digital controllers on samples, many plants at once; `reference` is the same written plainly.
`inclusion` runs the car with throttle and brake, whose controllers are filters, in continuous time with located jumps.
Nothing else here approximates s^-alpha by a filter.
`draws` gives plants drawn from a family by index; `tally` and `statistics` what many draws say of all.
"""
