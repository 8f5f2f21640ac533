"""What is to be shown over a box of frequencies and plants, and the search for a proof of it.

A claim examines one box; `search` cuts boxes until each is shown, and `check` tests such a record again.
"""
