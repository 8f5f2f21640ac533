"""The check in floating point:  spec and gains -> Verification, the worst plant and frequency of every requirement.

It proves nothing; `certify` confirms in ball arithmetic what it found.
"""
