"""DesignSpec -> Candidate:  compile a CasADi NLP, solve it with Ipopt, add violated points and solve again."""

from fopi_tune.design.search import Neighbour
from fopi_tune.design.synthesis import design, neighbour
from fopi_tune.design.warm import Seen, Solution, Warm

__all__ = ["Neighbour", "Seen", "Solution", "Warm", "design", "neighbour"]
