"""Loops over boxes of frequencies and plants, in ball arithmetic:  what holds for the balls holds for every member."""
