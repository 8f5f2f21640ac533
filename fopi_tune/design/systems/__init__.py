"""Gains for two loops that take turns, designed on the simulation of the switched system.

Where modes change a trajectory has jumps in its derivatives by the gains, and in itself; so the search takes values
alone: gains scattered over the box, simplex searches from the best, exchanged with the worst pairs of plants.
"""

from fopi_tune.design.systems.search import SystemCandidate, design_system

__all__ = ["SystemCandidate", "design_system"]
