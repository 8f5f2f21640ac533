"""DesignSpec -> Candidate:  compile to a CasADi NLP, solve with Ipopt, exchange until nothing is violated."""

from fopi_tune.design.result import Candidate, Give, Status, Violation
from fopi_tune.design.search import Neighbour, design, neighbour
from fopi_tune.design.warm import Seen, Solution, Warm

__all__ = ["Candidate", "Give", "Neighbour", "Seen", "Solution", "Status", "Violation", "Warm", "design", "neighbour"]
