"""DesignSpec -> Candidate:  compile to a CasADi NLP, solve with Ipopt, exchange until nothing is violated."""

from fopi_tune.design.search import Neighbour
from fopi_tune.design.synthesis import design, neighbour
from fopi_tune.design.warm import Seen, Solution, Warm

__all__ = ["Neighbour", "Seen", "Solution", "Warm", "design", "neighbour"]
