"""DesignSpec -> Candidate by a search of the whole box of gains:  rays, intervals of the gain, polish, bound.

With C = k C0 and C0 on the unit circle of scaled gains, every requirement is a union of intervals in ln k, so that the
search over three gains is one over two (the order alpha and the direction of C0) and can be done completely.  What it
finds is polished by Ipopt with worst plants and frequencies exchanged, and a bound in floating point says whether any
better gains can be left.
"""
