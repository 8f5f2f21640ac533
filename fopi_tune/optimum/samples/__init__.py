"""The loop on samples:  the filter of s^-alpha as a function of its order, and the coordinates of its gains."""
