"""Pruning of boxes of gains:  necessary conditions of a better design, and tests that a whole box violates one."""
