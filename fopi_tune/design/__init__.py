"""DesignSpec -> Candidate:  compile to a CasADi NLP, solve with Ipopt, exchange until nothing is violated."""

from fopi_tune.design.result import Candidate, Give, Status, Violation
from fopi_tune.design.search import design

__all__ = ["Candidate", "Give", "Status", "Violation", "design"]
