"""Certificates of lists of plants:  one of each member, and what they say together."""
