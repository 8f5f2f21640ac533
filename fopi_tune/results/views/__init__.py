"""Results as people meet them in Python: a few lines, a table, a data frame."""
