"""Figures, drawn from results' documents and said in words."""
