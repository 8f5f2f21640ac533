"""The shortest settling time that gains can reach:  a bisection over whole samples, each a search of its own.

A settling time changes in jumps of a sample; what is searched for is by how much the output leaves its band afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.exchange import MET, Counts, local_optima, solve
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.time_domain.starts import starts_of

#: gains from which a settling time is asked for, and gains that are scattered where none are known
_STARTS, _SCATTERED = 3, 200
#: samples by which worst plants inside the box may settle later than those at its vertices
_MORE_SAMPLES = 4


def shortest_settling(
    question: Callable[[int], ScenarioProblem], low: int, high: int, known: Sequence[FoPi], counts: Counts
) -> tuple[int, FoPi] | None:
    """The fewest samples in which every plant settles, and gains that do it; None where no number is enough.

    Of a lower limit: by how many samples it has to be relaxed at least.

    Args:
        question: the problem of how far the output leaves its band after so many samples, the rest held.
        low: a number that is too few.
        high: a number beyond all.
        known: gains that may be close.
        counts: of the work, added to.
    """
    starts, best = list(known), None
    while high - low > 1:
        middle = (low + high) // 2
        asked = question(middle)
        if not starts:
            starts = starts_of(asked, LoopCuts(asked.loop), _STARTS, _SCATTERED)
        found = local_optima(asked, LoopCuts(asked.loop), starts[-_STARTS:], counts)
        met = [each for each in found if each.model.violation <= MET and each.model.objective <= 0.0]
        if met:
            best, high = middle, middle
            starts.append(met[0].gains)
        else:
            low = middle
    # of the vertices of the box so far; of the whole family a few samples more
    for count in () if best is None else range(best, best + _MORE_SAMPLES):
        whole = solve(question(count), counts, starts[-_STARTS:], thorough=False)
        if whole is not None and whole.violation <= MET and whole.objective <= 0.0:
            return count, whole.gains
    return None
