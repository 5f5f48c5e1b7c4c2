"""The minimum of v'Pv of a block, its cofactors, and what every observation says."""
