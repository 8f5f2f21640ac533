"""Transfer functions as people write and print them:  text -> exact coefficients.

`from_text` is the entry.  It reads formulas of s with products without a sign, e^(-Ls), tf(…) and zpk(…) with their
options, assignments, and the three lines over and under a bar that MATLAB, Octave and python-control print.  Numbers
stay the decimals that are written; nothing is run as a program.

    text.py        text -> statements of tokens
    parser.py      statements -> a rational function and a dead time
    functions.py   tf, zpk, conv, exp
    rational.py    rational functions with exact coefficients
    plant.py       what can be controlled: proper, real, causal, without hidden modes that are not stable
"""

from fopi_tune.spec.transfer_functions.plant import WrittenPlant, from_text

__all__ = ["WrittenPlant", "from_text"]
