"""How a box of gains is discarded:  what every gain that is the answer fulfils, and the tests that a box breaks it."""
