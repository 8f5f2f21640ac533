"""Statements to be proved over a box of frequencies and plants, and the branch and bound that proves them.

A claim examines one box.  `search` splits boxes until the claim is proved on each; `check_record` tests a record again.
"""
