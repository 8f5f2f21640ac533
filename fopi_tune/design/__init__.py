"""DesignSpec -> Candidate:  scan the whole box by rays of gains, polish by Ipopt, exchange worst plants, explain."""

from fopi_tune.design.search import Neighbour
from fopi_tune.design.synthesis import design, neighbour
from fopi_tune.design.warm import Solution, Warm

__all__ = ["Neighbour", "Solution", "Warm", "design", "neighbour"]
