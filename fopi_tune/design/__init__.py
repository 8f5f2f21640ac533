"""DesignSpec -> Candidate:  compile to a CasADi NLP, solve with Ipopt, exchange until nothing is violated."""

from fopi_tune.design.result import Candidate, Give, Status
from fopi_tune.design.search import Neighbour, Violation, design, neighbour

__all__ = ["Candidate", "Give", "Neighbour", "Status", "Violation", "design", "neighbour"]
