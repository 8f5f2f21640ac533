"""Digital controllers simulated on samples, many plants at once:  scenario, controllers, plants -> measures, signals.

`simulate` runs the `kernel` compiled by Numba; `reference` is a plain implementation that tests compare it with.
"""
