"""Digital controllers on samples, many plants at once:  scenario, controllers, plants -> measures and signals.

`simulate` is compiled by Numba; `reference` is the same written plainly, and the tests compare the two.
"""
