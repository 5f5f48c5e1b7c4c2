"""The minimum of v'Pv of a block, its cofactors, and the tests of every observation."""
