"""The block as one bundle: adjustment, self-calibration, reliability of every observation."""
