"""The inner loops of `bode_form`, `roots` and `peaks`, compiled by Numba:  imported where they are first needed."""
